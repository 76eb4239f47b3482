//! The numbers that kernels compute with.

use dynid_generated::{Dual, Eight, LANES, Lanes, Lanewise, Scalar, Width};

/// Angle, then sine and cosine, each as a double and what it leaves off (made by `sin_cos.py`).
fn table() -> Vec<[f64; 5]> {
    let rows = include_str!("sin_cos.csv").lines().skip(1);
    rows.map(|row| {
        let cells: Vec<f64> = row.split(',').map(|cell| cell.parse().unwrap()).collect();
        cells.try_into().unwrap()
    })
    .collect()
}

/// The distance between neighbouring doubles at `x`.
fn ulp(x: f64) -> f64 {
    let x = x.abs().max(f64::MIN_POSITIVE);
    f64::from_bits(x.to_bits() + 1) - x
}

#[test]
fn sines_and_cosines_are_within_one_unit_in_the_last_place() {
    let mut worst = 0.0f64;
    for [angle, sine, sine_rest, cosine, cosine_rest] in table() {
        let ([s], [c]) = f64::sines_cosines([angle]);
        for (computed, high, rest) in [(s, sine, sine_rest), (c, cosine, cosine_rest)] {
            let error = ((computed - high) - rest).abs() / ulp(high);
            assert!(error <= 1.0, "{angle:e}: {computed:e} is {error} units off {high:e}");
            worst = worst.max(error);
        }
    }
    assert!(worst > 0.4, "an error of {worst} units is too good to have been measured");
}

#[test]
fn sines_agree_with_the_system_on_a_dense_grid() {
    for step in -200_000..200_000 {
        let angle = f64::from(step) * 1e-4 + 1e-7;
        let ([s], [c]) = f64::sines_cosines([angle]);
        assert!((s - angle.sin()).abs() <= 1.5 * ulp(s), "{angle}");
        assert!((c - angle.cos()).abs() <= 1.5 * ulp(c), "{angle}");
    }
}

#[test]
fn what_is_no_angle_has_no_sine() {
    for angle in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let ([s, t], [c, _]) = f64::sines_cosines([angle, 0.5]);
        assert!(s.is_nan() && c.is_nan());
        assert_eq!(t, 0.5f64.sin());
    }
    let ([s], _) = f64::sines_cosines([-0.0]);
    assert!(s == 0.0);
}

#[test]
fn exponentials_are_within_one_unit_in_the_last_place() {
    let mut worst = 0.0f64;
    for row in include_str!("exp.csv").lines().skip(1) {
        let cells: Vec<f64> = row.split(',').map(|cell| cell.parse().unwrap()).collect();
        let [x, high, rest]: [f64; 3] = cells.try_into().unwrap();
        let computed = Scalar::exp(x);
        let error = ((computed - high) - rest).abs() / ulp(high);
        assert!(error <= 1.0, "{x:e}: {computed:e} is {error} units off {high:e}");
        worst = worst.max(error);
    }
    assert!(worst > 0.4, "an error of {worst} units is too good to have been measured");
}

#[test]
fn exponentials_agree_with_the_system_on_a_dense_grid() {
    for step in -372_000..354_800 {
        let x = f64::from(step) * 2e-3 + 1e-7;
        let computed = Scalar::exp(x);
        assert!((computed - x.exp()).abs() <= 1.5 * ulp(x.exp()), "{x}");
    }
}

#[test]
fn exponentials_end_as_they_should() {
    assert_eq!(Scalar::exp(0.0), 1.0);
    assert_eq!(Scalar::exp(-0.0), 1.0);
    for (x, result) in [
        (f64::INFINITY, f64::INFINITY),
        (1e300, f64::INFINITY),
        (709.783, f64::INFINITY),
        (f64::NEG_INFINITY, 0.0),
        (-1e300, 0.0),
        (-746.0, 0.0),
        (-745.2, 0.0),
        (-745.13, f64::from_bits(1)),
    ] {
        assert_eq!(Scalar::exp(x), result, "{x:e}");
    }
    assert!(Scalar::exp(f64::NAN).is_nan());
    // Each lane for itself.
    let [a, b] = Scalar::exp(Lanes::new([f64::NAN, 1.0])).to_array();
    assert!(a.is_nan() && b == Scalar::exp(1.0));
}

