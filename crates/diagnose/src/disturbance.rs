//! What acts on a joint besides what its model says, as the rate tells at which its predictions are corrected.

use dynid_dynamics::simulate::Gains;
use dynid_identify::prediction::JointInnovations;
use dynid_logs::experiment::Run;
use dynid_logs::noise::noise_floor;
use dynid_user_model::Model;

use crate::missing::Fitted;

/// Standard deviation of the acceleration that disturbs a joint over that which noise of the logged torques gives it, in the run where this
/// is least; `None` where the joint's own torque goes through a state, and so does not move it at once, and where no rate or no equations
/// are known.
///
/// Innovations of standard deviation `d`, of which a gain `k` goes into the speed, are those of a joint that an acceleration of `k d / T`,
/// constant from sample to sample and white, disturbs (Kalata 1984: `k = 2 (1 - r)^2 / T` with `r = exp(-rate T)`). It is more where damping
/// or a spring forgets within a sample what acted, and noise is less than is taken for it where a torque jumps from sample to sample.
pub(super) fn over_torque_noise(fitted: &Fitted, left: &JointInnovations, runs: &[Run]) -> Option<f64> {
    let rate = *fitted.fit.rates.get(&left.joint)?;
    let of_run = |run: &Run| {
        let slot = run.free.iter().position(|free| *free == left.joint)?;
        let sample_s = run.log.sample_time();
        let disturbance = Gains::of(rate, sample_s).speed * left.deviation / sample_s;
        Some(disturbance / of_torque_noise(&fitted.model, run, slot)?.max(f64::MIN_POSITIVE))
    };
    runs.iter().filter_map(of_run).min_by(f64::total_cmp)
}

/// Standard deviation of the acceleration that noise of all logged torques gives a free joint at rest [rad/s^2 or m/s^2].
fn of_torque_noise(model: &Model, run: &Run, slot: usize) -> Option<f64> {
    let by_torque = model.accelerations_by_command(run)?.swap_remove(slot);
    let of_torque = |(by, torque): (&f64, &Vec<f64>)| (by * noise_floor(torque)).powi(2);
    let noise = by_torque.iter().zip(&run.log.tau).map(of_torque).sum::<f64>().sqrt();
    by_torque[run.free[slot]].is_normal().then_some(noise)
}
