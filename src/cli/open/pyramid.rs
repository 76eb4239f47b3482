//! Smallest and largest value of any stretch of a series, however long, in a few steps: nothing is left out of a picture.

use std::ops::Range;

/// Entries of a level that make one of the next.
const FACTOR: usize = 16;
/// The extremes of no value.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// Extremes of ever longer pieces of a series; the values themselves are kept elsewhere.
pub struct Pyramid {
    levels: Vec<Vec<[f64; 2]>>,
}

impl Pyramid {
    pub fn of(values: &[f64]) -> Self {
        let mut levels: Vec<Vec<[f64; 2]>> = Vec::new();
        if values.len() > FACTOR {
            levels.push(values.chunks(FACTOR).map(|piece| piece.iter().fold(NOTHING, with)).collect());
        }
        while let Some(last) = levels.last().filter(|level| level.len() > FACTOR) {
            let next = last.chunks(FACTOR).map(|piece| piece.iter().fold(NOTHING, joined)).collect();
            levels.push(next);
        }
        Self { levels }
    }

    /// Smallest and largest of `values`, of which this is the pyramid, in `range`; infinite where no number lies there.
    pub fn extremes(&self, values: &[f64], range: Range<usize>) -> [f64; 2] {
        let Range { start: mut from, end: mut to } = range;
        let mut found = NOTHING;
        let mut level = 0;
        loop {
            let take = |found: [f64; 2], index: usize| match level {
                0 => with(found, &values[index]),
                above => joined(found, &self.levels[above - 1][index]),
            };
            // What does not fill an entry of the next level is taken here.
            let is_last = level == self.levels.len();
            while from < to && (is_last || !from.is_multiple_of(FACTOR)) {
                found = take(found, from);
                from += 1;
            }
            while from < to && !to.is_multiple_of(FACTOR) {
                to -= 1;
                found = take(found, to);
            }
            if from >= to {
                return found;
            }
            (from, to) = (from / FACTOR, to / FACTOR);
            level += 1;
        }
    }
}

fn with([low, high]: [f64; 2], value: &f64) -> [f64; 2] {
    // A NaN is neither.
    [low.min(*value), high.max(*value)]
}

fn joined([low, high]: [f64; 2], other: &[f64; 2]) -> [f64; 2] {
    [low.min(other[0]), high.max(other[1])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    #[test]
    fn extremes_are_those_of_all_values_in_the_range() {
        let mut random = Random::new(7);
        for length in [0, 1, 15, 16, 17, 255, 256, 257, 4097, 70_000] {
            let values: Vec<f64> = (0..length).map(|k| if k % 97 == 5 { f64::NAN } else { random.normal() }).collect();
            let pyramid = Pyramid::of(&values);
            for _ in 0..200 {
                let (a, b) = (random.between(0.0, length as f64 + 1.0), random.between(0.0, length as f64 + 1.0));
                let range = a.min(b) as usize..(a.max(b) as usize).min(length);
                let plain = values[range.start.min(range.end)..range.end].iter().filter(|value| !value.is_nan());
                let expected = [
                    plain.clone().copied().fold(f64::INFINITY, f64::min),
                    plain.copied().fold(f64::NEG_INFINITY, f64::max),
                ];
                assert_eq!(pyramid.extremes(&values, range.clone()), expected, "{range:?} of {length}");
            }
        }
    }
}