/// A function that uses every operation of `Scalar`, smooth around the points below.
fn everything<S: Scalar>(x: S, y: S) -> S {
    let one = S::constant(1.0);
    let ([s, t], [c, _]) = S::sines_cosines([x, x * y]);
    let smooth = s * c + t / (one + y * y) - (-x).exp() + (one + x * x).ln() + (one + y * y).sqrt();
    let kinked = x.abs() * y.sign() + x.minimum(y) + (x * x).maximum(y) + S::if_less(x, y, x * y, y);
    smooth + kinked + x.tan() * y.tanh()
}

#[test]
fn lanes_compute_what_numbers_do() {
    for (x, y) in [([0.3, -0.8], [-0.5, 0.4]), ([1.2, -0.1], [0.9, -1.1]), ([1e7, -0.0], [-2e6, 0.0])] {
        let together = everything(Lanes::new(x), Lanes::new(y)).to_array();
        for lane in 0..LANES {
            assert_eq!(together[lane].to_bits(), everything(x[lane], y[lane]).to_bits());
        }
    }
}

#[test]
fn dual_numbers_carry_central_differences() {
    for (x, y) in [(0.3, -0.5), (-0.8, 0.4), (1.2, 0.9), (-0.1, -1.1)] {
        let dual = everything(Dual::<2>::variable(x, 0), Dual::variable(y, 1));
        assert_eq!(dual.value, everything(x, y));
        let step = 1e-6;
        let by_x = (everything(x + step, y) - everything(x - step, y)) / (2.0 * step);
        let by_y = (everything(x, y + step) - everything(x, y - step)) / (2.0 * step);
        assert!((dual.partials[0] - by_x).abs() < 1e-8, "{x} {y}: {} {by_x}", dual.partials[0]);
        assert!((dual.partials[1] - by_y).abs() < 1e-8, "{x} {y}: {} {by_y}", dual.partials[1]);
    }
}

/// Every function of a scalar.
struct Functions;

impl Lanewise<2, 18> for Functions {
    fn of<S: Scalar>(&self, [a, b]: &[S; 2]) -> [S; 18] {
        let (a, b) = (*a, *b);
        let ([sine, other], [cosine, _]) = S::sines_cosines([a, b]);
        [
            a + b,
            a - b,
            a * b,
            a / b,
            -a,
            S::constant(0.1),
            sine,
            other,
            cosine,
            a.tan(),
            a.tanh(),
            a.exp(),
            a.ln(),
            a.sqrt(),
            a.abs(),
            a.sign(),
            a.minimum(b),
            a.maximum(b),
        ]
    }
}

#[test]
fn registers_of_any_width_compute_what_a_number_alone_does() {
    let special = [0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 1e300, -3e-310, 720.0, -800.0, 5e6];
    let ordinary = (0..300).map(|step| 1.7f64.powi(step % 40 - 20) * if step % 3 == 0 { -1.0 } else { 1.0 });
    let numbers: Vec<f64> = special.into_iter().chain(ordinary).collect();
    let eight = |from: usize| -> Eight { std::array::from_fn(|lane| numbers[(from + lane) % numbers.len()]) };
    // Miri takes a thousand times as long.
    let apart = if cfg!(miri) { 7 } else { 1 };
    for (first, second) in
        (0..numbers.len()).step_by(apart).flat_map(|first| [1, 7, 100].map(|apart| (first, first + apart)))
    {
        let given = [eight(first), eight(second)];
        for width in Width::all() {
            let mut results = [[0.0; 8]; 18];
            width.of_eight(&Functions, &given, &mut results);
            for lane in 0..8 {
                for (result, alone) in results.iter().zip(Functions.of(&given.map(|row| row[lane]))) {
                    let is_same =
                        result[lane].to_bits() == alone.to_bits() || (result[lane].is_nan() && alone.is_nan());
                    assert!(is_same, "{width:?}, lane {lane} of {given:?}: {} for {alone}", result[lane]);
                }
            }
        }
    }
}
