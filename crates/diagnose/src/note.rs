//! What should be known of a diagnosis besides its answer. Sentences of it are made elsewhere.

use serde::Serialize;

use dynid_logs::motion::MotionError;

/// What should be known besides.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Note {
    /// No run is held out: the last of so many parts of every run is.
    LastPartHeldOut {
        /// Parts that a run is cut into.
        parts: usize,
    },
    /// A run to fit to has no torque error, so that only simulations tell what a model of it lacks.
    FittedWithoutTorqueError {
        /// Why.
        reason: MotionError,
    },
    /// A held-out run has no torque error.
    JudgedWithoutTorqueError {
        /// Why.
        reason: MotionError,
    },
    /// Joints that are free in no held-out run are judged by the runs that are fitted to.
    NeverHeldOut {
        /// The device's joint indices.
        joints: Vec<usize>,
    },
    /// A joint is free in a run but hardly moves there.
    StandsStill {
        /// The run.
        run: String,
        /// The device's joint index.
        joint: usize,
        /// Its range stays within so many times its noise.
        range_in_noises: f64,
        /// Unknown parameters of which the run therefore tells little.
        parameters: Vec<String>,
    },
    /// The logs show a command that runs straight from sample to sample, against what the experiment says.
    StraightCommand {
        /// Position error of the held-out runs with it [rad or m].
        rmse_straight: Option<f64>,
        /// The same with a command that stands still between samples.
        rmse_standing: Option<f64>,
    },
    /// The runs do not determine some parameters of links by themselves, only in combinations.
    LinksNotDetermined {
        /// How many.
        links: usize,
    },
    /// The runs leave parameters open.
    NotDetermined {
        /// Their names, but for those of links.
        parameters: Vec<String>,
        /// How many parameters of links they do not determine by themselves.
        links: usize,
        /// Joints of the parameters, which should be excited more.
        joints: Vec<usize>,
        /// Joints that hardly move in any run.
        still: Vec<usize>,
        /// The range of those stays within so many times their noise.
        range_in_noises: f64,
    },
}
