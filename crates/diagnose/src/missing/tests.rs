use std::collections::BTreeSet;
use std::sync::Mutex;

use dynid_logs::experiment::Role;
use dynid_random::Random;

use super::*;
use crate::fixtures::{self, Oscillator, candidate, close, start};

const STIFFNESS: f64 = 1.1;
const K3: f64 = 400.0;

/// Of the mass on its spring: two to fit to, one held out.
fn runs(cubic: f64) -> [Run; 3] {
    let plant = Oscillator { stiffness: STIFFNESS, cubic };
    [
        plant.run(&[(0.02, 1.0), (0.01, 3.7)], 12.0, (Role::Fit, 5)),
        plant.run(&[(0.03, 0.7), (0.006, 5.3)], 8.0, (Role::Fit, 6)),
        plant.run(&[(0.025, 1.3)], 6.0, (Role::Validate, 7)),
    ]
}

fn logs(given: &Model, [one, two, held_out]: [Run; 3]) -> Logs<'_> {
    Logs::new(given, vec![one, two], vec![held_out])
}

/// Up to the floor that a variance has.
fn near(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1e-6, "{found}, not {expected}");
}

#[test]
fn a_fit_to_logs_of_what_is_modelled_leaves_their_noise() {
    let model = fixtures::model(1.0, "");
    let work = logs(&model, runs(0.0));
    let base = work.base(&model, "base").expect("a fit");
    let spring = base.fit.parameters.iter().find(|own| own.name == "joint.0.spring.Ks").expect("the stiffness");
    let error = (spring.value - STIFFNESS) / spring.std_error.expect("it is fitted");
    assert!(error.abs() < 4.0, "{error}");
    assert!(base.is_whole(&work.settings) && base.is_white(&work.settings) && work.leaves_nothing(&base));
    assert_eq!((base.unknowns, base.price()), (0.0, 0.0), "nothing was added");
    let [joint] = base.fit.joints.as_slice() else { panic!("one joint") };
    assert_eq!(joint.samples, 2000.0);
    assert!((joint.deviation / fixtures::NOISE - 1.0).abs() < 0.1, "{joint:?}");
    // Gaussian errors at their own variance, and those held out at the variance of those fitted to.
    let held_out = base.held_out.as_ref().expect("the held-out run can be predicted");
    let share = held_out.joints[0].deviation / joint.deviation;
    near(base.fit.log_likelihood, -2000.0 * (joint.deviation.ln() + 0.5));
    near(held_out.log_likelihood, -600.0 * (joint.deviation.ln() + 0.5 * share * share));
    close(base.score(), base.fit.log_likelihood + held_out.log_likelihood);
    let tenths = base.by_tenths();
    assert_eq!(tenths.len(), 30);
    close(tenths[..20].iter().sum(), base.fit.log_likelihood);
    near(tenths[20..].iter().sum(), held_out.log_likelihood);
}

/// A fitted model with this effect added.
fn added(work: &Logs<'_>, base: &Fitted, effect: &str) -> Fitted {
    let mut with = base.model.clone();
    with.add_effect(effect, Some(0), None).expect("it may be there");
    work.finish(Some(&candidate(effect)), &with, (None, None), effect).expect("a fit")
}

#[test]
fn an_effect_that_is_there_explains_what_the_model_leaves() {
    let model = fixtures::model(1.0, "");
    let work = logs(&model, runs(K3));
    let base = work.base(&model, "base").expect("a fit");
    let right = added(&work, &base, "spring_cubic");
    assert!(!base.is_whole(&work.settings) && !base.is_white(&work.settings) && !work.leaves_nothing(&base));
    let stiffness = right.fit.parameters.iter().find(|own| own.name == "joint.0.spring_cubic.K3").expect("K3");
    let error = (stiffness.value - K3) / stiffness.std_error.expect("it is fitted");
    assert!(error.abs() < 4.0, "{error}");
    assert!(right.is_whole(&work.settings) && work.leaves_nothing(&right));
    assert_eq!(right.unknowns, 2.0, "K3 and q_mid");
    close(right.price(), 2000.0_f64.ln());
    // The noise that was added is all that is left to explain; it is known from the logs to a tenth.
    let short = 2000.0 * (base.fit.joints[0].deviation / fixtures::NOISE).ln();
    assert!((base.falls_short(&work.fit) - short).abs() < 200.0, "{short}");
    assert!((right.explains(&base, &work.fit) - 1.0).abs() < 0.05);
    assert_eq!(base.explains(&base, &work.fit), 0.0);
    let wrong = added(&work, &base, "coulomb");
    assert!(wrong.explains(&base, &work.fit) < 0.5 && !right.is_like(&wrong, 5.0, &work.settings));
}

