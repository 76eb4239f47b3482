//! One example a variant, to the letter.

use super::*;
use dynid_diagnose::{ActsOn, Moved, RejectedCandidate, Verdict};
use dynid_identify::FitStatus;
use dynid_judge::compare::{Finding, FindingKind, locate::Signal};
use dynid_logs::motion::MotionError;
use serde_json::json;

fn candidate(effect: &str) -> Candidate {
    Candidate { effect: effect.to_owned(), joint: Some(4), from: None }
}

#[test]
fn every_statement_is_said() {
    let near = ErrorLeft::NearNoise { times_noise: 1.024 };
    let far = ErrorLeft::AboveNoise { times_noise: 701.63 };
    let of_torque = ErrorLeft::OfTorque { percent: 10.84 };
    let leaves = |left| Statement::ModelLeaves { left };
    let missing = |left| Statement::Missing { candidate: candidate("coulomb"), left };
    let law = candidate("coulomb").law().expect("an effect of the library").title.clone();
    let most =
        Moved { parameter: "joint.5.spring.Ks".to_owned(), run: "a.csv".to_owned(), change_in_std_errors: -27.4 };
    let formula =
        |acts_on| Statement::FormulaExplains { joint: 4, acts_on, formula: "0.0078 * dq4".to_owned(), percent: 87.4 };
    for (typed, expected) in [
        (leaves(near), "Refitted, the model leaves 1.02 times the noise at the worst joint on the held-out runs."),
        (leaves(far), "Refitted, the model leaves 701.63 times the noise at the worst joint on the held-out runs."),
        (leaves(of_torque), "Refitted, the model leaves 10.8 % of the torque on the held-out runs."),
        (leaves(ErrorLeft::Unknown), "Refitted, the model leaves an error that is not known on the held-out runs."),
        (Statement::OnlyNoise, "Nothing is missing: what is left is noise."),
        (
            Statement::NearNoise,
            "Nothing is named: what is left is near the noise; it has a pattern, but no effect of the library explains it.",
        ),
        (missing(near), &format!("Missing: `coulomb` at joint 4 ({law}); with it 1.02 times the noise is left.")),
        (
            missing(far),
            &format!(
                "Missing: `coulomb` at joint 4 ({law}); with it 701.6 times the noise is left at the worst joint, so that it is not \
                 the whole answer."
            ),
        ),
        (missing(of_torque), &format!("Missing: `coulomb` at joint 4 ({law}); with it 10.8 % of the torque is left.")),
        (
            missing(ErrorLeft::Unknown),
            &format!("Missing: `coulomb` at joint 4 ({law}); with it an error that is not known is left."),
        ),
        (
            Statement::CouldAsWellBe { candidates: vec![candidate("lugre"), candidate("dahl")] },
            "It could as well be `lugre` at joint 4 or `dahl` at joint 4.",
        ),
        (Statement::MoreIsUnexplained, "Something more is left that no effect of the library explains."),
        (Statement::NoEffectExplains, "No effect of the library explains it."),
        (
            Statement::Nearest { candidate: candidate("dahl") },
            "The nearest is `dahl` at joint 4, which explains only part of it.",
        ),
        (
            Statement::HeldOutRunsDiffer,
            "The runs fitted to are explained to their noise; those held out are not, and it was not found why.",
        ),
        (
            Statement::BodyCarried { most: most.clone() },
            "No effect is missing, but a.csv is explained only with a body that the other runs do not carry: \
             joint.5.spring.Ks is 27 standard errors from nothing.",
        ),
        (
            Statement::ValuesMoved { most },
            "No effect is missing: every run by itself is explained to its noise, but not all by the same values; \
             joint.5.spring.Ks moved most (a.csv by -27 standard errors).",
        ),
        (
            formula(ActsOn::Motion),
            "A formula does, of what resists its motion at joint 4: 0.0078 * dq4. It takes away 87 % of what is above the \
             noise of one-step predictions of the held-out runs.",
        ),
        (
            formula(ActsOn::Command),
            "A formula does, of what adds to its command at joint 4: 0.0078 * dq4. It takes away 87 % of what is above the \
             noise of one-step predictions of the held-out runs.",
        ),
        (
            Statement::NoFormulaExplains,
            "Nor does any product of the measured signals that holds on the held-out runs: there is nothing worth writing.",
        ),
    ] {
        assert_eq!(statement(&typed), expected);
    }
}

