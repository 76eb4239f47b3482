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
         \"{scope}\"\nseen_as = \"the errors of one-step predictions follow {}\"\nnot_seen_as = \"an effect of the library, none of which \
         explained it\"\nsource = \"Sparse regression of one-step prediction errors; a formula that fits, not a law that is \
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use dynid_model::{Effect, Scope, device::JointKind};

    use super::{super::term::dictionary, effect_file};

    /// Units and null values included: the reader that a build uses checks them at both kinds of joints.
    #[test]
    fn every_term_makes_an_effect_file_that_is_accepted() {
        let kinds = [JointKind::Revolute; 3];
        let terms = dictionary(0, &[0, 1, 2], &kinds);
        let mut pairs = 0;
        for term in &terms {
            let label = term.label(0);
            let text = effect_file(0, &[(term.clone(), -0.25)], &label);
            assert_eq!(text.is_none(), term.others(0).len() > 1, "{label}");
            let Some(text) = text else { continue };
            let effect =
                Effect::parse(&text, Path::new("found.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert_eq!(effect.scope == Scope::Pair, !term.others(0).is_empty(), "{label}");
            pairs += usize::from(effect.scope == Scope::Pair);
        }
        assert!(pairs > 100 && terms.len() > 2 * pairs / 3, "{pairs} of {}", terms.len());
    }

    #[test]
    fn a_sum_is_what_its_terms_say() {
        let kinds = [JointKind::Revolute; 2];
        let terms = dictionary(1, &[0, 1], &kinds);
        let find = |label: &str| terms.iter().find(|term| term.label(1) == label).expect("it is tried").clone();
        let chosen = [(find("q0 * sign(dq1)"), 0.5), (find("sin(3*q1) * dq1"), -0.2), (find("load1 * t"), 0.01)];
        let text = effect_file(1, &chosen, "a sum").expect("one other joint");
        let effect = Effect::parse(&text, Path::new("found.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"));
        let (q, dq, q_from, load, t) = (0.4_f64, -0.7_f64, 0.3_f64, 1.6_f64, 12.0_f64);
        let lookup = |symbol: &str| match symbol {
            "q" => Some(q),
            "dq" => Some(dq),
            "q_from" => Some(q_from),
            "load" => Some(load),
            "t" => Some(t),
            own => effect.parameter(own).map(|parameter| parameter.initial),
        };
        let (outputs, _) = effect.evaluate(&lookup).expect("all symbols are known");
        let expected = 0.5 * q_from * (dq / 0.01).tanh() - 0.2 * (3.0 * q).sin() * dq + 0.01 * load * t;
        assert!((outputs[0] - expected).abs() < 1e-12, "{outputs:?} {expected}");
        assert_eq!(outputs[1], 0.0, "the other joint feels nothing");
        // A part of a command and a torque are no one effect.
        let mixed = [(find("command0"), 0.1), (find("dq1"), 0.1)];
        assert_eq!(effect_file(1, &mixed, "mixed"), None);
    }
}
