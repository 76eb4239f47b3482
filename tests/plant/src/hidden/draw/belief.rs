//! What is believed of a machine, and the machine as a model.

use std::fmt::Write;

use dynid_model::Link;

use super::dice::Dice;
use super::machine::{Links, Machine, is_known};
use crate::effects::EffectEntry;
use crate::hidden::{is_numerical, rounded, table_of};

/// Bounds that the believed model gives the values of its effects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Bounds {
    /// None: those of the device and of the effects hold.
    Default,
    /// Around what is believed.
    Own,
}

/// What is not known of the unit of the logged torques.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Gains {
    /// Fixed where links are open: only their product with a gain shows.
    Stated,
    /// To be found.
    Open,
}

/// `model.toml` of what is believed: `rest` are the machine's effects without what is hidden.
pub(super) fn believed(machine: &Machine, rest: &[EffectEntry], links: Links, gains: Gains, dice: &mut Dice) -> String {
    let bounds = if dice.chance(0.4) { Bounds::Own } else { Bounds::Default };
    let mut text = format!("# What is believed before anything is fitted.\ndevice = \"{}\"\n", machine.device.id);
    for (number, link) in (1..).zip(&machine.device.links) {
        let mut lines = String::new();
        for (symbol, parameter) in Link::SYMBOLS.iter().zip(&link.inertial) {
            let stated = machine.habits.links.iter().find(|(own, _)| *own == format!("link.{number}.{symbol}"));
            let value = parameter.value;
            match (stated, machine.links_within) {
                (Some((_, value)), _) => {
                    let _ = writeln!(lines, "{symbol} = {}", rounded(value * (1.0 + off(machine, dice))));
                }
                (None, Some(within)) if !is_known(parameter) && value != 0.0 => {
                    let reach = within * value.abs();
                    let (lower, upper) = (rounded(value - reach), rounded(value + reach));
                    let _ = writeln!(lines, "{symbol} = {{ value = {value}, lower = {lower}, upper = {upper} }}");
                }
                (None, Some(_)) if !is_known(parameter) && links == Links::Known => {
                    let _ = writeln!(lines, "{symbol} = {{ value = 0.0, fixed = true }}");
                }
                _ => {}
            }
        }
        if !lines.is_empty() {
            let _ = write!(text, "\n[link.{number}]\n{lines}");
        }
    }
    for entry in rest {
        text.push_str(&table_of(entry, &mut |symbol, value| {
            if is_numerical(&entry.id, symbol) {
                return format!("{value}");
            }
            if is_fixed(machine, entry, symbol, gains) {
                return format!("{{ value = {value}, fixed = true }}");
            }
            let believed = rounded(match symbol {
                "offset" => 0.0,
                "Kp" if gains == Gains::Open => 1.0,
                "qeq" => value + off(machine, dice) * f64::min(0.5, machine.strokes[entry.joint]),
                _ => value * (1.0 + off(machine, dice)),
            });
            let reach = if symbol == "qeq" { 0.5 } else { 3.0 * machine.off * believed.abs() };
            if bounds == Bounds::Default || believed == 0.0 || reach == 0.0 || symbol == "Kp" {
                return format!("{believed}");
            }
            let (lower, upper) = (rounded(believed - reach), rounded(believed + reach));
            format!("{{ value = {believed}, lower = {lower}, upper = {upper} }}")
        }));
    }
    text
}

/// By how much of itself a believed value is off.
fn off(machine: &Machine, dice: &mut Dice) -> f64 {
    machine.off * dice.sign() * dice.between(0.3, 1.0)
}

/// Whether the believed model knows a value.
pub(super) fn is_fixed(machine: &Machine, entry: &EffectEntry, symbol: &str, gains: Gains) -> bool {
    let place =
        |effect: &&dynid_model::device::DefaultEffect| effect.joint == Some(entry.joint) && effect.id == entry.id;
    let stated =
        machine.device.effects.iter().find(place).and_then(|effect| {
            effect.values.iter().find(|(own, _)| own == symbol).map(|(_, parameter)| parameter.fixed)
        });
    stated == Some(true) || (symbol == "Kp" && gains == Gains::Stated && !machine.links_are_known())
}

/// The machine as a model: what a perfect fit would find.
pub(super) fn true_model(machine: &Machine, effects: &[EffectEntry], gains: Gains) -> String {
    let mut text = format!("# The machine as it is.\ndevice = \"{}\"\n", machine.device.id);
    for number in 1..=machine.device.links.len() {
        let prefix = format!("link.{number}.");
        let own = machine.parameters.iter().filter_map(|(name, value)| Some((name.strip_prefix(&prefix)?, value)));
        let lines: String = own.map(|(symbol, value)| format!("{symbol} = {value}\n")).collect();
        if !lines.is_empty() {
            let _ = write!(text, "\n[link.{number}]\n{lines}");
        }
    }
    for entry in effects {
        text.push_str(&table_of(entry, &mut |symbol, value| {
            if !is_numerical(&entry.id, symbol) && is_fixed(machine, entry, symbol, gains) {
                format!("{{ value = {value}, fixed = true }}")
            } else {
                format!("{value}")
            }
        }));
    }
    text
}
