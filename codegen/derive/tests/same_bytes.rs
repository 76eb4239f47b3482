//! Symbolica's equations against those of the arithmetic of our own. One process and one thread: Symbolica allows no more.

#[path = "../../equations/tests/robots/mod.rs"]
mod robots;

use dynid_derive::{ByAlgebra, session};
use dynid_equations::{Options, arithmetic::Arithmetic, exact::Exact, fraction::Fraction, generate};
use dynid_model::Device;

fn main() -> anyhow::Result<()> {
    let _session = session::start()?;
    large_numbers_survive();
    let shipped = dynid_model::devices();
    let mut largest = 0;
    for device in shipped {
        largest = largest.max(compared(device, usize::MAX)?.unwrap_or_default());
    }
    let mut n_random = 0;
    for device in (0..30).map(robots::random_robot) {
        n_random += usize::from(compared(&device, TIMES_LARGEST * largest)?.is_some());
    }
    anyhow::ensure!(n_random >= 25, "only {n_random} random robots are small enough");
    println!("{} devices and {n_random} random robots, the same bytes by both arithmetics", shipped.len());
    Ok(())
}

/// Algebra takes minutes over the few random robots whose equations are longer than so many times those of any shipped device.
const TIMES_LARGEST: usize = 2;

/// Bytes of a robot's equations, which both arithmetics lead to; `None` where they are more than `most`.
fn compared(device: &Device, most: usize) -> anyhow::Result<Option<usize>> {
    let own = generate::<Exact>(device, &Options::default())?;
    let bytes = own.values().map(String::len).sum();
    if bytes > most {
        return Ok(None);
    }
    let by_algebra = generate::<ByAlgebra>(device, &Options::default())?;
    anyhow::ensure!(by_algebra == own, "{}: the two arithmetics lead to other bytes", device.id);
    Ok(Some(bytes))
}

/// Symbolica's numbers have no limit; what is too large for a fraction is told as none.
fn large_numbers_survive() {
    let symbols = ByAlgebra::symbols(&["x".to_owned()]);
    let all = [(1, 3), (-5, 7), (i128::MAX, 11), (i128::MIN + 1, 1 << 90)].map(|(a, b)| Fraction::new(a, b));
    for fraction in all.into_iter().chain([Fraction::NONE]) {
        let polynomial = ByAlgebra::from_terms(&symbols, [(vec![3], fraction)]);
        let terms: Vec<(Fraction, Vec<u8>)> = polynomial.terms().map(|(own, powers)| (own, powers.to_vec())).collect();
        assert_eq!(terms, [(fraction, vec![3])]);
    }
}
