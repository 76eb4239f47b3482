//! Triangular membership functions that add up to one (thesis section 5.4, step 1).

/// Fuzzy sets over one input. Set `i` has membership 1 at its peak and falls in straight lines to 0 at the peaks beside it
/// (Eq. 5.2), so that at every value at most two sets have a share, and their shares add up to one (Eq. 5.1).
#[derive(Debug, Clone, PartialEq)]
pub struct Partition {
    names: Vec<String>,
    peaks: Vec<f64>,
}

/// Why peaks make no partition.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PartitionError {
    /// Fewer than two sets.
    #[error("{count} fuzzy sets cover nothing: give at least two")]
    Few {
        /// How many.
        count: usize,
    },
    /// Another number of peaks than of names.
    #[error("{peaks} peaks for {names} fuzzy sets: give one for each")]
    Length {
        /// How many peaks.
        peaks: usize,
        /// How many names.
        names: usize,
    },
    /// A peak that does not lie above the one before, or is no number.
    #[error("the peak {peak} of `{name}` does not lie above that before it, {before}: sort the sets by their peaks")]
    Order {
        /// The set.
        name: String,
        /// Its peak.
        peak: f64,
        /// The peak before.
        before: f64,
    },
    /// Two sets of one name.
    #[error("two fuzzy sets are named `{name}`")]
    Name {
        /// The name.
        name: String,
    },
}

/// The set below a value, and the membership in the set above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Between {
    pub(super) below: usize,
    pub(super) share: f64,
}

impl Partition {
    /// Sets with these names and peaks, ascending, in the input's unit.
    ///
    /// # Errors
    /// Fewer than two sets, peaks out of order or not finite, a name twice.
    pub fn new(names: Vec<String>, peaks: Vec<f64>) -> Result<Self, PartitionError> {
        if names.len() != peaks.len() {
            return Err(PartitionError::Length { peaks: peaks.len(), names: names.len() });
        }
        if peaks.len() < 2 {
            return Err(PartitionError::Few { count: peaks.len() });
        }
        for (index, name) in names.iter().enumerate() {
            if names[..index].contains(name) {
                return Err(PartitionError::Name { name: name.clone() });
            }
            let before = if index == 0 { f64::NEG_INFINITY } else { peaks[index - 1] };
            let peak = peaks[index];
            if !(peak.is_finite() && peak > before) {
                return Err(PartitionError::Order { name: name.clone(), peak, before });
            }
        }
        Ok(Self { names, peaks })
    }

    /// Names of the sets.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Where each set has membership 1.
    pub fn peaks(&self) -> &[f64] {
        &self.peaks
    }

    /// Number of sets.
    pub fn len(&self) -> usize {
        self.peaks.len()
    }

    /// Never: a partition has at least two sets.
    pub fn is_empty(&self) -> bool {
        self.peaks.is_empty()
    }

    /// Membership of `value` in the set of that index (Eq. 5.2). Beyond the universe it is that of its nearest end.
    pub fn membership(&self, index: usize, value: f64) -> f64 {
        let Between { below, share } = self.between(value);
        if index == below {
            1.0 - share
        } else if index == below + 1 {
            share
        } else {
            0.0
        }
    }

    /// Where a value lies; a value that is no number counts as the lower end.
    pub(super) fn between(&self, value: f64) -> Between {
        let last = self.peaks.len() - 2;
        let below = self.peaks.partition_point(|peak| *peak <= value).saturating_sub(1).min(last);
        let (from, to) = (self.peaks[below], self.peaks[below + 1]);
        let share = ((value - from) / (to - from)).clamp(0.0, 1.0);
        Between { below, share: if share.is_nan() { 0.0 } else { share } }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn partition(peaks: &[f64]) -> Result<Partition, PartitionError> {
        Partition::new((0..peaks.len()).map(|index| format!("S{index}")).collect(), peaks.to_vec())
    }

    proptest! {
        #[test]
        fn memberships_add_up_to_one_and_are_two_at_most(
            mut peaks in prop::collection::btree_set(-1000_i32..1000, 2..14),
            value in -1200.0..1200.0_f64,
        ) {
            let peaks: Vec<f64> = std::mem::take(&mut peaks).into_iter().map(f64::from).collect();
            let partition = partition(&peaks).expect("ascending");
            let shares: Vec<f64> = (0..partition.len()).map(|index| partition.membership(index, value)).collect();
            prop_assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            prop_assert!(shares.iter().filter(|share| **share > 0.0).count() <= 2);
            // inside, the mean of the peaks by their shares is the value itself
            let mean: f64 = shares.iter().zip(&peaks).map(|(share, peak)| share * peak).sum();
            let inside = value.clamp(peaks[0], peaks[peaks.len() - 1]);
            prop_assert!((mean - inside).abs() < 1e-12 * 1200.0);
        }
    }

    #[test]
    fn what_is_no_partition_is_reported() {
        let reported = |peaks: &[f64]| partition(peaks).expect_err("wrong").to_string();
        assert!(reported(&[0.0, 2.0, 1.0]).contains("the peak 1 of `S2` does not lie above that before it, 2"));
        assert!(reported(&[0.0, 0.0]).contains("does not lie above"));
        assert!(reported(&[0.0, f64::NAN]).contains("does not lie above"));
        assert!(reported(&[0.0]).contains("at least two"));
        let twice = Partition::new(vec!["Z".to_owned(), "Z".to_owned()], vec![0.0, 1.0]);
        assert!(twice.expect_err("twice").to_string().contains("named `Z`"));
    }
}
