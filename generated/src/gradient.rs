//! Partial derivatives of `prepare`, by dual numbers: it runs once per parameter set, so that a second, symbolic
//! function of many times its length is not worth its compile time.

use crate::{Dual, wrong_length};

/// The Jacobian of `prepare` by the parameters, `M` x `P`, `W` columns at a time.
pub fn jacobian_of<const W: usize, const P: usize, const L: usize, const M: usize>(
    prepare: fn(&[Dual<W>; P], &[Dual<W>; L], &mut [Dual<W>; M]),
    parameters: &[f64],
    locked: &[f64],
    jacobian: &mut [f64],
) {
    let (Ok(parameters), Ok(locked)) = (<&[f64; P]>::try_from(parameters), <&[f64; L]>::try_from(locked)) else {
        return wrong_length();
    };
    if jacobian.len() != M * P {
        return wrong_length();
    }
    if W == 0 {
        return;
    }
    // A place beyond `W` makes a constant.
    let locked = locked.map(|angle| Dual::variable(angle, W));
    let mut prepared = [Dual::variable(0.0, W); M];
    for first in (0..P).step_by(W) {
        let mut place = 0usize;
        let seeded = parameters.map(|value| {
            let variable = Dual::variable(value, place.checked_sub(first).unwrap_or(W));
            place += 1;
            variable
        });
        prepare(&seeded, &locked, &mut prepared);
        let mut rest = &mut *jacobian;
        for value in &prepared {
            let Some((row, below)) = rest.split_at_mut_checked(P) else { return };
            for (entry, &partial) in row.iter_mut().skip(first).zip(&value.partials) {
                *entry = partial;
            }
            rest = below;
        }
    }
}
