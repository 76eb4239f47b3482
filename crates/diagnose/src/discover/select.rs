//! Which few of many columns explain a signal: by normal equations, from which the own parameters are taken out first.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Sums of products over some rows: own parameters, candidate columns and the signal itself. They add.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    /// Own by own.
    pub(super) own: DMatrix<f64>,
    /// Own by candidates.
    pub(super) mixed: DMatrix<f64>,
    /// Candidates by candidates.
    pub(super) candidates: DMatrix<f64>,
    /// Own by signal.
    pub(super) own_signal: DVector<f64>,
    /// Candidates by signal.
    pub(super) signal: DVector<f64>,
    /// Signal by signal.
    pub(super) squares: f64,
}

impl Normal {
    pub(super) fn zero(own: usize, candidates: usize) -> Self {
        Self {
            own: DMatrix::zeros(own, own),
            mixed: DMatrix::zeros(own, candidates),
            candidates: DMatrix::zeros(candidates, candidates),
            own_signal: DVector::zeros(own),
            signal: DVector::zeros(candidates),
            squares: 0.0,
        }
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.own += &other.own;
        self.mixed += &other.mixed;
        self.candidates += &other.candidates;
        self.own_signal += &other.own_signal;
        self.signal += &other.signal;
        self.squares += other.squares;
    }

    /// With the own parameters taken out (Schur complement); `prior` is added to their diagonal. `None` where they cannot
    /// be.
    pub(super) fn reduced(&self, prior: &[f64]) -> Option<Reduced> {
        let information = regular(&self.own, prior)?;
        let taken = information.solve(&self.mixed);
        let gram = &self.candidates - self.mixed.tr_mul(&taken);
        let signal = &self.signal - taken.tr_mul(&self.own_signal);
        let squares = self.squares - self.own_signal.dot(&information.solve(&self.own_signal));
        let whole = self.candidates.diagonal();
        Some(Reduced { gram, signal, squares: squares.max(f64::MIN_POSITIVE), whole })
    }

    /// The own parameters' steps when the candidates of `chosen` have these coefficients.
    pub(super) fn own_steps(&self, prior: &[f64], chosen: &[usize], coefficients: &[f64]) -> Option<DVector<f64>> {
        let mut right = self.own_signal.clone();
        for (index, coefficient) in chosen.iter().zip(coefficients) {
            right -= self.mixed.column(*index) * *coefficient;
        }
        Some(regular(&self.own, prior)?.solve(&right))
    }
}

/// The information of the own parameters, with what is known of them beforehand.
pub(super) fn regular(own: &DMatrix<f64>, prior: &[f64]) -> Option<Cholesky<f64, Dyn>> {
    /// Smaller than this share of the largest is rounding.
    const ROUNDING: f64 = 1e-13;
    let mut information = own.clone();
    let largest = information.diagonal().iter().copied().fold(0.0, f64::max);
    for (index, prior) in prior.iter().enumerate() {
        information[(index, index)] += prior.max(ROUNDING * largest).max(f64::MIN_POSITIVE);
    }
    Cholesky::new(information)
}

/// Normal equations of the candidates alone.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    gram: DMatrix<f64>,
    signal: DVector<f64>,
    pub(super) squares: f64,
    whole: DVector<f64>,
}

/// What is chosen and what it leaves.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    /// Candidates, in the order of their choice.
    pub(super) chosen: Vec<usize>,
    /// `n ln(after / before)` and what the terms cost: below 0 they are worth it.
    pub(super) score: f64,
}

/// What a choice is judged by.
pub(super) struct Rules<'a> {
    /// Independent samples.
    pub(super) independent: f64,
    /// How much each candidate asks one to believe, in factors.
    pub(super) complexity: &'a [f64],
    /// Whether these may stand in one formula.
    pub(super) may_join: &'a dyn Fn(&[usize]) -> bool,
    /// At most so many terms.
    pub(super) most: usize,
}