/// Torque that is logged with noise leaves white errors of a model that is not trusted, and the rate says how much noise it has. A force
/// that is not logged leaves white errors, too, and the log has no such noise. The spring is soft: the mass hardly moves by itself from
/// sample to sample, as the relation of rate and noise has it.
#[test]
fn noise_of_the_torque_is_told_from_what_acts_besides() {
    let model = fixtures::model(0.02, "");
    let plant = Oscillator { stiffness: 0.022, cubic: 0.0 };
    let left = |change: &dyn Fn(usize, f64) -> f64| {
        let runs = [(Role::Fit, 5), (Role::Fit, 6), (Role::Validate, 7)];
        let changed = runs.map(|role| {
            let mut run = plant.run(&[(0.02, 1.0), (0.01, 3.7)], 12.0, role);
            for (k, tau) in run.log.tau[0].iter_mut().enumerate() {
                *tau = change(k, *tau);
            }
            run
        });
        let work = logs(&model, changed);
        let base = work.base(&model, "base").expect("a fit");
        assert!(base.is_white(&work.settings) && !base.is_whole(&work.settings), "{:?}", base.fit.joints);
        (disturbance::over_torque_noise(&base, &base.fit.joints[0], &work.fit), work.leaves_noise(&base))
    };
    let white: Vec<f64> = std::iter::repeat_with({
        let mut random = Random::new(3);
        move || random.normal()
    })
    .take(1200)
    .collect();
    let (ratio, is_noise) = left(&|k, tau| tau + 5e-4 * white[k]);
    assert!(is_noise && (ratio.expect("a torque that moves it") - 1.0).abs() < 0.2, "{ratio:?}");
    let wind = |k: usize| (k as f64 * fixtures::SAMPLE_S * 2.0).sin();
    let (ratio, is_noise) = left(&|k, tau| tau + 1e-5 * wind(k));
    // What its fourth differences show of the sines is taken for noise.
    assert!(!is_noise && ratio.expect("a torque that moves it") > 5.0, "{ratio:?}");
}

/// A motor behind a soft joint moves bristles by far more than a nudge to them: as the equations have it, so that no steps are shortened
/// for it.
#[test]
fn what_moves_bristles_is_no_reason_for_short_steps() {
    let effect = |id: &str, values: &str| format!("[[effect]]\nid = \"{id}\"\njoint = 0\n{values}\n");
    let soft = effect("joint_elasticity", "compliance = 1.5\ndamping = 2e-3\nJm = 1e-4");
    let bristles = effect("dahl", "sigma0 = 1.0\nFc = 2e-3");
    let steps = |more: &str| {
        let model = fixtures::model(1.0, more);
        let problem = PredictionProblem::of_model(&model, &|_| None, &runs(0.0)[..2]).expect("a problem");
        Search::new(&problem, None).expect("a search").state().plan.mean_steps()
    };
    let (stiff, both) = (steps(&bristles), steps(&format!("{soft}{bristles}")));
    assert!(both < 2.0 * stiff, "{both}, not {stiff}");
}

/// Without what was added, from the values with it, the fit is the one before.
#[test]
fn what_was_added_may_be_taken_out_again() {
    let model = fixtures::model(1.0, "");
    let work = logs(&model, runs(K3));
    let base = work.base(&model, "base").expect("a fit");
    let right = added(&work, &base, "spring_cubic");
    let without = work.without(&right, &[], "without").expect("a fit");
    assert!((without.score() - base.score()).abs() < 0.1, "{} {}", without.score(), base.score());
    assert_eq!(without.candidate, right.candidate, "whose step it is of");
    let with = work.without(&right, &[&candidate("spring_cubic")], "with").expect("a fit");
    assert!((with.score() - right.score()).abs() < 0.1, "{} {}", with.score(), right.score());
}

