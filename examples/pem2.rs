//! Scratch.
use dynid_diagnose::missing::*;
use dynid_identify::prediction::*;
use dynid_logs::experiment::{Experiment, Role, Run};
use dynid_user_model::Model;
fn main() {
    let verbose = std::env::var("V").is_ok();
    for folder in std::env::args().skip(1) {
        let folder = std::path::PathBuf::from(folder);
        let experiment = Experiment::load(folder.join("experiment.toml")).unwrap();
        let fit: Vec<&Run> = experiment.runs.iter().filter(|r| r.role == Role::Fit).collect();
        let held_out: Vec<&Run> = experiment.runs.iter().filter(|r| r.role == Role::Validate).collect();
        let model = Model::load(folder.join("believed.toml")).unwrap();
        let truth: serde_json::Value = std::fs::read_to_string(folder.join("truth.json")).ok().and_then(|t| serde_json::from_str(&t).ok()).unwrap_or_default();
        let accepted: Vec<(String, Option<u64>, Option<u64>)> = truth["accepted"].as_array().map(|a| a.iter().map(|s| (s["effect"].as_str().unwrap().to_owned(), s["joint"].as_u64(), s["from"].as_u64())).collect()).unwrap_or_default();
        let is = |c: &dynid_diagnose::Candidate| accepted.contains(&(c.effect.clone(), c.joint.map(|j| j as u64), c.from.map(|j| j as u64)));
        let started = std::time::Instant::now();
        let work = Work { given: &model, fit, held_out, search: Settings::default(), recall: &|_| None, keep: &|_, _| (), stop: &|| false };
        let base = work.base(&model, "base").unwrap();
        let t1 = started.elapsed().as_secs_f64();
        let starts = work.starts(&base, &[]).unwrap();
        let t2 = started.elapsed().as_secs_f64();
        let rank = starts.iter().position(|s| is(&s.candidate));
        let mut firsts = std::collections::BTreeSet::new();
        let crank = rank.map(|r| { for s in &starts[..r] { firsts.insert(s.candidate.clone()); } firsts.len() });
        let found = work.best(&base, &starts, "1").unwrap();
        let t3 = started.elapsed().as_secs_f64();
        let frank = found.iter().position(|f| f.candidate.as_ref().is_some_and(&is));
        let best = found.first();
        println!("{} | base rate {:.1} w {:.1} | n {} score-rank {:?} | first {} rank {:?} gain {:.0} rate {:.2} w {:.2} held w {:.2} | {:.1}+{:.1}+{:.1} s | {}",
            folder.file_name().unwrap().to_string_lossy(), base.rate(), base.whiteness(), starts.len(), crank,
            best.map_or(String::new(), |b| b.candidate.as_ref().unwrap().to_string()), frank, best.map_or(0.0, |b| b.score() - base.score()),
            best.map_or(0.0, |b| b.rate()), best.map_or(0.0, |b| b.fit.joints.iter().map(|j| j.whiteness).fold(0.0, f64::max)), best.map_or(0.0, |b| b.whiteness()), t1, t2 - t1, t3 - t2,
            if frank == Some(0) { "right" } else if accepted.is_empty() { "-" } else { "WRONG" });
        if verbose {
            println!("   base {:?} {:?}", base.fit.rates, base.fit.joints);
            for s in starts.iter().take(15) { println!("   start {} {:.1}", s.candidate, s.promise); }
            for f in found.iter().take(8) { println!("   {} score {:.1} ({:.1} {:.1}) rate {:.2} w {:.2} it {} sub {} conv {} {:?}", f.candidate.as_ref().unwrap(), f.score() - base.score(), f.fit.log_likelihood - base.fit.log_likelihood, f.held_out.as_ref().map_or(f64::NAN, |h| h.log_likelihood) - base.held_out.as_ref().map_or(f64::NAN, |h| h.log_likelihood), f.rate(), f.whiteness(), f.fit.iterations, f.fit.substeps, f.fit.is_converged,
                f.fit.parameters.iter().filter(|p| p.name.contains(&f.candidate.as_ref().unwrap().effect)).map(|p| format!("{}={:.4}", p.name, p.value)).collect::<Vec<_>>()); }
        }
    }
}