/// Terms whose squared correlation is above this are one.
const ALIKE: f64 = 0.8;
/// What a factor must gain beyond its coefficient.
const PER_FACTOR: f64 = 4.0;
/// Less gain is chance.
const LEAST: f64 = 6.0;
/// A further term must explain this share of what all of them do: what is left besides may be what the linearisation leaves.
const PART: f64 = 0.1;
/// A candidate of which the own parameters leave less than this share of the squares is theirs.
pub(super) const OWN: f64 = 1e-4;

impl Reduced {
    /// Whether anything is left of a candidate once the own parameters have taken their part.
    pub(super) fn is_new(&self, index: usize) -> bool {
        self.gram[(index, index)] > OWN * self.whole[index] && self.whole[index] > 0.0
    }

    /// Squared correlation of two candidates, the own parameters taken out.
    pub(super) fn likeness(&self, one: usize, two: usize) -> f64 {
        let product = self.gram[(one, one)] * self.gram[(two, two)];
        if product > 0.0 { self.gram[(one, two)].powi(2) / product } else { 0.0 }
    }

    /// Whether a choice has a term of a formula, or one that is one with it; or says the formula, and most of what that term adds to it,
    /// with others: as a sine says a line with an offset, where little of its period is seen.
    pub(super) fn stands_for(&self, choice: &[usize], term: usize, formula: &[usize]) -> bool {
        /// Share of what a formula loses without a term that may be lost of it.
        const LOST: f64 = 0.5;
        if choice.iter().any(|own| self.likeness(*own, term) >= ALIKE) {
            return true;
        }
        let rest: Vec<usize> = formula.iter().copied().filter(|own| *own != term).collect();
        let lost = |others: &[usize]| self.said_by(others, formula).map(|share| 1.0 - share);
        let both = lost(choice).zip(lost(&rest));
        both.is_some_and(|(lost, without)| lost <= (1.0 - ALIKE).min(LOST * without))
    }

    /// Which share of the squares of what a formula says other candidates can say, with coefficients of their own.
    fn said_by(&self, others: &[usize], formula: &[usize]) -> Option<f64> {
        if others.is_empty() {
            return Some(0.0);
        }
        let (coefficients, ..) = self.solve(formula)?;
        let said = |index: usize| -> f64 {
            formula.iter().zip(&coefficients).map(|(own, by)| self.gram[(index, *own)] * by).sum()
        };
        let squares: f64 = formula.iter().zip(&coefficients).map(|(own, by)| said(*own) * by).sum();
        let signal = DVector::from_iterator(self.signal.len(), (0..self.signal.len()).map(said));
        let (.., left) = Self { signal, squares, ..self.clone() }.solve(others)?;
        Some(1.0 - left / squares)
    }

    /// Coefficients of these candidates, the inverse of their information, and the squares that they leave.
    pub(super) fn solve(&self, chosen: &[usize]) -> Option<(Vec<f64>, DMatrix<f64>, f64)> {
        let n = chosen.len();
        // In units of each column, so that no unit is small.
        let sizes: Vec<f64> = chosen.iter().map(|&index| self.gram[(index, index)].sqrt()).collect();
        if sizes.iter().any(|size| size.is_nan() || *size <= 0.0) {
            return None;
        }
        let gram = DMatrix::from_fn(n, n, |a, b| self.gram[(chosen[a], chosen[b])] / sizes[a] / sizes[b]);
        let right = DVector::from_fn(n, |a, _| self.signal[chosen[a]] / sizes[a]);
        let information = Cholesky::new(gram)?;
        // Columns that are nearly one another's sum have coefficients that mean nothing.
        if information.l_dirty().diagonal().iter().any(|pivot| pivot * pivot < 1e-3) {
            return None;
        }
        let amounts = information.solve(&right);
        let left = (self.squares - amounts.dot(&right)).max(1e-12 * self.squares);
        let mut inverse = information.inverse();
        for a in 0..n {
            for b in 0..n {
                inverse[(a, b)] /= sizes[a] * sizes[b];
            }
        }
        Some((amounts.iter().zip(&sizes).map(|(amount, size)| amount / size).collect(), inverse, left))
    }

