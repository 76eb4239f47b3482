//! What acts on a joint besides what its model says: as far as the rate tells at which its predictions are corrected, torque that is white
//! and constant from sample to sample.

use dynid_identify::position::FitRun;
use dynid_identify::prediction::JointInnovations;
use dynid_logs::experiment::Run;
use dynid_logs::noise::noise_of_log;
use dynid_user_model::Model;

/// Standard deviation of that torque over the noise of the logged one, in the run where this is least; `None` where no logged torque
/// moves the joint at once.
///
/// An acceleration of standard deviation `a` that is constant from sample to sample has the rate of which the pole `r` solves
/// `a T^2 / n = 2 (1 - r)^2 / r`, `n` being the noise of the positions, which leaves predictions with errors `n / r` (Kalata 1984).
pub(super) fn over_noise(model: &Model, left: &JointInnovations, runs: &[Run]) -> Option<f64> {
    let of_run = |run: &Run| {
        let slot = run.free.iter().position(|free| *free == left.joint)?;
        let noise = noise_of_log(&run.log.tau[left.joint]).max(f64::MIN_POSITIVE);
        let response = response(&FitRun::of_run(model, run).ok()?, slot)?;
        let pole = (1.0 - left.correction).sqrt();
        let acceleration = 2.0 * (1.0 - pole).powi(2) * left.deviation / run.log.sample_time().powi(2);
        Some(acceleration / response / noise)
    };
    runs.iter().filter_map(of_run).min_by(f64::total_cmp)
}

/// By how much the acceleration of a free joint at rest rises with its command, from none to the largest.
fn response(run: &FitRun, slot: usize) -> Option<f64> {
    let (system, n) = (&run.system, run.system.n_free());
    let joint = system.kernel().free[slot];
    let larger = |a: &&[f64], b: &&[f64]| a[joint].abs().total_cmp(&b[joint].abs());
    let command = run.command.chunks_exact(system.n_joints()).max_by(larger)?;
    let x = system.rest(&run.position[..n]);
    let mut scratch = system.scratch();
    let mut acceleration = |command: &[f64]| {
        let mut dx = vec![0.0; x.len()];
        system.derivative(&mut scratch, 0.0, &x, command, &mut dx);
        dx[n + slot]
    };
    let mut without = command.to_vec();
    without[joint] = 0.0;
    let response = (acceleration(command) - acceleration(&without)) / command[joint];
    Some(response.abs()).filter(|response| response.is_normal())
}
