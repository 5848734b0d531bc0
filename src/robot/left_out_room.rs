//! Workspace of the test for missing terms, allocated at the start; (1) to (11) are those of
//! [`left_out`](super::left_out).

use super::identify_options::IdentifyOptions;
use super::information::Information;
use super::unmodelled::{LeftOutTerm, Unmodelled};
use crate::estimator::linalg::{Cholesky, dot};

/// Share of a term's information that counts as rounding: the parameters can imitate a term
/// completely.
pub(super) const ROUNDING: f64 = 1e-9;

/// A term missing in the model that would explain the misfit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOutCause {
    /// The term.
    pub what: Unmodelled,
    /// Its parameter, if it is the only missing term.
    pub amplitude: f64,
    /// z: its distance from 0 in standard deviations.
    pub deviations: f64,
    /// Error of the most affected usable parameter, in its standard deviations; 0 if nothing may be
    /// used.
    pub harm: f64,
    /// Share of the squared residuals that it would explain, 0 to 1: of its joint's, or of all.
    pub share: f64,
}

impl std::fmt::Display for Unmodelled {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Friction { joint, term } => write!(f, "{} at joint {}", term.phrase(), joint + 1),
            Self::StribeckSpeed { joint, .. } => {
                write!(f, "another stribeck_speed at joint {}", joint + 1)
            }
            Self::Zero { joint } => write!(f, "another zero of the encoder of joint {}", joint + 1),
            Self::Tilt => f.write_str("a tilted base"),
            Self::Delay => f.write_str("a delay or filter of the torques"),
        }
    }
}

impl std::fmt::Display for LeftOutCause {
    /// Rounded, so that the text does not change with every block.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let share = (10.0 * (10.0 * self.share).round()).max(10.0);
        write!(
            f,
            "{}, which the model leaves out, would explain {share:.0} % of the misfit",
            self.what
        )
    }
}

/// Standard deviations of what is known in advance to be small.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Priors {
    /// Of zeros and tilts \[rad\].
    pub zero_rad: f64,
    /// Of the delay \[s\].
    pub delay_s: f64,
    /// β: of drag, asymmetric friction and another Stribeck speed, as a share of friction.
    pub friction_shape: f64,
    /// β of a spring.
    pub spring_share: f64,
}

impl Priors {
    /// Those of the options.
    pub fn new(options: &IdentifyOptions) -> Self {
        Self {
            zero_rad: options.zero_rad,
            delay_s: options.delay_s,
            friction_shape: options.friction_shape,
            spring_share: options.spring_share,
        }
    }
}

/// The missing terms, and the workspace of the test.
#[derive(Debug, Clone)]
pub(super) struct LeftOut {
    pub terms: Vec<LeftOutTerm>,
    /// The named term, if there is one.
    pub found: Option<LeftOutCause>,
    /// v_c by rows, then v_c ĉ of those allowed for by (6).
    pub shifts: Vec<f64>,
    believed: usize,
    /// v_c times the standard deviation of c, for considered errors.
    considered: Vec<f64>,
    pub priors: Priors,
    /// The effects (10) of the terms with a prior on the estimates.
    with_prior: Vec<f64>,
    /// U, I and ĉ_all.
    pub score: Vec<f64>,
    /// Bias of U by errors of the positions.
    pub doubtful: Vec<f64>,
    pub information: Vec<f64>,
    all: Vec<f64>,
    factor: Cholesky,
    pub theta: Vec<f64>,
    /// The effective parameters with all terms, and with one alone.
    pub effective: Vec<f64>,
    pub alone: Vec<f64>,
    /// d of (8).
    pub direction: Vec<f64>,
}