    /// Squares that these candidates leave.
    fn left(&self, chosen: &[usize]) -> Option<f64> {
        if chosen.is_empty() { Some(self.squares) } else { self.solve(chosen).map(|(.., left)| left) }
    }

    fn score(&self, chosen: &[usize], rules: &Rules<'_>) -> Option<f64> {
        if chosen.is_empty() {
            return Some(0.0);
        }
        let left = self.left(chosen)?;
        let cost: f64 = chosen
            .iter()
            .map(|&index| rules.independent.max(2.0).ln() + PER_FACTOR * (rules.complexity[index] - 1.0))
            .sum();
        Some(rules.independent * (left / self.squares).ln() + cost)
    }

    /// Forward selection with exchanges: each step adds the candidate that scores best (of two, all pairs are tried), then tries
    /// every exchange of one and every removal, until nothing is gained.
    pub(super) fn select(&self, rules: &Rules<'_>) -> Choice {
        let usable: Vec<usize> = (0..self.signal.len()).filter(|&index| self.is_new(index)).collect();
        let mut best = Choice { chosen: Vec::new(), score: 0.0 };
        while best.chosen.len() < rules.most {
            let longer = usable.iter().filter(|index| !best.chosen.contains(index)).filter_map(|&index| {
                let mut chosen = best.chosen.clone();
                chosen.push(index);
                self.judged(chosen, rules)
            });
            let mut next = longer.min_by(|a, b| a.score.total_cmp(&b.score));
            if best.chosen.len() == 1 {
                // The best two need not hold the best one: an offset of a signal asks for both terms of it.
                let pairs = usable.iter().enumerate().flat_map(|(place, &one)| {
                    usable[place + 1..].iter().filter_map(move |&two| self.judged(vec![one, two], rules))
                });
                next = next.into_iter().chain(pairs).min_by(|a, b| a.score.total_cmp(&b.score));
            }
            let Some(next) = next else { break };
            let next = self.exchanged(next, &usable, rules);
            let is_part = || {
                let (before, after) = (self.left(&best.chosen)?, self.left(&next.chosen)?);
                Some(before - after >= PART * (self.squares - after))
            };
            if next.score > best.score - LEAST || is_part() != Some(true) {
                break;
            }
            best = next;
        }
        best
    }

    fn judged(&self, chosen: Vec<usize>, rules: &Rules<'_>) -> Option<Choice> {
        if !(rules.may_join)(&chosen) {
            return None;
        }
        let score = self.score(&chosen, rules)?;
        Some(Choice { chosen, score })
    }

