//! Effect kernels against the formulas as `dynid_model` reads them, and their Jacobians against differences.

use dynid_generated::{EffectKernel, N_SIGNALS, Signal, effect, effects};
use dynid_model::effect::{SIGNALS, Stage};
use dynid_model::{Effect, Place, Scope};
use dynid_plant::effects::{EffectEntry, Moment, by_joint};
use dynid_plant::random::Noise;

/// Parameters, signals and states of an effect, one after another, and what comes out: outputs, then rates.
struct Point<'a> {
    kernel: &'a EffectKernel,
    values: Vec<f64>,
}

impl Point<'_> {
    fn random<'a>(kernel: &'a EffectKernel, effect: &Effect, noise: &mut Noise) -> Point<'a> {
        let mut between = |low: f64, high: f64| low + (high - low) * noise.uniform();
        let parameters = effect.parameters.iter().map(|parameter| {
            let low = if parameter.lower.is_finite() { parameter.lower } else { -2.0 };
            let high = if parameter.upper.is_finite() { parameter.upper.min(low + 2.0) } else { low + 2.0 };
            // Away from the bounds: some are where the law itself has no value.
            between(low + 0.2 * (high - low), high)
        });
        let mut values: Vec<f64> = parameters.collect();
        values.extend((0..N_SIGNALS + kernel.n_states).map(|_| between(-1.5, 1.5)));
        Point { kernel, values }
    }

    fn split(&self) -> (&[f64], &[f64], &[f64]) {
        let (parameters, rest) = self.values.split_at(self.kernel.n_parameters);
        let (signals, states) = rest.split_at(N_SIGNALS);
        (parameters, signals, states)
    }

    fn eval(&self) -> Vec<f64> {
        let (parameters, signals, states) = self.split();
        let (mut outputs, mut rates) = (vec![f64::NAN; self.kernel.n_outputs], vec![f64::NAN; self.kernel.n_states]);
        self.kernel.functions.eval(parameters, signals, states, &mut outputs, &mut rates);
        outputs.extend(rates);
        outputs
    }

    fn eval_gradient(&self) -> (Vec<f64>, Vec<f64>) {
        let (parameters, signals, states) = self.split();
        let (mut outputs, mut rates) = (vec![f64::NAN; self.kernel.n_outputs], vec![f64::NAN; self.kernel.n_states]);
        let mut jacobian = vec![f64::NAN; (outputs.len() + rates.len()) * self.values.len()];
        self.kernel.functions.eval_gradient(parameters, signals, states, &mut outputs, &mut rates, &mut jacobian);
        outputs.extend(rates);
        (outputs, jacobian)
    }

    fn shifted(&self, column: usize, by: f64) -> Vec<f64> {
        let mut values = self.values.clone();
        values[column] += by;
        Point { kernel: self.kernel, values }.eval()
    }
}

fn assert_close(left: &[f64], right: &[f64], tolerance: f64, what: &str) {
    assert_eq!(left.len(), right.len(), "{what}");
    for (left, right) in left.iter().zip(right) {
        assert!((left - right).abs() <= tolerance * (1.0 + right.abs()), "{what}: {left:e} and {right:e}");
    }
}

#[test]
fn every_effect_of_the_model_has_a_kernel() {
    let of_model: Vec<&str> = dynid_model::effects().iter().map(|effect| effect.id.as_str()).collect();
    let of_kernels: Vec<&str> = effects().iter().map(|kernel| kernel.id).collect();
    assert_eq!(of_model, of_kernels);
    assert!(effect("no such effect").is_none());
}

