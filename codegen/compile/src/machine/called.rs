//! Functions that machine code calls: those of [`Scalar`].

use std::array;

use dynid_generated::Scalar;
use dynid_lower::program::Function as Call;

/// From an argument to a result.
pub(super) type Called<S> = unsafe extern "C" fn(*const S, *mut S);

/// So many angles at most are one call's: as many as a scalar type works on side by side.
pub(super) const MOST_ANGLES: usize = 2;

/// The function that computes the sines, then the cosines, of so many angles.
pub(super) fn sines_and_cosines<S: Scalar>(n: usize) -> Called<S> {
    if n == 1 { group::<S, 1> } else { group::<S, MOST_ANGLES> }
}

/// # Safety
/// `angles` are so many, `results` twice as many.
unsafe extern "C" fn group<S: Scalar, const N: usize>(angles: *const S, results: *mut S) {
    // Each by itself, for which a volatile read asks: two numbers that were stored one by one and are loaded as one vector have to
    // wait for the cache.
    // SAFETY: so many are there.
    let angles = array::from_fn(|place| unsafe { angles.add(place).read_volatile() });
    let (sines, cosines) = S::sines_cosines::<N>(angles);
    for place in 0..N {
        // SAFETY: there is place for as many sines and as many cosines.
        unsafe {
            results.add(place).write(sines[place]);
            results.add(N + place).write(cosines[place]);
        }
    }
}

/// The function of [`Scalar`]; `None` of what is no call.
pub(super) fn of<S: Scalar>(call: Call) -> Option<Called<S>> {
    Some(match call {
        Call::Tan => tan,
        Call::Tanh => tanh,
        Call::Exp => exp,
        Call::Ln => ln,
        Call::Sin | Call::Cos | Call::Sqrt | Call::Abs | Call::Sign | Call::Min | Call::Max => return None,
    })
}

macro_rules! called {
    ($($name:ident)*) => {
        $(
            /// # Safety
            /// There is an argument, and place for a result.
            unsafe extern "C" fn $name<S: Scalar>(argument: *const S, result: *mut S) {
                // SAFETY: as above.
                unsafe { result.write((*argument).$name()) }
            }
        )*
    };
}

called!(tan tanh exp ln);