#[test]
fn all_evidence_is_said_and_speaks_one_way() {
    let bic = |unknowns| Evidence::BicChanges { delta_bic: -4000.4, unknowns };
    for (typed, speaks, expected) in [
        (
            Evidence::HeldOutFalls { joint: 4, percent: 99.26 },
            Speaks::For,
            "the squared held-out error of joint 4 falls by 99.3 %",
        ),
        (bic(1.0), Speaks::For, "BIC changes by -4000 on the runs fitted to, 1 unknown included"),
        (bic(2.0), Speaks::For, "BIC changes by -4000 on the runs fitted to, 2 unknowns included"),
        (
            Evidence::LeavesNoise { times_noise: 1.0249 },
            Speaks::For,
            "what is left is 1.02 times the noise at the worst joint",
        ),
        (
            Evidence::LeavesMore { times_noise: 17.26 },
            Speaks::Against,
            "what is left is still 17.3 times the noise at the worst joint",
        ),
        (
            Evidence::NotDetermined { parameter: "joint.4.lugre.sigma1".to_owned() },
            Speaks::Against,
            "these runs do not determine joint.4.lugre.sigma1",
        ),
        (
            Evidence::NotConverged { status: FitStatus::NumericalError },
            Speaks::Against,
            "its fit did not converge (numerical error)",
        ),
    ] {
        assert_eq!((evidence(&typed).as_str(), typed.speaks()), (expected, speaks));
    }
}

#[test]
fn every_rejection_is_said() {
    assert_eq!(
        rejection(&Rejection::NotWorthItsParameters { delta_bic: 3.4 }),
        "on the runs fitted to it is not worth its parameters (BIC changes by +3)"
    );
}

#[test]
fn every_note_is_said() {
    let reason = || MotionError::Gap { file: "a.csv".to_owned(), from: 1.0, to: 2.0 };
    let gap = "no torque error: a.csv: nothing is logged from 1 s to 2 s, too long to go across; keep the part before or after it \
               (rows = [from, to])";
    let names = |count: usize| -> Vec<String> { (0..count).map(|index| format!("joint.0.p{index}")).collect() };
    let still = |parameters| Note::StandsStill { run: "a.csv".to_owned(), joint: 1, range_in_noises: 10.0, parameters };
    for (typed, expected) in [
        (
            Note::FittedWithoutTorqueError { reason: reason() },
            format!("{gap}; only simulations tell what a model of it lacks").as_str(),
        ),
        (Note::JudgedWithoutTorqueError { reason: reason() }, gap),
        (
            Note::NeverHeldOut { joints: vec![1, 2] },
            "joint 1, joint 2: free in no held-out run, so judged by the runs that are fitted to",
        ),
        (still(Vec::new()), "a.csv: joint 1 is free but stays within 10 times its noise"),
        (
            still(names(8)),
            "a.csv: joint 1 is free but stays within 10 times its noise, so it tells little of joint.0.p0, joint.0.p1, \
             joint.0.p2, joint.0.p3, joint.0.p4, joint.0.p5 and 2 more",
        ),
        (
            Note::StraightCommand { rmse_straight: Some(0.002), rmse_standing: None },
            "the logs show a command that runs straight from sample to sample, not one that stands still between them: with it \
             the refitted model leaves 0.002000 of the held-out runs instead of ?, and all that follows takes it so; say hold = \
             \"linear\" in the experiment",
        ),
        (
            Note::LinksNotDetermined { links: 1 },
            "these runs do not determine one parameter of the links by itself, only in combinations: `dynid plan` says which can \
             be identified",
        ),
        (
            Note::NotDetermined {
                parameters: names(2),
                links: 3,
                joints: vec![0],
                still: vec![0, 1],
                range_in_noises: 10.0,
            },
            "these runs do not determine joint.0.p0, joint.0.p1, nor 3 parameters of the links by themselves: joints 0, 1 stay \
             within 10 times the noise in every run; excite joint 0 more, both ways, slowly and fast, over more of the range \
             (`dynid excite`)",
        ),
        (
            Note::NotDetermined {
                parameters: vec!["base.gx".to_owned()],
                links: 0,
                joints: Vec::new(),
                still: Vec::new(),
                range_in_noises: 10.0,
            },
            "these runs do not determine base.gx: excite the joints more, both ways, slowly and fast, over more of the range \
             (`dynid excite`)",
        ),
    ] {
        assert_eq!(note(&typed), expected);
    }
}

fn sine(locked: Vec<usize>, phase: SinePhase) -> DistinguishingExperiment {
    DistinguishingExperiment::Sine {
        locked,
        joint: 4,
        amplitude: 0.5,
        unit: "N*m".to_owned(),
        frequency_hz: 0.2,
        phase,
        from: candidate("dahl"),
        times_noise: 41.7,
        duration_s: 20.0,
    }
}