#[test]
fn kernels_compute_the_formulas() {
    let mut noise = Noise::new(7);
    for model in dynid_model::effects() {
        let kernel = effect(&model.id).unwrap();
        for _ in 0..1_000 {
            let point = Point::random(kernel, model, &mut noise);
            let (parameters, signals, states) = point.split();
            let value = |symbol: &str| {
                let own = model.parameters.iter().position(|parameter| parameter.symbol == symbol);
                let state = model.states.iter().position(|state| state.symbol == symbol);
                let signal = SIGNALS.iter().position(|signal| *signal == symbol);
                own.map(|place| parameters[place])
                    .or(state.map(|place| states[place]))
                    .or(signal.map(|place| signals[place]))
            };
            let (mut expected, rates) = model.evaluate(&value).unwrap();
            expected.extend(rates);
            assert_close(&point.eval(), &expected, 1e-13, &model.id);
        }
    }
}

/// What the plant's own laws give for an effect at joint 0, of a pair with joint 1; `None` where it has no such law.
fn by_the_plant(model: &Effect, point: &Point) -> Option<Vec<f64>> {
    let (parameters, signals, states) = point.split();
    let signal = |signal: Signal| signals[signal as usize];
    let entry = |id: &str, symbols: &[&str], values: &[f64]| {
        let values = symbols.iter().map(|symbol| (*symbol).to_owned()).zip(values.iter().copied()).collect();
        EffectEntry { id: id.to_owned(), joint: 0, from: Some(1), values }
    };
    let symbols: Vec<&str> = model.parameters.iter().map(|parameter| parameter.symbol.as_str()).collect();
    let mut entries = vec![entry(&model.id, &symbols, parameters)];
    let friction = signal(Signal::Friction);
    let mut dq = [signal(Signal::Dq), signal(Signal::DqFrom)];
    if model.id == "friction_bias" {
        // It adds to the friction of other laws, below the rest position of a spring.
        dq[0] = 1.0;
        entries.push(entry("viscous", &["Fv"], &[friction]));
        entries.push(entry("spring", &["Ks", "qeq"], &[0.0, signal(Signal::Qeq)]));
    }
    if model.id == "hysteresis" {
        // About the rest position of a spring.
        entries.push(entry("spring", &["Ks", "qeq"], &[0.0, signal(Signal::Qeq)]));
    }
    if model.id == "friction_load" {
        // It reads the sum of the other laws.
        entries.push(entry("viscous", &["Fv"], &[friction / dq[0]]));
    }
    let joints = by_joint(&entries, 2).ok()?;
    let q = [signal(Signal::Q), signal(Signal::QFrom)];
    let commands = [signal(Signal::Command), signal(Signal::CommandFrom)];
    let moment = |joint: usize| Moment {
        joint,
        q: &q,
        dq: &dq,
        time: signal(Signal::T),
        torque: signal(Signal::Load),
        commands: &commands,
    };
    Some(match model.place {
        Place::Actuator if model.states.is_empty() && model.stage != Some(Stage::Delay) => {
            let drive = &joints[0].drive;
            vec![drive.torque(drive.before_lag(commands[0]), &commands, q[0], 0.0)]
        }
        // The plant knows what a held command makes of a delay and a lag; it has no rates for them.
        Place::Actuator => return None,
        Place::Transmission => {
            let mut rates = vec![f64::NAN; joints[0].n_states()];
            let mut outputs = vec![joints[0].torque(&moment(0), signal(Signal::Load), states, &mut rates)];
            outputs.extend(rates);
            outputs
        }
        Place::Link if model.outputs.len() > 1 => return None,
        Place::Link => {
            vec![joints[0].rotor_inertia + joints[0].rotor_couplings.iter().map(|(_, inertia)| inertia).sum::<f64>()]
        }
        Place::Sensor => vec![joints[0].seen(q[0])],
        Place::Joint => {
            let mut rates = vec![f64::NAN; joints[0].n_states()];
            let mut outputs = vec![joints[0].load(&moment(0), states, &mut rates)];
            if model.id == "friction_bias" || model.id == "friction_load" {
                outputs[0] -= friction;
            }
            if model.scope == Scope::Pair {
                outputs.push(joints[1].load(&moment(1), &[], &mut []));
            }
            outputs.extend(rates);
            outputs
        }
    })
}

