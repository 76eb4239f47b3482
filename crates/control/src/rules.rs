//! A fuzzy associative memory with two inputs, and its exact equivalence with linear laws (thesis sections 5.4 and 5.5).

use super::partition::{Between, Partition};

/// `y = k1 q + k2 dq + c`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearLaw {
    /// Gain of the position.
    pub k1: f64,
    /// Gain of the velocity.
    pub k2: f64,
    /// Offset.
    pub offset: f64,
}

impl LinearLaw {
    /// The output at a position and a velocity.
    pub fn output(&self, position: f64, velocity: f64) -> f64 {
        self.k1 * position + self.k2 * velocity + self.offset
    }
}

/// A rule for every pair of a velocity's and a position's fuzzy set: "if q is A and dq is B then y is C", C a singleton.
#[derive(Debug, Clone, PartialEq)]
pub struct RuleTable {
    position: Partition,
    velocity: Partition,
    /// One row for each set of the velocity.
    outputs: Vec<f64>,
}

/// Why outputs make no rule table.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RuleTableError {
    /// Another number of outputs than of rules.
    #[error("{outputs} outputs for {velocity} x {position} rules: give one for each pair of fuzzy sets")]
    Size {
        /// How many outputs.
        outputs: usize,
        /// Sets of the velocity.
        velocity: usize,
        /// Sets of the position.
        position: usize,
    },
    /// An output that is no number.
    #[error("the output of the rule `{velocity}`, `{position}` is {output}: give a finite number")]
    NotFinite {
        /// Set of the velocity.
        velocity: String,
        /// Set of the position.
        position: String,
        /// The output.
        output: f64,
    },
}

impl RuleTable {
    /// A table from its outputs, one row for each set of the velocity.
    ///
    /// # Errors
    /// The wrong number of outputs, or one that is not finite.
    pub fn new(position: Partition, velocity: Partition, outputs: Vec<f64>) -> Result<Self, RuleTableError> {
        if outputs.len() != position.len() * velocity.len() {
            let (velocity, position) = (velocity.len(), position.len());
            return Err(RuleTableError::Size { outputs: outputs.len(), velocity, position });
        }
        if let Some(index) = outputs.iter().position(|output| !output.is_finite()) {
            let (row, column) = (index / position.len(), index % position.len());
            return Err(RuleTableError::NotFinite {
                velocity: velocity.names()[row].clone(),
                position: position.names()[column].clone(),
                output: outputs[index],
            });
        }
        Ok(Self { position, velocity, outputs })
    }

    /// Kubica's mapping (Eq. 5.3): the table that gives what a linear law gives, at every input inside the universe.
    pub fn of_linear(position: Partition, velocity: Partition, law: &LinearLaw) -> Self {
        let row = |rate: &f64| position.peaks().iter().map(|place| law.output(*place, *rate)).collect::<Vec<f64>>();
        let outputs = velocity.peaks().iter().flat_map(row).collect();
        Self { position, velocity, outputs }
    }

    /// Sets of the position.
    pub fn position(&self) -> &Partition {
        &self.position
    }

    /// Sets of the velocity.
    pub fn velocity(&self) -> &Partition {
        &self.velocity
    }

    /// Outputs, one row for each set of the velocity.
    pub fn outputs(&self) -> &[f64] {
        &self.outputs
    }

    /// The output of one rule.
    pub fn rule(&self, velocity: usize, position: usize) -> f64 {
        self.outputs[velocity * self.position.len() + position]
    }

    /// Product inference and centroid of singletons: the four rules that apply, by their memberships. The memberships of
    /// each input add up to one, so that the denominator of the centroid is one. Inputs beyond the universe count as its
    /// nearest end.
    pub fn output(&self, position: f64, velocity: f64) -> f64 {
        let Between { below: column, share: across } = self.position.between(position);
        let Between { below: row, share: down } = self.velocity.between(velocity);
        let along = |row: usize| {
            let (left, right) = (self.rule(row, column), self.rule(row, column + 1));
            left * (1.0 - across) + right * across
        };
        along(row) * (1.0 - down) + along(row + 1) * down
    }

