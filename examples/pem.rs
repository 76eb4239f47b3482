//! Scratch.
use dynid_identify::prediction::*;
use dynid_logs::experiment::{Experiment, Role, Run};
use dynid_user_model::Model;
fn main() {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap());
    let experiment = Experiment::load(folder.join("experiment.toml")).unwrap();
    let runs: Vec<&Run> = experiment.runs.iter().filter(|r| r.role == Role::Fit).collect();
    for name in std::env::args().skip(2) {
        let Ok(model) = Model::load(folder.join(&name)) else { continue };
        let started = std::time::Instant::now();
        let problem = PredictionProblem::of_model(&model, &|_| None, runs.iter().copied()).unwrap();
        let mut search = match Search::new(&problem, None) { Ok(s) => s, Err(e) => { println!("{name}: {e}"); continue } };
        let first = search.state().clone();
        let mut trail = Vec::new();
        search.advance(&Settings::default(), 60, &mut |c| { trail.push(c); dynid_identify::SearchControl::Continue });
        let fit = search.result().unwrap();
        println!("{name}: start sub {} rates {:?}", first.substeps, &first.search.x[first.search.x.len() - fit.rates.len()..]);
        println!("   L {:.1} it {} sub {} conv {} rates {:?} {:.1}s", fit.log_likelihood, fit.iterations, fit.substeps, fit.is_converged, fit.rates, started.elapsed().as_secs_f64());
        for j in &fit.joints { println!("   joint {} n {} s {:.3e} white {:.2}", j.joint, j.samples, j.deviation, j.whiteness); }
        println!("   {:?}", trail.iter().map(|c| c.round()).collect::<Vec<_>>());
    }
}
