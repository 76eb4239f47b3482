//! What the emitted C looks like. That it is right is tested where it is compiled (`crates/export/tests/c99.rs`).

use dynid_lower::c99::{Linkage, definition, number, prototype, runtime};
use dynid_lower::effect::EffectKernels;
use dynid_lower::kernel::{Argument, Function, Results};
use dynid_lower::{Input, Program};
use dynid_model::expression::Function as Call;

#[test]
fn a_law() {
    let effect = dynid_model::effect("saturation").unwrap();
    let law = EffectKernels::new(effect).unwrap().eval;
    insta::assert_snapshot!(definition("arm_law", "arm", &law, Linkage::Internal), @"
    static void arm_law(const double parameters[1], const double signals[11], const double *states, double outputs[1], double *rates)
    {
        const double limit = parameters[0];
        const double command = signals[9];
        (void)states;
        outputs[0] = arm_maximum(arm_minimum(command, limit), -limit);
        (void)rates;
    }
    ");
    let effect = dynid_model::effect("stribeck").unwrap();
    let law = EffectKernels::new(effect).unwrap().eval;
    insta::assert_snapshot!(definition("arm_law", "arm", &law, Linkage::Internal), @"
    static void arm_law(const double parameters[4], const double signals[11], const double *states, double outputs[1], double *rates)
    {
        const double Fs = parameters[0];
        const double Fc = parameters[1];
        const double vs = parameters[2];
        const double v_eps = parameters[3];
        const double dq = signals[1];
        (void)states;
        const double ratio = dq / vs;
        const double level = Fc + (Fs - Fc) * arm_exponential(-(ratio * ratio));
        outputs[0] = level * tanh(dq / v_eps);
        (void)rates;
    }
    ");
}

/// Names that are words of C or of the function's own arrays get an underscore; what is shared is computed once.
#[test]
fn names_of_c_are_kept() {
    let mut program = Program::new();
    let q = program.position(0, "rad");
    let two = program.number(2.0);
    let double = program.multiply(two, q);
    program.name(double, "double");
    let (sine, cosine) = (program.sin(double), program.cos(double));
    let square = program.multiply(sine, sine);
    let negative = program.negate(cosine);
    let quotient = program.divide(square, negative);
    let sum = program.add(quotient, square);
    program.name(sum, "tau");
    let difference = program.subtract(q, sum);
    program.output("tau[0]", sum);
    program.output("tau[1]", difference);
    let function = Function {
        name: "torque",
        title: "",
        form: String::new(),
        arguments: vec![
            Argument { name: "q", elements: vec![Input::Position(0)] },
            Argument { name: "states", elements: Vec::new() },
        ],
        results: vec![Results { name: "tau", elements: vec!["tau[0]".to_owned(), "tau[1]".to_owned()] }],
        program,
    };
    insta::assert_snapshot!(definition("arm_torque", "arm", &function, Linkage::External), @"
    void arm_torque(const double q[1], const double *states, double tau[2])
    {
        const double q0 = q[0];
        (void)states;
        const double double_ = 2.0 * q0;
        double t1, t2;
        arm_sine_cosine(double_, &t1, &t2);
        const double t3 = t1 * t1;
        const double tau_ = t3 - t3 / t2;
        tau[0] = tau_;
        tau[1] = q0 - tau_;
    }
    ");
    assert_eq!(
        prototype("arm_torque", &function),
        "void arm_torque(const double q[1], const double *states, double tau[2])"
    );
}

/// A variable that is called as a function of C would hide it from the terms that call it.
#[test]
fn functions_that_terms_call_are_kept() {
    let calls = [
        ("tan", Call::Tan),
        ("tanh", Call::Tanh),
        ("log", Call::Ln),
        ("sqrt", Call::Sqrt),
        ("fabs", Call::Abs),
        ("arm_exponential", Call::Exp),
        ("arm_sign", Call::Sign),
    ];
    for (name, call) in calls {
        let mut program = Program::new();
        let q = program.position(0, "rad");
        let two = program.number(2.0);
        let double = program.multiply(two, q);
        program.name(double, name);
        let called = program.call(call, double);
        let sum = program.add(called, double);
        program.output("tau[0]", sum);
        let function = Function {
            name: "torque",
            title: "",
            form: String::new(),
            arguments: vec![Argument { name: "q", elements: vec![Input::Position(0)] }],
            results: vec![Results { name: "tau", elements: vec!["tau[0]".to_owned()] }],
            program,
        };
        let text = definition("arm_torque", "arm", &function, Linkage::External);
        assert!(text.contains(&format!("const double {name}_ = 2.0 * q0;")), "{text}");
        assert!(text.contains(&format!("{name}({name}_) + {name}_")), "{text}");
    }
}

#[test]
fn numbers_are_those_of_c() {
    let written = [0.1, -2.0, 1e300, 5e-324, f64::INFINITY, f64::NEG_INFINITY, f64::NAN].map(number);
    assert_eq!(written, ["0.1", "-2.0", "1e300", "5e-324", "INFINITY", "-INFINITY", "NAN"]);
}

#[test]
fn helpers_have_the_prefix() {
    let text = runtime("arm");
    assert!(text.contains("static inline void arm_sine_cosine(") && !text.contains("PREFIX"));
}
