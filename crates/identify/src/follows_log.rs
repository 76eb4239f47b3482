//! Whether a simulation stays near its log.

use dynid_dynamics::{simulate, simulate::Steps};
use dynid_logs::{experiment::Run, noise::noise_of_log};
use dynid_signal::statistics::rms;
use dynid_user_model::Model;

use crate::position::{FitRun, first_state};

/// Integration steps that err by little beside the noise of a log, over a motion as it holds.
pub fn steps_beside(run: &Run) -> Steps {
    /// Share of the noise that an interval may err by: hundreds of intervals add up.
    const SHARE: f64 = 2e-3;
    /// What rounding leaves to be told.
    const LEAST: f64 = 1e-9;
    let share = |&joint: &usize| {
        let q = &run.log.q[joint];
        SHARE * noise_of_log(q) / q.iter().fold(0.0_f64, |most, q| most.max(q.abs()))
    };
    Steps::Within(run.free.iter().map(share).fold(Steps::ADAPTIVE_SHARE, f64::min).max(LEAST))
}

/// Whether a simulation of `model` from where the run begins, under its commands, shows the motion of the log, not one of
/// its own.
pub fn stays_near(model: &Model, run: &Run) -> bool {
    /// Share of the motion's spread that the error may reach: far from [`LOST`].
    const NEAR: f64 = 0.3;
    let Ok(fit_run) = FitRun::of_run(model, run) else { return false };
    let input = fit_run.input();
    let n = run.free.len();
    let start = first_state(&fit_run);
    let Ok(trajectory) = simulate::simulate(&fit_run.system, &input, &start, &simulate::Options::default()) else {
        return false;
    };
    let simulated: Vec<Vec<f64>> =
        (0..n).map(|slot| trajectory.q.iter().skip(slot).step_by(n).copied().collect()).collect();
    !strays(run, &simulated, NEAR)
}

/// Whether the simulated positions of a free joint are off its log by more than `share` of its motion. The noise of a joint
/// that stands still is no motion to compare with; one whose log does not change at all says nothing beside one that moves.
pub fn strays(run: &Run, simulated: &[Vec<f64>], share: f64) -> bool {
    /// The least motion of a joint, in standard deviations of its log's noise: as much as the noise itself shows.
    const LEAST_MOTION: f64 = 6.0;
    let changes = |joint: &usize| run.log.q[*joint].windows(2).any(|pair| pair[0] != pair[1]);
    let one_moves = run.free.iter().any(changes);
    run.free.iter().zip(simulated).filter(|(joint, _)| !one_moves || changes(joint)).any(|(&joint, simulated)| {
        let measured = &run.log.q[joint];
        let residual: Vec<f64> = measured.iter().zip(simulated).map(|(y, model)| y - model).collect();
        let mean = run.log.mean_position(joint);
        let spread: Vec<f64> = measured.iter().map(|y| y - mean).collect();
        let motion = rms(&spread).max(LEAST_MOTION * noise_of_log(measured));
        rms(&residual) > share * motion
    })
}