/// The plant writes its laws by hand and shares no code with the kernels.
#[test]
fn kernels_compute_the_laws_of_the_plant() {
    let mut noise = Noise::new(20);
    let mut met = Vec::new();
    for model in dynid_model::effects() {
        let kernel = effect(&model.id).unwrap();
        for _ in 0..1_000 {
            let mut point = Point::random(kernel, model, &mut noise);
            // The plant has no shaft too stiff and no gap too narrow to be simulated, so it fades none to nothing.
            for symbol in ["T_min", "gap_min"] {
                if let Some(index) = model.parameters.iter().position(|parameter| parameter.symbol == symbol) {
                    point.values[index] = model.parameters[index].lower;
                }
            }
            let Some(expected) = by_the_plant(model, &point) else { break };
            let computed = point.eval();
            assert_eq!(computed.len(), expected.len(), "{}", model.id);
            for (computed, expected) in computed.iter().zip(&expected) {
                let error = (computed - expected).abs();
                // terms of size 1 may cancel
                assert!(error <= 1e-12 * (1.0 + expected.abs()), "{}: {computed:e}, not {expected:e}", model.id);
            }
            if met.last() != Some(&model.id.as_str()) {
                met.push(&model.id);
            }
        }
    }
    let without_a_rate_to_compare = ["input_delay", "input_lag", "payload"];
    let expected: Vec<&str> = dynid_model::effects()
        .iter()
        .map(|effect| effect.id.as_str())
        .filter(|id| !without_a_rate_to_compare.contains(id))
        .collect();
    assert_eq!(met, expected);
}

#[test]
fn jacobians_are_central_differences() {
    let mut noise = Noise::new(8);
    for model in dynid_model::effects() {
        let kernel = effect(&model.id).unwrap();
        let mut checked = 0;
        for _ in 0..200 {
            let point = Point::random(kernel, model, &mut noise);
            let (values, jacobian) = point.eval_gradient();
            assert_close(&values, &point.eval(), 1e-15, &model.id);
            for column in 0..point.values.len() {
                let step = 1e-6;
                let (below, above) = (point.shifted(column, -step), point.shifted(column, step));
                for row in 0..values.len() {
                    // A step across a kink, or on a law that is too steep for it, proves nothing.
                    let curvature = (above[row] - 2.0 * values[row] + below[row]) / step;
                    let slope = jacobian[row * point.values.len() + column];
                    if curvature.abs() < 1e-3 * (1.0 + slope.abs()) {
                        let difference = (above[row] - below[row]) / (2.0 * step);
                        let error = (difference - slope).abs();
                        // What rounding of the two values does to their difference.
                        let rounding = 8.0 * f64::EPSILON * (above[row].abs() + below[row].abs()) / step;
                        let allowed = 1e-5 * (1.0 + slope.abs()) + rounding;
                        assert!(error < allowed, "{}: {slope} {difference}", model.id);
                        checked += 1;
                    }
                }
            }
        }
        assert!(checked > 1_000, "{}: only {checked} slopes were smooth enough to check", model.id);
    }
}

#[test]
fn a_slice_of_a_wrong_length_changes_nothing() {
    if cfg!(debug_assertions) {
        return;
    }
    let kernel = effect("viscous").unwrap();
    let mut outputs = [7.0];
    kernel.functions.eval(&[], &[1.0; N_SIGNALS], &[], &mut outputs, &mut []);
    assert_eq!(outputs, [7.0]);
    kernel.functions.eval(&[0.5], &[1.0; N_SIGNALS], &[], &mut outputs, &mut []);
    assert_eq!(outputs, [0.5]);
}

#[test]
fn signals_stand_in_the_order_of_the_model() {
    use Signal::*;
    let order = [Q, Dq, Ddq, T, Load, Friction, Qeq, QFrom, DqFrom, Command, CommandFrom];
    for (place, (signal, name)) in order.into_iter().zip(SIGNALS).enumerate() {
        assert_eq!(signal as usize, place);
        assert_eq!(format!("{signal:?}").to_lowercase(), name.replace('_', ""));
    }
    assert_eq!(N_SIGNALS, SIGNALS.len());
}