    fn exchanged(&self, mut best: Choice, usable: &[usize], rules: &Rules<'_>) -> Choice {
        /// Rounds of exchanges; more than a few are never needed.
        const ROUNDS: usize = 6;
        for _ in 0..ROUNDS {
            let before = best.score;
            for place in 0..best.chosen.len() {
                let others = usable.iter().filter(|index| !best.chosen.contains(index)).filter_map(|&index| {
                    let mut chosen = best.chosen.clone();
                    chosen[place] = index;
                    self.judged(chosen, rules)
                });
                if let Some(other) = others.min_by(|a, b| a.score.total_cmp(&b.score))
                    && other.score < best.score
                {
                    best = other;
                }
            }
            for place in (0..best.chosen.len()).rev() {
                let mut chosen = best.chosen.clone();
                chosen.remove(place);
                if let Some(fewer) = self.judged(chosen, rules)
                    && fewer.score < best.score
                {
                    best = fewer;
                }
            }
            if best.score >= before {
                break;
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::{Normal, Reduced, Rules};
    use dynid_random::Random;

    /// Rows of two own columns, 30 candidates and a signal of two of these, an own one and noise.
    fn normal(noise: f64) -> Normal {
        let mut random = Random::new(11);
        let rows = 400;
        let own = DMatrix::from_fn(rows, 2, |_, _| random.normal());
        let mut candidates = DMatrix::from_fn(rows, 30, |_, _| random.normal());
        // One that the own parameters have already, and a near copy of a true one.
        let copy = own.column(0).clone_owned();
        candidates.set_column(3, &copy);
        let near = candidates.column(7) + 0.3 * candidates.column(8);
        candidates.set_column(9, &near);
        let noises = DVector::from_fn(rows, |_, _| noise * random.normal());
        let signal = own.column(0) * 5.0 + candidates.column(7) * 0.8 - candidates.column(20) * 0.5 + noises;
        Normal {
            own: own.tr_mul(&own),
            mixed: own.tr_mul(&candidates),
            candidates: candidates.tr_mul(&candidates),
            own_signal: own.tr_mul(&signal),
            signal: candidates.tr_mul(&signal),
            squares: signal.norm_squared(),
        }
    }

    #[test]
    fn two_of_thirty_are_found_with_their_coefficients() {
        let complexity = [1.0; 30];
        let rules = Rules { independent: 400.0, complexity: &complexity, may_join: &|_| true, most: 3 };
        let normal = normal(0.2);
        let reduced = normal.reduced(&[0.0; 2]).expect("own columns are independent");
        assert!(!reduced.is_new(3), "the own parameters say it already");
        let choice = reduced.select(&rules);
        assert_eq!(choice.chosen, [7, 20]);
        let (coefficients, inverse, left) = reduced.solve(&choice.chosen).expect("independent");
        for (place, truth) in [0.8, -0.5].into_iter().enumerate() {
            let deviation = 0.2 * inverse[(place, place)].sqrt();
            assert!((coefficients[place] - truth).abs() < 4.0 * deviation, "{coefficients:?}");
        }
        // chi-squared of 400 - 4 degrees: 396 +- 28
        assert!((left / 0.04 - 396.0).abs() < 4.0 * 28.2, "{left}");
        let steps = normal.own_steps(&[0.0; 2], &choice.chosen, &coefficients).expect("independent");
        assert!((steps[0] - 5.0).abs() < 0.05 && steps[1].abs() < 0.05, "{steps}");
        let alone = Rules { may_join: &|chosen| !chosen.contains(&20), ..rules };
        assert!(!reduced.select(&alone).chosen.contains(&20), "a rule is a rule");
    }

    /// The near copy of one of two true terms says of both what is along it: `0.8 a - 0.5 b` by `a + 0.3 c`, all of one size.
    #[test]
    fn other_terms_say_a_part_of_what_a_formula_says() {
        let reduced = normal(0.0).reduced(&[0.0; 2]).expect("own columns are independent");
        let said_by = |others: &[usize]| reduced.said_by(others, &[7, 20]).expect("independent");
        assert!((said_by(&[7, 20]) - 1.0).abs() < 1e-9 && (said_by(&[20, 7, 11]) - 1.0).abs() < 1e-9);
        assert!((said_by(&[7, 8, 20]) - 1.0).abs() < 1e-9);
        let expected = 0.64 / 0.89;
        assert!((said_by(&[7]) - expected).abs() < 0.1, "{}", said_by(&[7]));
        assert!((said_by(&[9]) - expected / 1.09).abs() < 0.1, "{}", said_by(&[9]));
        assert!(said_by(&[12]) < 0.05, "{}", said_by(&[12]));
        assert_eq!(said_by(&[]), 0.0);
    }

    /// `a - b` beside a column that is nearly that, and one that is nothing.
    #[test]
    fn a_choice_stands_for_terms_whose_part_it_says() {
        let mut random = Random::new(5);
        let mut columns = DMatrix::from_fn(400, 5, |_, _| random.normal());
        let difference = columns.column(0) - columns.column(1) + 0.3 * columns.column(4);
        columns.set_column(2, &difference);
        let signal = columns.column(0) - columns.column(1);
        let two = reduced(&columns, &signal);
        for term in [0, 1] {
            assert!(two.stands_for(&[2], term, &[0, 1]) && two.stands_for(&[2, 3], term, &[0, 1]));
            assert!(!two.stands_for(&[], term, &[0, 1]) && !two.stands_for(&[3], term, &[0, 1]));
        }
        assert!(two.stands_for(&[0], 0, &[0, 1]) && !two.stands_for(&[0, 3], 1, &[0, 1]));
        // A small third term is not stood for by what the others say, nor by another third.
        let signal = columns.column(0) - columns.column(1) + 0.5 * columns.column(3);
        let three = reduced(&columns, &signal);
        assert!(!three.stands_for(&[0, 1], 3, &[0, 1, 3]) && !three.stands_for(&[0, 1, 4], 3, &[0, 1, 3]));
        assert!(!three.stands_for(&[2], 3, &[0, 1, 3]));
    }

    #[test]
    fn noise_is_not_explained() {
        let complexity = [1.0; 30];
        let rules = Rules { independent: 400.0, complexity: &complexity, may_join: &|_| true, most: 3 };
        let reduced = normal(1e4).reduced(&[0.0; 2]).expect("own columns are independent");
        assert_eq!(reduced.select(&rules).chosen, [0; 0]);
    }

    /// Columns beside which there are no own parameters.
    fn reduced(columns: &DMatrix<f64>, signal: &DVector<f64>) -> Reduced {
        Reduced {
            gram: columns.tr_mul(columns),
            signal: columns.tr_mul(signal),
            squares: signal.norm_squared(),
            whole: DVector::from_element(columns.ncols(), 1.0),
        }
    }

    /// Three columns of very different units, the third nearly the sum of the first two.
    fn small() -> Reduced {
        let columns = DMatrix::from_row_slice(
            4,
            3,
            &[
                1.0, 0.0, 1.0, //
                1.0, 100.0, 101.0, //
                0.0, 100.0, 100.0, //
                0.0, 0.0, 0.001,
            ],
        );
        let signal = DVector::from_row_slice(&[2.0, 3.0, 0.5, 1.0]);
        reduced(&columns, &signal)
    }

    /// Of the first two, `gram = [[2, 100], [100, 20000]]` and `signal = [5, 350]`: the determinant is 30000.
    #[test]
    fn coefficients_solve_the_normal_equations() {
        let reduced = small();
        let (coefficients, inverse, left) = reduced.solve(&[0, 1]).expect("independent");
        let close = |found: f64, expected: f64| (found / expected - 1.0).abs() < 1e-9;
        let expected = [(20_000.0 * 5.0 - 100.0 * 350.0) / 30_000.0, (2.0 * 350.0 - 100.0 * 5.0) / 30_000.0];
        assert!(coefficients.iter().zip(expected).all(|(found, expected)| close(*found, expected)), "{coefficients:?}");
        let entries = [(0, 0, 20_000.0), (0, 1, -100.0), (1, 0, -100.0), (1, 1, 2.0)];
        assert!(
            entries.iter().all(|&(row, column, value)| close(inverse[(row, column)], value / 30_000.0)),
            "{inverse}"
        );
        let explained = 5.0 * expected[0] + 350.0 * expected[1];
        assert!(close(left, reduced.squares - explained), "{left}");
        assert_eq!(reduced.left(&[]), Some(reduced.squares));
        assert_eq!(reduced.solve(&[0, 1, 2]).map(|_| ()), None, "coefficients of what is nearly a sum mean nothing");
        let (one, two) = (reduced.likeness(0, 1), reduced.likeness(1, 1));
        assert!(close(one, 100.0_f64.powi(2) / (2.0 * 20_000.0)) && close(two, 1.0), "{one} {two}");
    }

    /// `n ln(after / before)`, `ln n` for each coefficient and 4 for each factor beyond the first.
    #[test]
    fn a_score_is_what_is_gained_less_what_is_asked_to_be_believed() {
        let (reduced, complexity) = (small(), [1.0, 2.5, 1.0]);
        let rules = Rules { independent: 50.0, complexity: &complexity, may_join: &|_| true, most: 3 };
        let left = reduced.left(&[0, 1]).expect("independent");
        let expected = 50.0 * (left / reduced.squares).ln() + 2.0 * 50.0_f64.ln() + 4.0 * 1.5;
        let found = reduced.score(&[0, 1], &rules).expect("independent");
        assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
        assert_eq!(reduced.score(&[], &rules), Some(0.0));
        let few = Rules { independent: 1.0, ..rules };
        let found = reduced.score(&[0], &few).expect("independent");
        let expected = (reduced.left(&[0]).expect("independent") / reduced.squares).ln() + 2.0_f64.ln();
        assert!((found - expected).abs() < 1e-9, "of one sample a coefficient costs what it does of two: {found}");
    }

    /// The one that explains most alone stands in the way of two that explain all together; an exchange finds them.
    #[test]
    fn what_was_chosen_first_may_be_exchanged() {
        let mut random = Random::new(3);
        let rows = 300;
        let mut columns = DMatrix::from_fn(rows, 4, |_, _| random.normal());
        let both = columns.column(0) + columns.column(1);
        let near = &both + DVector::from_fn(rows, |_, _| 0.8 * random.normal());
        columns.set_column(2, &near);
        let signal = &both + DVector::from_fn(rows, |_, _| 0.05 * random.normal());
        let reduced = reduced(&columns, &signal);
        let complexity = [1.0; 4];
        let rules = Rules { independent: 300.0, complexity: &complexity, may_join: &|_| true, most: 3 };
        let judged = |chosen: &[usize]| reduced.judged(chosen.to_vec(), &rules).expect("independent");
        assert!(judged(&[2]).score < judged(&[0]).score && judged(&[2]).score < judged(&[1]).score);
        let found = reduced.exchanged(judged(&[2, 3]), &[0, 1, 2, 3], &rules);
        let mut chosen = found.chosen.clone();
        chosen.sort_unstable();
        assert_eq!(chosen, [0, 1]);
        assert_eq!(found.score, judged(&found.chosen).score);
        // What is best stays.
        assert_eq!(reduced.exchanged(found.clone(), &[0, 1, 2, 3], &rules), found);
    }

    /// Beside noise as large as the first, a second term that explains a seventh of what both do is told, one that explains a
    /// seventeenth is not, though both are far from chance. What explains all leaves no less than rounding.
    #[test]
    fn a_further_term_must_explain_a_part_of_the_whole() {
        let rows = 3000;
        let with = |second: f64, noise: f64| {
            let mut random = Random::new(5);
            let columns = DMatrix::from_fn(rows, 2, |_, _| random.normal());
            let noise = DVector::from_fn(rows, |_, _| noise * random.normal());
            let signal = columns.column(0) + columns.column(1) * second + noise;
            reduced(&columns, &signal)
        };
        let complexity = [1.0; 2];
        let rules = Rules { independent: 3000.0, complexity: &complexity, may_join: &|_| true, most: 2 };
        assert_eq!(with(0.4, 1.0).select(&rules).chosen, [0, 1]);
        assert_eq!(with(0.25, 1.0).select(&rules).chosen, [0]);
        let exact = with(0.0, 0.0);
        let left = exact.left(&[0]).expect("independent");
        assert!(left >= 1e-12 * exact.squares && left < 1e-11 * exact.squares, "{left} {}", exact.squares);
    }
}