/// Asked at the fitted and the believed values, what is there or a law that contains it comes first, and promises to first order a good
/// part of what it comes to.
#[test]
fn what_is_there_promises_most() {
    let model = fixtures::model(1.0, "");
    let work = logs(&model, runs(K3));
    let base = work.base(&model, "base").expect("a fit");
    let right = added(&work, &base, "spring_cubic");
    let starts = work.starts(&base, &[], &|_| true).expect("starts");
    let most = starts.iter().max_by(|a, b| a.promise.total_cmp(&b.promise)).expect("a start");
    assert!(right.candidate.as_ref().is_some_and(|own| *own == most.candidate || most.candidate.contains(own)));
    let all = candidates(&base.model, &work.fit.iter().collect::<Vec<_>>());
    assert_eq!(work.places(&base.model), all.len());
    assert!(starts.iter().all(|start| all.contains(&start.candidate)));
    // What promises rest on is all there is, 20 s of 20.
    close(work.of_all(), 1.0);
    let gain = right.fit.log_likelihood - base.fit.log_likelihood;
    let own = starts.iter().filter(|start| Some(&start.candidate) == right.candidate.as_ref());
    let promise = own.map(|start| start.promise).fold(0.0, f64::max);
    assert!(promise > 0.5 * gain && promise < 1.1 * gain, "{promise} of {gain}");
    let shown = work.shown(&base, starts.clone(), 0.5 * promise).expect("starts");
    assert!(shown.iter().any(|start| Some(&start.candidate) == right.candidate.as_ref()));
    assert!(shown.iter().all(|start| start.promise > 0.5 * promise));
    // Whatever was promised before, what promises less in all runs is left.
    let mut praised = starts.clone();
    praised.iter_mut().for_each(|start| start.promise = 10.0 * gain);
    let of = |starts: &[Start]| starts.iter().map(|start| start.candidate.clone()).collect::<BTreeSet<_>>();
    let still = work.shown(&base, praised, 0.5 * promise).expect("starts");
    assert!(of(&still) == of(&shown) && of(&shown).len() < of(&starts).len());
    assert!(work.shown(&base, starts, 10.0 * gain).expect("starts").is_empty(), "nothing promises as much");
}

#[test]
fn the_best_of_all_fits_comes_first() {
    let model = fixtures::model(1.0, "");
    let work = logs(&model, runs(K3));
    let base = work.base(&model, "base").expect("a fit");
    let right = added(&work, &base, "spring_cubic");
    let found = work.best(&base, &work.starts(&base, &[], &|_| true).expect("starts"), "all", Some(0.0)).expect("fits");
    assert!(found[0].score() >= right.score() - 0.1, "{} {}", found[0].score(), right.score());
    assert!(found.windows(2).all(|pair| pair[0].score() >= pair[1].score()));
}

/// Laws that contain it or are contained in it begin at what it has come to.
#[test]
fn kin_of_a_law_begin_at_its_values() {
    let model = fixtures::model(1.0, "");
    let work = logs(&model, runs(K3));
    let base = work.base(&model, "base").expect("a fit");
    let friction = added(&work, &base, "stribeck");
    let own = friction.candidate.as_ref().expect("what was added");
    let kin = work.kin(&base, &friction);
    let names: BTreeMap<&str, usize> = kin.iter().fold(BTreeMap::new(), |mut names, start| {
        *names.entry(start.candidate.effect.as_str()).or_default() += 1;
        names
    });
    // A smaller law begins once; a larger one twice, as guessed and with what it adds at null.
    for start in &kin {
        let (other, times) = (&start.candidate, names[start.candidate.effect.as_str()]);
        assert!(own.contains(other) || other.contains(own), "{other}");
        assert_eq!(times, if own.contains(other) { 1 } else { 2 }, "{other}");
        let stiffness = |model: &Model| model.parameter("joint.0.spring.Ks");
        assert_eq!(stiffness(&start.model), stiffness(&friction.model), "{other}");
    }
    assert!(names.contains_key("coulomb"), "{names:?}");
    assert!(names.values().any(|times| *times == 2), "{names:?}");
    assert!(work.kin(&base, &base).is_empty(), "nothing was added");
}

#[test]
fn a_search_that_is_kept_is_not_made_again_and_one_that_is_stopped_is_not_kept() {
    let model = fixtures::model(1.0, "");
    let kept: Mutex<BTreeMap<String, State>> = Mutex::default();
    let keep = |key: &str, state: &State| {
        kept.lock().unwrap().insert(key.to_owned(), state.clone());
    };
    let work = Logs { keep: &keep, ..logs(&model, runs(0.0)) };
    let first = work.base(&model, "base").expect("a fit");
    let known = kept.lock().unwrap().clone();
    assert_eq!(known.keys().collect::<Vec<_>>(), ["base"]);
    let again = Logs { recall: &|key| known.get(key).cloned(), ..work.clone() };
    let second = again.base(&model, "base").expect("the same");
    assert_eq!(second.state.iterations + second.state.search.iterations, first.fit.iterations);
    assert_eq!(second.fit.log_likelihood.to_bits(), first.fit.log_likelihood.to_bits());

    kept.lock().unwrap().clear();
    let asked = Mutex::new(0);
    let stop = || {
        let mut asked = asked.lock().unwrap();
        *asked += 1;
        *asked > 2
    };
    let stopped = Logs { stop: &stop, ..work.clone() };
    let unfinished = stopped.base(&model, "base").expect("where it was");
    assert!(unfinished.fit.iterations < first.fit.iterations);
    assert!(kept.lock().unwrap().is_empty());
}

