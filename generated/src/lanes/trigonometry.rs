//! Sines and cosines of several angles at once.
//!
//! `x = k pi/2 + r` with `|r| <= pi/4`: the reduction subtracts k times pi/2 in three parts (Cody & Waite 1980), of
//! which the first two have 33 bits, so that their products with `k` are exact. Sine and cosine of `r` are minimax
//! polynomials (own coefficients, by the Remez exchange in 200 bits; relative errors 3e-18 and 6e-20), corrected to
//! first order for what the reduction rounded off. Angles side by side take the same way, but where one is so
//! large that it is left to `libm`. Error: below 1 unit in the last place (tested against 200-bit values).

use super::{LANES, Lanes, vector::Vector};
use crate::Scalar;

/// Angles beyond this are left to the general reduction. A numerical choice: `k` fits 20 bits. rad
const LARGEST: f64 = 1.0e6;
const TWO_OVER_PI: f64 = core::f64::consts::FRAC_2_PI;
/// Adding and subtracting this rounds to an integer, which the low bits of the sum then hold.
const ROUND: f64 = 6755399441055744.0;
const HALF_PI: [f64; 3] = [1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21];
/// `sin r = r + r^3 * (SINE[0] + SINE[1] r^2 + ..)`
const SINE: [f64; 6] = [
    -0.16666666666666632,
    0.008333333333322418,
    -0.00019841269829812394,
    2.7557313693577104e-06,
    -2.505075838497598e-08,
    1.589681182908179e-10,
];
/// `cos r = 1 - r^2 / 2 + r^4 * (COSINE[0] + COSINE[1] r^2 + ..)`
const COSINE: [f64; 6] = [
    0.041666666666666595,
    -0.001388888888887305,
    2.4801587288846537e-05,
    -2.755731417776405e-07,
    2.0875700628463847e-09,
    -1.1358525208068056e-11,
];

/// Sines and cosines of `angles` (rad).
#[inline(always)]
pub fn sin_cos<const N: usize>(angles: [f64; N]) -> ([f64; N], [f64; N]) {
    let (mut sines, mut cosines) = ([0.0; N], [0.0; N]);
    // From the last on: an odd one out is the first, for the angle of a joint on the base is mostly not needed, and the
    // others are loaded in the pairs in which an integrator has stored them.
    let (odd, pairs) = angles.as_rchunks::<LANES>();
    let (odd_sine, sine_pairs) = sines.as_rchunks_mut::<LANES>();
    let (odd_cosine, cosine_pairs) = cosines.as_rchunks_mut::<LANES>();
    for ((angle, sine), cosine) in odd.iter().zip(odd_sine).zip(odd_cosine) {
        let (s, c) = of_lanes(Lanes::constant(*angle));
        ([*sine, _], [*cosine, _]) = (s.to_array(), c.to_array());
    }
    for ((pair, sines), cosines) in pairs.iter().zip(sine_pairs).zip(cosine_pairs) {
        let (s, c) = of_lanes(Lanes::new(*pair));
        (*sines, *cosines) = (s.to_array(), c.to_array());
    }
    (sines, cosines)
}

/// Sine and cosine of each lane (rad).
#[inline(always)]
pub(crate) fn of_lanes<V: Vector>(angle: V) -> (V, V) {
    if angle.all_within(LARGEST) { reduced(angle) } else { general(angle) }
}

/// The same of several angles, with one question to all.
#[inline(always)]
pub(crate) fn of_several<V: Vector, const N: usize>(angles: [V; N]) -> ([V; N], [V; N]) {
    let (mut sines, mut cosines) = (angles, angles);
    let mut all_within = true;
    for angle in &angles {
        all_within &= angle.all_within(LARGEST);
    }
    if all_within {
        for ((angle, sine), cosine) in angles.iter().zip(&mut sines).zip(&mut cosines) {
            (*sine, *cosine) = reduced(*angle);
        }
    } else {
        all_general(&angles, &mut sines, &mut cosines);
    }
    (sines, cosines)
}

#[cold]
fn all_general<V: Vector>(angles: &[V], sines: &mut [V], cosines: &mut [V]) {
    for ((angle, sine), cosine) in angles.iter().zip(sines).zip(cosines) {
        (*sine, *cosine) = of_lanes(*angle);
    }
}

#[inline(always)]
fn reduced<V: Vector>(angle: V) -> (V, V) {
    let c = V::constant;
    let shifted = angle * c(TWO_OVER_PI) + c(ROUND);
    let k = shifted - c(ROUND);

    let first = angle - k * c(HALF_PI[0]);
    let product = k * c(HALF_PI[1]);
    let second = first - product;
    // What the second subtraction rounded off, and the third part.
    let rest = ((first - second) - product) - k * c(HALF_PI[2]);
    let r = second + rest;
    let low = (second - r) + rest;

    let z = r * r;
    let z2 = z * z;
    let [s0, s1, s2, s3, s4, s5] = SINE;
    let odd = (c(s0) + z * c(s1)) + z2 * ((c(s2) + z * c(s3)) + z2 * (c(s4) + z * c(s5)));
    let half = c(0.5) * z;
    let near = c(1.0) - half;
    // sin(r + low) = sin r + low cos r
    let sine = r + (z * r * odd + low * near);
    let [c0, c1, c2, c3, c4, c5] = COSINE;
    let even = (c(c0) + z * c(c1)) + z2 * ((c(c2) + z * c(c3)) + z2 * (c(c4) + z * c(c5)));
    // cos(r + low) = cos r - low sin r; `(1 - near) - half` is what `near` rounded off.
    let cosine = near + (((c(1.0) - near) - half) + (z2 * even - r * low));

    // Quadrant 1: (c, -s), 2: (-s, -c), 3: (-c, s), in bits so that nothing branches.
    let bits = V::of_bits;
    let swap = bits(0).minus_bits(shifted.both(bits(1)));
    let difference = sine.either(cosine).both(swap);
    let sign_of_sine = shifted.both(bits(2)).left::<62>();
    let sign_of_cosine = shifted.plus_bits(bits(1)).both(bits(2)).left::<62>();
    (sine.either(difference).either(sign_of_sine), cosine.either(difference).either(sign_of_cosine))
}

/// A lane within the limit has the bits that it has among its like.
#[cold]
fn general<V: Vector>(angle: V) -> (V, V) {
    let (sine, cosine) = reduced(angle);
    let of = |function: fn(f64) -> f64, within: V| {
        V::if_less(V::constant(LARGEST), angle.abs(), angle.each(function), within)
    };
    (of(libm::sin, sine), of(libm::cos, cosine))
}
