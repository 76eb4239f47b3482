//! Reproducible random numbers: [`Random`] draws the same sequence from the same seed on every platform.

use std::f64::consts::TAU;

/// SplitMix64 (Steele, Lea & Flood 2014): the same seed gives the same sequence on every platform.
#[derive(Debug, Clone)]
pub struct Random {
    state: u64,
}

impl Random {
    /// The same seed gives the same sequence.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// Uniform in `0 < u < 1`.
    pub fn unit(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.state;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        ((bits >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
    }

    /// Uniform between two numbers.
    pub fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.unit()
    }

    /// Normal with mean 0 and variance 1 (Box & Muller 1958, Annals of Mathematical Statistics 29, 610-611): a radius whose
    /// square is exponential, in a direction that is uniform, of which one coordinate is taken. Logarithm and cosine are those
    /// of the `libm` crate, so that the bits are the same everywhere; the root is exact.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(self.unit())).sqrt();
        radius * libm::cos(TAU * self.unit())
    }

    /// So many numbers between two.
    pub fn vector(&mut self, length: usize, from: f64, to: f64) -> Vec<f64> {
        (0..length).map(|_| self.between(from, to)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    /// So many normal numbers of one seed.
    fn normal(n: usize) -> Vec<f64> {
        let mut random = Random::new(3);
        (0..n).map(|_| random.normal()).collect()
    }

    /// The share of `values` for which `holds`, with its distance from `expected` in standard errors of a share.
    fn surprise(values: &[f64], expected: f64, holds: impl Fn(f64) -> bool) -> f64 {
        let n = values.len() as f64;
        let share = values.iter().filter(|value| holds(**value)).count() as f64 / n;
        (share - expected) / (expected * (1.0 - expected) / n).sqrt()
    }

    #[test]
    fn moments_of_uniform_numbers() {
        let u = Random::new(3).vector(100_000, 0.0, 1.0);
        let moment = |power: i32| u.iter().map(|u| u.powi(power)).sum::<f64>() / u.len() as f64;
        // standard errors: 0.0009 both; here within five of them
        assert!((moment(1) - 0.5).abs() < 0.0046 && (moment(2) - 1.0 / 3.0).abs() < 0.0047);
    }

    /// 0, 1, 0 and 3, each within five standard errors: the root of the moment of twice the order, less the square, over n.
    #[test]
    fn moments_of_normal_numbers() {
        let z = normal(1_000_000);
        for (power, expected, variance) in [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0)] {
            let moment = z.iter().map(|z| z.powi(power)).sum::<f64>() / z.len() as f64;
            let error = (variance / z.len() as f64).sqrt();
            assert!((moment - expected).abs() < 5.0 * error, "{power}: {moment} +- {error}");
        }
        // Neighbours, which share nothing.
        let products = z.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / z.len() as f64;
        assert!(products.abs() < 5e-3, "{products}");
    }

    /// Of a million numbers some 2700 lie beyond three standard deviations and 63 beyond four: a sum of twelve uniform numbers
    /// has 2014 and 17.
    #[test]
    fn tails_are_as_heavy_as_a_normal_variables() {
        let z = normal(1_000_000);
        for sigma in [1.0, 2.0, 3.0, 4.0] {
            let share = libm::erfc(sigma / std::f64::consts::SQRT_2);
            let surprise = surprise(&z, share, |z| z.abs() > sigma);
            assert!(surprise.abs() < 4.0, "{sigma}: {surprise}");
        }
    }

    /// Kolmogorov and Smirnov: the distribution function is nowhere off by more than chance leaves in one case of a thousand.
    #[test]
    fn the_distribution_function_is_the_normal_one() {
        let mut z = normal(1_000_000);
        z.sort_by(f64::total_cmp);
        let n = z.len() as f64;
        let off = z.iter().zip(1..).map(|(z, rank)| {
            let expected = 0.5 * libm::erfc(-z / std::f64::consts::SQRT_2);
            (expected - f64::from(rank) / n).abs().max((expected - f64::from(rank - 1) / n).abs())
        });
        let largest = off.fold(0.0, f64::max);
        assert!(largest < 1.95 / n.sqrt(), "{largest}");
    }

    /// The same bits on every platform: what a seed gives is part of what is promised.
    #[test]
    fn the_first_numbers_are_these() {
        let bits: Vec<u64> = normal(4).iter().map(|z| z.to_bits()).collect();
        assert_eq!(
            bits,
            [
                13_827_321_335_619_339_498,
                4_606_168_936_718_959_108,
                13_831_215_939_830_124_813,
                4_609_574_942_869_971_024
            ]
        );
    }
}
