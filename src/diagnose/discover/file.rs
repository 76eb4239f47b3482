//! A discovered formula as an effect file.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::term::{Factor, SMOOTH, Term};

/// The text of an effect file; `None` where no effect can say it, as it needs the signals of two other joints, or is in
/// part a command and in part a torque.
pub(super) fn effect_file(own: usize, terms: &[(Term, f64)], formula: &str) -> Option<String> {
    let others: BTreeSet<usize> = terms.iter().flat_map(|(term, _)| term.others(own)).collect();
    let commands = terms.iter().filter(|(term, _)| term.is_command()).count();
    if terms.is_empty() || others.len() > 1 || (commands > 0 && commands < terms.len()) {
        return None;
    }
    let place = if commands > 0 { "place = \"actuator\"\nstage = \"coupling\"" } else { "place = \"joint\"" };
    let scope = if others.is_empty() { "joint" } else { "pair" };
    let from = others.first().map_or(String::new(), |from| format!(", with joint {from} as `from`"));
    let mut text = format!(
        "# Found by `dynid diagnose` at joint {own}{from}: {formula}\ntitle = \"Discovered: {formula}\"\n{place}\nscope = \
         \"{scope}\"\nseen_as = \"the torque residual follows {}\"\nnot_seen_as = \"an effect of the library, none of which \
         explained it\"\nsource = \"Sparse regression of the torque residual; a formula that fits, not a law that is \
         understood\"\n",
        terms.iter().map(|(term, _)| term.label(own)).collect::<Vec<String>>().join(", ")
    );
    for (index, (term, coefficient)) in terms.iter().enumerate() {
        // A fit may go far from the first guess, but not without end.
        let far = 100.0 * coefficient.abs();
        let _ = write!(
            text,
            "\n[[parameter]]\nsymbol = \"C{}\"\nunit = \"{}\"\ntitle = \"coefficient of {}\"\ninitial = {coefficient:?}\nlower = \
             {:?}\nupper = {far:?}\nnull = 0.0\norigin = \"physics\"\n",
            index + 1,
            term.coefficient_unit(),
            term.label(own),
            -far
        );
    }
    let factors: BTreeSet<Factor> = terms.iter().flat_map(|(term, _)| term.factors().iter().copied()).collect();
    let orders: BTreeSet<u32> = factors
        .iter()
        .filter_map(|factor| match factor {
            Factor::Sine(_, k) | Factor::Cosine(_, k) => Some(*k),
            _ => None,
        })
        .collect();
    for k in orders {
        let period = std::f64::consts::TAU / f64::from(k);
        let _ = write!(
            text,
            "\n[[parameter]]\nsymbol = \"period_{k}\"\nunit = \"rad\"\ntitle = \"length of one of {k} periods a turn\"\ninitial = \
             {period:?}\nlower = 1e-3\nupper = 7.0\norigin = \"numerical\"\n"
        );
    }
    if factors.iter().any(|factor| matches!(factor, Factor::Sign(_))) {
        let _ = write!(
            text,
            "\n[[parameter]]\nsymbol = \"v_eps\"\nunit = \"rad/s\"\ntitle = \"speed below which the sign is smoothed\"\ninitial = \
             {SMOOTH:?}\nlower = 1e-5\nupper = 1.0\norigin = \"numerical\"\n"
        );
    }
    let sum: Vec<String> =
        terms.iter().enumerate().map(|(index, (term, _))| format!("C{} * {}", index + 1, term.in_file(own))).collect();
    let sum = sum.join(" + ");
    if commands > 0 {
        let _ = write!(text, "\n[output]\ntorque = \"command + {sum}\"\n");
    } else {
        let _ = write!(text, "\n[output]\ntorque = \"{sum}\"\n");
        if !others.is_empty() {
            text.push_str("torque_from = \"0\"\n");
        }
    }
    Some(text)
}