    /// Whether the output nowhere falls as the position rises, nor as the velocity does: the wall then never pushes less
    /// for being deeper or approached faster.
    pub fn is_monotone(&self) -> bool {
        let n = self.position.len();
        let rises_across = self.outputs.chunks_exact(n).all(|row| row.windows(2).all(|pair| pair[0] <= pair[1]));
        let rises_down = self.outputs.iter().zip(&self.outputs[n..]).all(|(above, below)| above <= below);
        rises_across && rises_down
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    fn partition(random: &mut Random, count: usize) -> Partition {
        let mut peaks = vec![random.between(-2.0, -1.0)];
        for index in 1..count {
            peaks.push(peaks[index - 1] + random.between(0.01, 1.0));
        }
        Partition::new((0..count).map(|index| format!("S{index}")).collect(), peaks).expect("ascending")
    }

    /// The bar of the thesis's equivalence: 10,000 random states of random linear laws, relative to the largest output.
    #[test]
    fn the_map_of_a_linear_law_is_that_law() {
        let mut random = Random::new(51);
        let mut worst = 0.0_f64;
        for _ in 0..100 {
            let (position, velocity) = (partition(&mut random, 13), partition(&mut random, 9));
            let law = LinearLaw {
                k1: random.between(-200.0, 200.0),
                k2: random.between(-200.0, 200.0),
                offset: random.between(-50.0, 50.0),
            };
            let table = RuleTable::of_linear(position.clone(), velocity.clone(), &law);
            let largest = table.outputs().iter().fold(0.0_f64, |largest, output| largest.max(output.abs()));
            for _ in 0..100 {
                let q = random.between(position.peaks()[0], position.peaks()[12]);
                let dq = random.between(velocity.peaks()[0], velocity.peaks()[8]);
                worst = worst.max((table.output(q, dq) - law.output(q, dq)).abs() / largest);
            }
        }
        assert!(worst < 1e-12, "{worst}");
    }

    /// Eq. 5.4 drops the fourth rule: that is the centroid only where the table is additive, as a linear law's is.
    #[test]
    fn three_terms_are_enough_for_additive_tables_only() {
        let peaks = |names: [&str; 2]| Partition::new(names.map(str::to_owned).to_vec(), vec![0.0, 1.0]).expect("two");
        let three_terms = |table: &RuleTable, q: f64, dq: f64| {
            let [b0, b1, b2, b3] = [table.rule(0, 0), table.rule(1, 0), table.rule(0, 1), table.rule(1, 1)];
            let _ = b0;
            b3 + (b1 - b3) * table.position().membership(0, q) + (b2 - b3) * table.velocity().membership(0, dq)
        };
        let law = LinearLaw { k1: 3.0, k2: -2.0, offset: 1.0 };
        let additive = RuleTable::of_linear(peaks(["N", "P"]), peaks(["S", "F"]), &law);
        assert!((additive.output(0.3, 0.6) - three_terms(&additive, 0.3, 0.6)).abs() < 1e-15);
        let other = RuleTable::new(peaks(["N", "P"]), peaks(["S", "F"]), vec![1.0, 0.0, 0.0, 0.0]).expect("four");
        assert!((other.output(0.3, 0.6) - 0.28).abs() < 1e-15);
        assert!((three_terms(&other, 0.3, 0.6)).abs() < 1e-15, "the three terms know nothing of the first rule");
    }

    #[test]
    fn outputs_of_another_number_are_reported() {
        let two = || Partition::new(vec!["N".to_owned(), "P".to_owned()], vec![0.0, 1.0]).expect("two");
        let reported = |outputs: &[f64]| RuleTable::new(two(), two(), outputs.to_vec()).expect_err("wrong").to_string();
        assert!(reported(&[0.0; 3]).contains("3 outputs for 2 x 2 rules"));
        assert!(reported(&[0.0, 0.0, f64::NAN, 0.0]).contains("`P`, `N` is NaN"));
    }
}
