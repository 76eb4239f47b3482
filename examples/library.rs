//! The loop as a program: fit a model, see where it fails, learn which effect it lacks, add it, and watch the error fall.
//!
//! `cargo run --release --example library [experiment.toml model.toml]`; without files, on the logs that the repository carries.

use std::ops::ControlFlow;

use dynid::{Addition, Candidate, Experiment, FitSettings, Model, Verdict};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let carried = |name: &str| format!("{}/src/tour/{name}", env!("CARGO_MANIFEST_DIR"));
    let mut files = std::env::args().skip(1);
    let experiment = Experiment::load(files.next().unwrap_or_else(|| carried("experiment.toml")))?;
    let believed = Model::load(files.next().unwrap_or_else(|| carried("believed.toml")))?;

    let settings = FitSettings::default();
    let fitted = dynid::fit(&believed, &experiment, &settings, &mut |_| ControlFlow::Continue(()))?.model;

    let compared = dynid::compare(&fitted, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
    for joint in compared.errors.runs.iter().flat_map(|run| &run.joints) {
        println!("joint {}: off by {:.2} times the noise", joint.joint, joint.times_noise().unwrap_or(f64::NAN));
    }

    let found = dynid::diagnose(&fitted, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
    let Some(best) = found.ranking.first().filter(|_| found.verdict == Verdict::MissingEffect) else {
        println!("no effect of the library is missing: {:?}", found.verdict);
        return Ok(());
    };
    println!("missing: {}", best.candidate);

    let Candidate { effect, joint, from } = best.candidate.clone();
    let (better, _) = dynid::add(&fitted, &Addition { effect, joint, from, values: Vec::new() })?;
    let better = dynid::fit(&better, &experiment, &settings, &mut |_| ControlFlow::Continue(()))?.model;

    let models = [("believed", believed), ("fitted", fitted), ("better", better)];
    let models = models.map(|(name, model)| (name.to_owned(), model));
    let ladder = dynid::ladder(&models, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
    for rung in &ladder.rungs {
        println!("{}: {:.2e} rad RMS on the held-out runs", rung.model, rung.rmse_validate.unwrap_or(f64::NAN));
    }
    Ok(())
}
