//! The library as a program uses it: what the doc examples do not show.

use std::ops::ControlFlow;

use dynid::{Error, ErrorSignal, Experiment, FitProgress, FitSettings, Model};

fn tour() -> (Experiment, Model) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
    let experiment = Experiment::load(format!("{folder}/experiment.toml")).expect("the tour's");
    (experiment, Model::load(format!("{folder}/believed.toml")).expect("the tour's"))
}

/// A stop is heard whatever it answers: the beginning of a search, a first estimate, or an iteration of either error's search.
#[test]
fn a_fit_stops_when_it_is_asked_to() {
    let (experiment, model) = tour();
    let addition =
        dynid::Addition { effect: "spring_cubic".to_owned(), joint: Some(4), from: None, values: Vec::new() };
    let (with_effect, _) = dynid::add(&model, &addition).expect("it can stand there");
    let stopped = |model: &Model, error: ErrorSignal, at: fn(FitProgress<'_>) -> bool| {
        let settings = FitSettings { error: Some(error), ..FitSettings::default() };
        let mut calls = 0;
        let mut once = |progress: FitProgress<'_>| {
            calls += usize::from(at(progress));
            if at(progress) && calls == 1 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let found = dynid::fit(model, &experiment, &settings, &mut once);
        (found.expect_err("it was stopped"), calls)
    };
    let is_estimate = |progress: FitProgress<'_>| matches!(progress, FitProgress::FirstEstimate(_));
    let is_iteration = |progress: FitProgress<'_>| matches!(progress, FitProgress::Iteration(_));
    let is_search = |progress: FitProgress<'_>| matches!(progress, FitProgress::Search(_));
    for (model, at, calls) in [
        (&with_effect, is_estimate as fn(FitProgress<'_>) -> bool, 1),
        (&model, is_iteration, 1),
        (&model, is_search, 1),
    ] {
        let (error, heard) = stopped(model, ErrorSignal::Position, at);
        assert!(error.interrupted_after().is_some(), "{error}");
        assert_eq!(heard, calls, "one iteration at most follows");
    }
    let (error, _) = stopped(&model, ErrorSignal::Torque, is_iteration);
    assert!(matches!(error, Error::Stopped), "{error}");
}

#[test]
fn settings_that_do_not_go_together_and_other_devices_are_errors() {
    let (experiment, model) = tour();
    let fit = |model: &Model, settings: FitSettings| {
        let mut progress = |_: FitProgress<'_>| ControlFlow::Continue(());
        dynid::fit(model, &experiment, &settings, &mut progress).expect_err("an error")
    };
    let method = Some("isolated".to_owned());
    let error = fit(&model, FitSettings { error: Some(ErrorSignal::Torque), method, ..FitSettings::default() });
    assert!(matches!(error, Error::FitSettings(dynid::FitSettingsError::MethodOfTorque)), "{error}");
    let error = fit(&model, FitSettings { first_half: Some(0.0), ..FitSettings::default() });
    assert!(matches!(error, Error::FitSettings(dynid::FitSettingsError::FirstHalfNotPositive)), "{error}");
    let other = Model::of_device(dynid::device("planar2r").expect("a shipped device"));
    let error = fit(&other, FitSettings::default());
    assert!(matches!(&error, Error::OtherDevice { model, .. } if model == "planar2r"), "{error}");
}