/// Two of the runs are 20 s together; of beginnings of 4 s each there are two and a half times as many.
#[test]
fn long_runs_are_fitted_on_their_beginnings_first() {
    let model = fixtures::model(1.0, "");
    let keys = Mutex::new(Vec::new());
    let keep = |key: &str, _: &State| keys.lock().unwrap().push(key.to_owned());
    let mut work = Logs { keep: &keep, ..logs(&model, runs(0.0)) };
    let whole = work.first_base("base").expect("a fit");
    assert_eq!(keys.lock().unwrap().split_off(0), ["base"], "they are short");
    work.settings.beginning = (8.0, 1.0);
    let lengths: Vec<usize> = work.beginnings().iter().map(|run| run.log.len()).collect();
    assert_eq!(lengths, [401, 401]);
    close(work.of_all(), 2000.0 / 802.0);
    assert_eq!(work.beginnings_of(501).iter().map(|run| run.log.len()).collect::<Vec<_>>(), [251, 251]);
    let begun = work.first_base("base").expect("a fit");
    assert_eq!(keys.lock().unwrap().split_off(0), ["base beginnings", "base"]);
    assert!((begun.score() - whole.score()).abs() < 0.1, "{} {}", begun.score(), whole.score());
    work.settings.beginning = (8.0, 7.0);
    let lengths: Vec<usize> = work.beginnings().iter().map(|run| run.log.len()).collect();
    assert_eq!(lengths, [701, 701], "at least so much of each");
}

/// A fit goes from values that are off to those of the best, and no further.
#[test]
fn what_may_be_gained_is_told_from_what_may_not() {
    let model = fixtures::model(1.0, "");
    let work = logs(&model, runs(0.0));
    let base = work.base(&model, "base").expect("a fit");
    let moved = Fitted { model: fixtures::model(1.05, ""), ..base.clone() };
    for over in [&base, &moved] {
        assert!(work.may_gain(-1.0, over).expect("a search"));
        assert!(!work.may_gain(5.0, over).expect("a search"));
    }
    // One that lies behind by 100 has them to gain: 130 in all runs, of which those fitted to are 2000 samples of 2600.
    let mut behind = base.clone();
    behind.state.cost = base.state.cost.map(|cost| cost + 100.0);
    assert!(work.may_gain(129.0, &behind).expect("a search"));
    assert!(!work.may_gain(131.0, &behind).expect("a search"));
    behind.state.cost = None;
    assert!(work.may_gain(1e9, &behind).expect("a search"), "nothing is known of it");
    assert!(Logs { stop: &|| true, ..work.clone() }.may_gain(1e9, &base).expect("a search"), "who stops asks no more");
}

/// A model whose errors are of standard deviation 1, with these squares in the tenths of one run, and of one held out.
fn with_squares(of: &Fitted, candidate: Candidate, fitted: [f64; 10], held_out: [f64; 10]) -> Fitted {
    let joint = |squares: [f64; 10]| JointInnovations {
        joint: 0,
        samples: 100.0,
        deviation: 1.0,
        whiteness: 1.0,
        correction: 0.0,
        tenths: squares.map(|squares| (10.0, squares)).into(),
    };
    let log_likelihood = |squares: [f64; 10]| -0.5 * squares.iter().sum::<f64>();
    let mut own = Fitted { candidate: Some(candidate), ..of.clone() };
    (own.fit.joints, own.fit.log_likelihood) = (vec![joint(fitted)], log_likelihood(fitted));
    own.held_out = Some(HeldOut { log_likelihood: log_likelihood(held_out), joints: vec![joint(held_out)] });
    own
}

