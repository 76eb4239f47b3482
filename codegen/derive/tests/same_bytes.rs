//! Symbolica's equations against those of the arithmetic of our own. One process and one thread: Symbolica allows no more.

#[path = "../../equations/tests/robots/mod.rs"]
mod robots;

use dynid_derive::{ByAlgebra, session};
use dynid_equations::{Options, exact::Exact, generate};

fn main() -> anyhow::Result<()> {
    let _session = session::start()?;
    let random: Vec<_> = (0..30).map(robots::random_robot).collect();
    for device in dynid_model::devices().iter().chain(&random) {
        let by_algebra = generate::<ByAlgebra>(device, &Options::default())?;
        let own = generate::<Exact>(device, &Options::default())?;
        anyhow::ensure!(by_algebra == own, "{}: the two arithmetics lead to other bytes", device.id);
    }
    println!("{} devices, the same bytes by both arithmetics", dynid_model::devices().len() + random.len());
    Ok(())
}