impl LeftOut {
    /// Workspace for `terms`; `n` is the number of parameters and terms together, and rows depend
    /// on `acting` effective parameters.
    pub fn new(terms: Vec<LeftOutTerm>, priors: Priors, n: usize, acting: usize) -> Self {
        let k = terms.len();
        let considered = terms.iter().filter(|term| term.what.is_considered()).count();
        Self {
            considered: vec![0.0; considered * n],
            priors,
            with_prior: vec![0.0; terms.iter().filter(|term| term.what.has_prior()).count() * n],
            terms,
            found: None,
            shifts: vec![0.0; k * n],
            believed: 0,
            score: vec![0.0; k],
            doubtful: vec![0.0; k],
            information: vec![0.0; k * k],
            all: vec![0.0; k],
            factor: Cholesky::new(k),
            theta: vec![0.0; n],
            effective: vec![0.0; acting],
            alone: vec![0.0; acting],
            direction: vec![0.0; acting],
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.found = None;
        self.forget_shifts();
        self.considered.fill(0.0);
        self.with_prior.fill(0.0);
    }

    /// Drops the errors (2) after parameters were fixed or freed, because they are of another
    /// estimate.
    pub fn forget_shifts(&mut self) {
        self.believed = 0;
    }

    /// Number of terms of a joint's friction.
    pub fn of_joint(&self, joint: usize) -> usize {
        let own = |term: &&LeftOutTerm| term.what.only_joint() == Some(joint);
        self.terms.iter().filter(own).count()
    }

    /// Number of columns after those of friction, in the rows of every joint.
    pub fn shared(&self) -> usize {
        let shared = |term: &&LeftOutTerm| term.what.only_joint().is_none();
        self.terms.iter().filter(shared).count()
    }

    /// Contribution of (6), (7) and (10) to an entry of P.
    pub fn covariance(&self, i: usize, j: usize, n: usize) -> f64 {
        self.errors(n).map(|shift| shift[i] * shift[j]).sum() // (6), (7), (10)
    }

    /// The errors of the n estimates for which (6), (7) and (10) allow.
    pub fn errors(&self, n: usize) -> impl Iterator<Item = &[f64]> {
        let n = n.max(1);
        let considered = self.considered.chunks_exact(n);
        let believed = self.shifts.chunks_exact(n).take(self.believed);
        considered.chain(self.with_prior.chunks_exact(n)).chain(believed)
    }

    /// Stores the effect of considered errors on the estimates.
    fn consider(&mut self, n: usize) {
        let shifts = self.terms.iter().zip(self.shifts.chunks_exact(n));
        let of = shifts.filter(|(term, _)| term.what.is_considered());
        for (kept, (_, shift)) in self.considered.chunks_exact_mut(n).zip(of) {
            for (kept, v) in kept.iter_mut().zip(shift) {
                *kept = v * self.priors.zero_rad; // (7)
            }
        }
    }

    /// Stores the effect (10) of the `place`th term with a prior, term c: `std` is σ_c, `precision`
    /// I_cc/x and `mean` U_c/x.
    pub fn consider_with_prior(&mut self, place: usize, c: usize, std: f64, (precision, mean): (f64, f64)) {
        let n = self.theta.len();
        let variance = (std.powi(-2) + precision).recip(); // (10)
        let size = (variance + (variance * mean).powi(2)).sqrt(); // (10)
        let kept = &mut self.with_prior[place * n..(place + 1) * n];
        for (kept, v) in kept.iter_mut().zip(&self.shifts[c * n..(c + 1) * n]) {
            *kept = v * size; // (10)
        }
    }

    /// (1) and (3); false if I is not positive definite because of rounding.
    pub fn solve(&mut self, known: &Information, covariance: &[f64], theta: &[f64]) -> bool {
        let (n, k) = (known.n, self.terms.len());
        for (c, term) in self.terms.iter().enumerate() {
            let row = &known.matrix[term.index * n..(term.index + 1) * n];
            self.score[c] = known.vector[term.index] - dot(row, theta); // (1)
            for (i, v) in self.shifts[c * n..(c + 1) * n].iter_mut().enumerate() {
                *v = dot(&covariance[i * n..(i + 1) * n], row); // (1)
            }
            let v = &self.shifts[c * n..(c + 1) * n];
            self.doubtful[c] = (known.bias[term.index] - dot(v, &known.bias)).abs(); // (9)
        }
        self.consider(n);
        for (c, term) in self.terms.iter().enumerate() {
            let row = &known.matrix[term.index * n..(term.index + 1) * n];
            for d in 0..k {
                let v = &self.shifts[d * n..(d + 1) * n];
                self.information[c * k + d] = row[self.terms[d].index] - dot(row, v); // (1)
            }
            self.information[c * k + c] += ROUNDING * row[term.index];
        }
        if !self.factor.factor(k, &self.information) {
            return false;
        }
        self.all.copy_from_slice(&self.score);
        self.factor.solve(&mut self.all);
        self.theta.copy_from_slice(theta);
        (0..k).for_each(|c| self.step(c, self.all[c])); // (3)
        true
    }

    /// Changes θ to that with the term at this amplitude.
    pub fn step(&mut self, c: usize, amplitude: f64) {
        let n = self.theta.len();
        for (theta, v) in self.theta.iter_mut().zip(&self.shifts[c * n..(c + 1) * n]) {
            *theta -= v * amplitude; // (2), (3)
        }
        self.theta[self.terms[c].index] += amplitude;
    }

    /// Stores the error (2) of a term, for (6); errors of earlier terms may already be stored.
    pub fn believe(&mut self, c: usize, amplitude: f64) {
        let n = self.theta.len();
        self.shifts.copy_within(c * n..(c + 1) * n, self.believed * n);
        let shift = &mut self.shifts[self.believed * n..(self.believed + 1) * n];
        shift.iter_mut().for_each(|v| *v *= amplitude); // (2)
        self.believed += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::super::friction::FrictionTerm;
    use super::super::information::Solver;
    use super::*;

    /// (3) gives the solution with every term free from that without them. Rounding of the terms'
    /// information is 1e-9.
    #[test]
    fn val_terms_that_are_set_free_give_what_all_parameters_together_give() {
        let n = 5;
        let rows: [[f64; 5]; 7] = [
            [1.0, 0.3, -0.2, 0.7, 0.1],
            [0.2, 1.1, 0.4, -0.3, 0.6],
            [-0.5, 0.2, 0.9, 0.8, -0.4],
            [0.6, -0.7, 0.1, 1.2, 0.3],
            [0.3, 0.8, -0.6, 0.2, 1.3],
            [1.4, 0.1, 0.5, -0.9, 0.2],
            [-0.1, 0.5, 0.7, 0.4, -1.1],
        ];
        let mut known = Information::new(n);
        for (row, y) in rows.iter().zip([0.3, -1.2, 2.0, 0.4, 0.9, -0.6, 1.5]) {
            for i in 0..n {
                known.vector[i] += row[i] * y;
                (0..n).for_each(|j| known.matrix[i * n + j] += row[i] * row[j]);
            }
        }
        let (mut theta, mut covariance) = (vec![0.0; n], vec![0.0; n * n]);
        let held = [false, false, false, true, true];
        let mut solver = Solver::new(n);
        assert!(solver.solve(&known, &held, &mut theta) && solver.covariance(&known, &held, &mut covariance));
        let mut all = vec![0.0; n];
        assert!(solver.solve(&known, &[false; 5], &mut all));
        let term = |index| LeftOutTerm {
            what: Unmodelled::Delay,
            index,
            scale: 1.0,
        };
        let mut left_out = LeftOut::new(vec![term(3), term(4)], Priors::default(), n, n);
        assert!(left_out.solve(&known, &covariance, &theta));
        for (left_out, all) in left_out.theta.iter().zip(&all) {
            assert!((left_out - all).abs() < 1e-7, "{left_out} {all}");
        }
        // one of them alone, and its effect on P
        let amplitude = left_out.score[1] / left_out.information[3];
        let shift = left_out.shifts[n] * amplitude;
        let mut alone = theta.clone();
        assert!(solver.solve(&known, &[false, false, false, true, false], &mut alone));
        assert!((theta[0] - shift - alone[0]).abs() < 1e-7 && (amplitude - alone[4]).abs() < 1e-7);
        left_out.believe(1, amplitude);
        assert_eq!(left_out.covariance(0, 0, n), shift * shift);
    }

    #[test]
    fn prop_each_term_has_words_that_fit_a_status() {
        let frictions = FrictionTerm::NAMES.map(|(_, term)| Unmodelled::Friction { joint: 7, term });
        let others = [
            Unmodelled::StribeckSpeed { joint: 7, higher: true },
            Unmodelled::Zero { joint: 7 },
            Unmodelled::Tilt,
            Unmodelled::Delay,
        ];
        for what in frictions.into_iter().chain(others) {
            let found = LeftOutCause {
                what,
                amplitude: 1.0,
                deviations: 9.0,
                harm: 2.0,
                share: 1.0,
            };
            let words = found.to_string();
            assert!(
                words.ends_with("would explain 100 % of the misfit") && words.len() <= 112,
                "{words}"
            );
        }
    }
}
