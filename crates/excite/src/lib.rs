//! Excitation signals: what to play on a robot so that its motion reveals the parameters ([`Excitation`]).
//!
//! Inputs of published experiments by name ([`Excitation::of_input`]), cosines, chirps and multisines ([`wave`]), and an
//! optimised periodic motion ([`fourier`]). For each, [`information`] predicts the standard errors of the base parameters.
//! [`between`] is an input that tells two rival models apart.

pub mod between;
pub mod fourier;
pub mod information;
pub mod wave;

use dynid_model::{NamedInput, Quantity};

/// What a robot is to do: commands of all joints at uniform times.
#[derive(Debug, Clone, PartialEq)]
pub struct Excitation {
    /// What the commands are.
    pub quantity: Quantity,
    /// Free joints, ascending.
    pub free: Vec<usize>,
    /// s
    pub time: Vec<f64>,
    /// One vector a joint of the device: torque [N*m or N] or position [rad or m]. A locked joint has no torque, or stays
    /// where it is.
    pub values: Vec<Vec<f64>>,
}

/// `0, step, 2 step, ..` up to `duration_s`, rounded to the nanosecond, so that they are short in a file.
pub fn times(duration_s: f64, sample_s: f64) -> Vec<f64> {
    let n_steps = (duration_s / sample_s * (1.0 + 1e-12)).floor() as usize;
    (0..=n_steps).map(|k| (k as f64 * sample_s * 1e9).round() / 1e9).collect()
}

impl Excitation {
    /// All joints at rest at `pose`.
    pub fn still(quantity: Quantity, free: &[usize], pose: &[f64], time: Vec<f64>) -> Self {
        let hold = |position: &f64| match quantity {
            Quantity::Torque => vec![0.0; time.len()],
            Quantity::Position => vec![*position; time.len()],
        };
        Self { quantity, free: free.to_vec(), values: pose.iter().map(hold).collect(), time }
    }

    /// An input of a published experiment; `pose` says where joints that stand still do so.
    pub fn of_input(input: &NamedInput, pose: &[f64], duration_s: f64, sample_s: f64) -> Self {
        let mut excitation = Self::still(input.quantity, &input.free, pose, times(duration_s, sample_s));
        for joint in &input.joints {
            excitation.values[joint.joint] = excitation.time.iter().map(|&t| joint.at(t)).collect();
        }
        excitation
    }

    /// Largest absolute value of each free joint.
    pub fn peaks(&self) -> Vec<f64> {
        let peak = |joint: &usize| self.values[*joint].iter().fold(0.0_f64, |peak, value| peak.max(value.abs()));
        self.free.iter().map(peak).collect()
    }

    /// The columns of a log: `t` and `tau0..` or `ref0..`, one entry a sample.
    pub fn columns(&self) -> Vec<(String, Vec<f64>)> {
        let name = match self.quantity {
            Quantity::Torque => "tau",
            Quantity::Position => "ref",
        };
        // A billionth is less than a converter resolves; adding zero takes the sign off a zero.
        let short = |values: &Vec<f64>| values.iter().map(|value| (value * 1e9).round() / 1e9 + 0.0).collect();
        let joints = self.values.iter().enumerate().map(|(joint, values)| (format!("{name}{joint}"), short(values)));
        std::iter::once(("t".to_owned(), self.time.clone())).chain(joints).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_reach_the_end() {
        assert_eq!(times(0.3, 0.1), [0.0, 0.1, 0.2, 0.3]);
        assert_eq!(times(60.0, 0.01).len(), 6001);
        assert_eq!(times(0.25, 0.1), [0.0, 0.1, 0.2]);
    }

    #[test]
    fn a_file_names_what_it_holds() {
        let mut excitation = Excitation::still(Quantity::Position, &[1], &[0.5, 0.0], times(0.1, 0.1));
        excitation.values[1] = vec![-0.0, 0.25];
        let columns = [("t", vec![0.0, 0.1]), ("ref0", vec![0.5, 0.5]), ("ref1", vec![0.0, 0.25])];
        assert_eq!(excitation.columns(), columns.map(|(name, values)| (name.to_owned(), values)));
        assert!(excitation.columns()[2].1[0].is_sign_positive());
        assert_eq!(excitation.peaks(), [0.25]);
    }
}
