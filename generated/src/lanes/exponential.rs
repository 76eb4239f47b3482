//! The exponential of several numbers at once.
//!
//! `x = k ln 2 + r` with `|r| <= ln(2)/2`: the reduction subtracts k times ln 2 in two parts (Cody & Waite 1980), of
//! which the first has 41 bits, so that its product with `k` is exact. `e^r = 1 + r + r^2 P(r)` with a minimax
//! polynomial (own coefficients, by the Remez exchange in 240 bits; relative error 1.1e-17 as rounded), corrected to first
//! order for what the reduction rounded off. The factor 2^k is applied in two halves, so that results that overflow or
//! are subnormal come out as they should. No branch depends on the argument. Error: below 1 unit in the last place
//! (tested against 300-bit values).

use super::{Lanes, vector::Vector};
use crate::Scalar;

/// Beyond these the result is infinite, or rounds to 0.
const LARGEST: f64 = 710.0;
const SMALLEST: f64 = -746.0;
/// Adding and subtracting this rounds to an integer, which the low bits of the sum then hold.
const ROUND: f64 = 6755399441055744.0;
const LOG2_E: f64 = core::f64::consts::LOG2_E;
const LN_2: [f64; 2] = [0.693147180559663, 2.8235290563031577e-13];
/// `P`, lowest power first.
const POLYNOMIAL: [f64; 10] = [
    0.5000000000000011,
    0.1666666666666641,
    0.041666666666529725,
    0.008333333333494976,
    0.0013888888943759965,
    0.00019841269505773776,
    2.480149294963387e-05,
    2.7557586803895326e-06,
    2.76303062502936e-07,
    2.5000018833187374e-08,
];

/// `e^x`.
#[inline]
pub(crate) fn exp(x: f64) -> f64 {
    let [result, _] = of_lanes(Lanes::constant(x)).to_array();
    result
}

/// `e^x` of each lane.
#[inline(always)]
pub(crate) fn of_lanes<V: Vector>(x: V) -> V {
    let c = V::constant;
    // A NaN is less than nothing, so it stays. What rounds to 0 is set to 0 in the end: to compute it would pass
    // through subnormal numbers, on which processors are slow, and the bell of a friction law is there most of the time.
    let argument = x;
    let x = V::if_less(c(LARGEST), x, c(LARGEST), x);
    let x = V::if_less(x, c(SMALLEST), c(0.0), x);

    let shifted = x * c(LOG2_E) + c(ROUND);
    let k = shifted - c(ROUND);
    let high = x - k * c(LN_2[0]);
    let product = k * c(LN_2[1]);
    let r = high - product;
    let low = (high - r) - product;

    let [p0, p1, p2, p3, p4, p5, p6, p7, p8, p9] = POLYNOMIAL;
    let z = r * r;
    let z2 = z * z;
    let first = (c(p0) + r * c(p1)) + z * (c(p2) + r * c(p3));
    let second = (c(p4) + r * c(p5)) + z * (c(p6) + r * c(p7));
    let tail = first + z2 * (second + z2 * (c(p8) + r * c(p9)));
    // e^(r + low) = e^r + low e^r; 1 + r stands for the second e^r.
    let value = c(1.0) + (r + (z * tail + low * (c(1.0) + r)));

    // k + 2048 is positive; its halves become exponents of their own.
    let integer = shifted.minus_bits(V::of_bits(ROUND.to_bits().wrapping_sub(2048)));
    let half = integer.right::<1>();
    let other = integer.minus_bits(half);
    V::if_less(argument, c(SMALLEST), c(0.0), value * power_of_two(half) * power_of_two(other))
}

/// `2^(e - 1024)`
#[inline(always)]
fn power_of_two<V: Vector>(e: V) -> V {
    e.minus_bits(V::of_bits(1)).left::<52>()
}