#[test]
fn laws_are_alike_where_what_one_falls_short_by_may_be_chance() {
    let model = fixtures::model(1.0, "");
    let work = logs(&model, runs(0.0));
    let base = work.base(&model, "base").expect("a fit");
    let settings = &work.settings;
    let best = with_squares(&base, candidate("spring_cubic"), [0.0; 10], [0.0; 10]);
    // By how much the log likelihood of a part falls short, in turn: 10 in all, and of what is held out -9.
    let turns = |even: f64, odd: f64| std::array::from_fn(|part| if part % 2 == 0 { even } else { odd });
    let rival = |fitted: [f64; 10], held_out: [f64; 10]| {
        with_squares(&base, candidate("coulomb"), fitted.map(|short| 2.0 * short), held_out.map(|short| 2.0 * short))
    };
    let short = rival(turns(6.0, -4.0), turns(-5.8, 4.0));
    close(best.score() - short.score(), 1.0);
    assert!(best.is_like(&short, 0.5, settings), "they vary by more");
    // Both ways the same, 10 and 10: no chance, however they vary from part to part, unless it is less than what is asked.
    let both = rival(turns(8.0, -6.0), turns(8.0, -6.0));
    close(best.score() - both.score(), 20.0);
    assert!(!best.is_like(&both, 19.0, settings) && best.is_like(&both, 21.0, settings));
    // As much, but against each other: 40 against -20, which differ from part to part by 3, sqrt(20/19) of it.
    let against = rival([4.0; 10], [-2.0; 10]);
    close(best.score() - against.score(), 20.0);
    let deviation = (20.0 * 9.0 * 20.0 / 19.0_f64).sqrt();
    for (apart, expected) in [(21.0 / deviation, true), (19.0 / deviation, false)] {
        assert_eq!(best.is_like(&against, 5.0, &Settings { apart, ..*settings }), expected, "{apart}");
    }
    // Of laws of which one contains the other only the sum counts.
    let larger = with_squares(&base, candidate("stribeck"), [0.0; 10], [0.0; 10]);
    assert!(candidate("stribeck").contains(&candidate("coulomb")));
    assert!(!larger.is_like(&against, 19.0, settings) && larger.is_like(&against, 21.0, settings));
    assert!(!against.is_like(&larger, 19.0, settings));
    // What falls short by the price of its unknowns only is as likely by the logs; a law that contains the other always is.
    let priced = |own: &Fitted| Fitted { unknowns: own.unknowns + 3.0, ..own.clone() };
    let equal = priced(&rival(turns(0.01, -0.01), turns(-0.01, 0.01)));
    assert!(
        best.score() - equal.score() > 5.0
            && best.is_like(&equal, 5.0, settings)
            && equal.is_like(&best, 5.0, settings)
    );
    let less = priced(&rival([4.0; 10], [4.0; 10]));
    assert!(!best.is_like(&less, 5.0, settings));
    let [plain, containing] =
        ["coulomb", "stribeck"].map(|law| with_squares(&base, candidate(law), [0.0; 10], [0.0; 10]));
    assert!(!plain.is_like(&priced(&containing), 5.0, settings) && plain.is_like(&containing, 5.0, settings));
}

#[test]
fn a_second_start_of_a_candidate_stands_among_the_firsts_of_others() {
    let names: Vec<String> = (0..20).map(|k| format!("law{k}")).collect();
    let mut starts: Vec<Start> = names.iter().map(|name| start(name, 0.0, 0)).collect();
    starts.insert(1, start("law0", 0.0, 1));
    starts.insert(3, start("law0", 0.0, 2));
    let turns = in_turn(&starts);
    let of_first: Vec<(usize, usize)> = turns
        .iter()
        .enumerate()
        .filter(|(_, start)| start.candidate.effect == "law0")
        .map(|(place, start)| (place, start.probe))
        .collect();
    // Twelve places behind the first, just before law12; the third's turn would be behind all.
    assert_eq!(of_first, [(0, 0), (12, 1), (21, 2)]);
    let others: Vec<&str> =
        turns.iter().map(|start| start.candidate.effect.as_str()).filter(|name| *name != "law0").collect();
    assert_eq!(others, names[1..]);
}

#[test]
fn the_probes_are_kept_that_starts_promise_most_from() {
    let model = fixtures::model(1.0, "");
    let probe = |shape| Probe { model: model.clone(), shape: vec![shape], steps: Vec::new() };
    let own = |effect: &str, most| (candidate(effect), (0..most).map(probe).collect::<Vec<_>>());
    let mut probes = [own("coulomb", 4), own("stribeck", 2)];
    let starts = [("coulomb", 3), ("stribeck", 1), ("coulomb", 2), ("coulomb", 0)]
        .map(|(effect, probe)| start(effect, 0.0, probe));
    keep_promising(&mut probes, &starts, 2);
    let shapes = probes.map(|(_, own)| own.iter().map(|probe| probe.shape[0]).collect::<Vec<_>>());
    assert_eq!(shapes, [vec![2, 3], vec![1]]);
}
