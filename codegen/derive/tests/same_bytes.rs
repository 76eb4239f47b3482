//! Symbolica's equations against those of the arithmetic of our own. One process and one thread: Symbolica allows no more.

#[path = "../../equations/tests/robots/mod.rs"]
mod robots;

use dynid_derive::{ByAlgebra, session};
use dynid_equations::{Options, arithmetic::Arithmetic, exact::Exact, fraction::Fraction, generate};

fn main() -> anyhow::Result<()> {
    let _session = session::start()?;
    large_numbers_survive();
    let random: Vec<_> = (0..30).map(robots::random_robot).collect();
    for device in dynid_model::devices().iter().chain(&random) {
        let by_algebra = generate::<ByAlgebra>(device, &Options::default())?;
        let own = generate::<Exact>(device, &Options::default())?;
        anyhow::ensure!(by_algebra == own, "{}: the two arithmetics lead to other bytes", device.id);
    }
    println!("{} devices, the same bytes by both arithmetics", dynid_model::devices().len() + random.len());
    Ok(())
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