#[test]
fn every_experiment_is_said() {
    let told = "at joint 4: there it differs from `dahl` at joint 4 by 42 times the noise (root mean square over 20 s)";
    assert_eq!(
        experiment(&sine(vec![0, 1], SinePhase::Zero)),
        format!("lock the joints 0, 1 and command 0.5000 N*m * sin(2 pi * 0.20 Hz * t) {told}")
    );
    assert_eq!(
        experiment(&sine(Vec::new(), SinePhase::Quarter)),
        format!("leave all joints free and command 0.5000 N*m * cos(2 pi * 0.20 Hz * t) {told}")
    );
    assert_eq!(
        experiment(&DistinguishingExperiment::NoneFound { from: candidate("dahl"), times_noise: 1.26 }),
        "none of the sines tried tells it from `dahl` at joint 4: at best they differ by 1.3 times the noise"
    );
}

fn somewhere(also_in: &[&str]) -> Place {
    let finding = Finding {
        run: "a.csv".to_owned(),
        joint: 4,
        error: Signal::Torque,
        unit: "N*m".to_owned(),
        position_unit: "rad".to_owned(),
        kind: FindingKind::LiesInBand { low_hz: 2.0, high_hz: 4.0 },
        share: 0.6,
        expected: 0.01,
        regression: None,
        twin: None,
        run_index: 0,
        rank: 0.0,
    };
    Place { finding, also_in: also_in.iter().map(|run| (*run).to_owned()).collect() }
}

#[test]
fn what_several_runs_say_is_said_once() {
    let alone = place(&somewhere(&[]));
    assert_eq!(alone, "60 % of the squared torque error lies between 2.000 and 4.000 Hz (1.0 % by chance)");
    assert_eq!(place(&somewhere(&["b.csv", "c.csv"])), format!("{alone}; likewise in b.csv, c.csv"));
}

#[test]
fn a_diagnosis_stands_in_json_as_sentences_and_typed() {
    let ranked = Ranked {
        candidate: candidate("coulomb"),
        rmse_validate_before: Some(0.1),
        rmse_validate_after: Some(2e-4),
        torque_percent_before: None,
        torque_percent_after: None,
        delta_bic: -4000.0,
        confounded_with: Vec::new(),
        parameters: Vec::new(),
        evidence: vec![Evidence::LeavesMore { times_noise: 2.5 }, Evidence::HeldOutFalls { joint: 4, percent: 99.0 }],
        experiment: Some(sine(Vec::new(), SinePhase::Zero)),
        depth: 1,
        worst_ratio_after: Some(2.5),
    };
    let alone = Ranked { experiment: None, evidence: Vec::new(), ..ranked.clone() };
    let reason = Rejection::NotWorthItsParameters { delta_bic: 2.0 };
    let diagnosis = Diagnosis {
        verdict: Verdict::MissingEffect,
        statements: vec![Statement::OnlyNoise],
        error: "position".to_owned(),
        ranking: vec![ranked.clone(), alone],
        rejected: vec![RejectedCandidate { candidate: candidate("dahl"), reason: reason.clone() }],
        screening: Vec::new(),
        places: vec![somewhere(&["b.csv"])],
        moved: Vec::new(),
        notes: vec![Note::LinksNotDetermined { links: 2 }],
        worst_ratio: None,
        discovered: None,
        base: None,
        better: None,
    };
    let json = super::json(&diagnosis).expect("plain values");
    assert_eq!(json["sentences"], json!([statement(&Statement::OnlyNoise)]));
    assert_eq!(json["statements"], json!([{ "kind": "only_noise" }]));
    assert_eq!(json["notes"], json!([note(&diagnosis.notes[0])]));
    assert_eq!(json["typed_notes"], json!([{ "kind": "links_not_determined", "links": 2 }]));
    let first = &json["ranking"][0];
    assert_eq!(first["evidence_against"], json!([evidence(&ranked.evidence[0])]));
    assert_eq!(first["evidence_for"], json!([evidence(&ranked.evidence[1])]));
    assert_eq!(first["evidence"][1], json!({ "kind": "held_out_falls", "joint": 4, "percent": 99.0 }));
    assert_eq!(first["experiment"], experiment(&sine(Vec::new(), SinePhase::Zero)));
    assert_eq!(first["typed_experiment"]["kind"], "sine");
    assert_eq!((&first["effect"], &first["joint"]), (&"coulomb".into(), &4.into()));
    assert!(json["ranking"][1]["experiment"].is_null());
    let refused = &json["refused"][0];
    assert_eq!(refused["reason"], rejection(&reason));
    let typed = json!({ "kind": "not_worth_its_parameters", "delta_bic": 2.0 });
    assert_eq!(refused["rejection"], typed);
    let place = &json["where"][0];
    assert_eq!(place["what"], super::place(&diagnosis.places[0]));
    assert_eq!((&place["run"], &place["joint"], &place["kind"]), (&"a.csv".into(), &4.into(), &"band".into()));
    assert_eq!(place["finding"], json!({ "kind": "lies_in_band", "low_hz": 2.0, "high_hz": 4.0 }));
    assert_eq!(place["also_in"], json!(["b.csv"]));
}
