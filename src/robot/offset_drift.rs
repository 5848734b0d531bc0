//! Drift of the torques' offsets while all past data have equal weight.
//!
//! Offsets of torque sensors and drives drift with temperature. As a constant, such an offset makes
//! the weight and the friction wrong, without a residual that shows it. So each joint with an
//! offset o has a slope a, too, with w the weight of its rows and t their time since the start:
//!
//! ```text
//! τ = x·θ + a u,    u = t − t_r,    a ~ N(0, s²),    o in θ being that at t_r                   (1)
//! A ← A − v vᵀ/V,   b ← b − v e/V,   c ← c − e²/V                                               (2)
//!     v = Σ x u,  e = Σ τ u,  V = Σ u² + 1/(w s²)
//! â = (e − v·θ̂)/V                                                                             (3)
//! P_oo ← P_oo + (â (t − t_r))²                                                                (4)
//! Q_oo ≥ â² FOLLOWED_S per second                                                             (5)
//! ```
//!
//! (2) eliminates a from the sums of the joint's rows, which are the only ones that contain it: θ̂
//! and P are those of the estimate with all slopes, and no matrix is larger. The column of t is the
//! last of a row. Because the column of the offset is 1, Σ x u = Σ x t − t_r Σ x.
//!
//! The reported offset is the mean over the data so far, t_r being the mean of t: on a UR10e it
//! predicts another recording better than the newest offset does (residuals of joint 1 of 10.4 and
//! 11.1 %). (4) is its distance from the newest.
//!
//! When the sums are condensed, t_r is the present, so that the information is on the present
//! offset. From then on the offset has a random walk, and (5) lets it follow a drift that goes on.
//! With `friction_walk = 0` offsets are assumed constant, and slopes are 0.

use super::friction::FrictionTerm;
use super::sums::JointSums;
use crate::estimator::persist::Visit;

/// Prior standard deviation of a slope, as a share of the scale of the joint's offset per second:
/// 0.6 % of its largest torque per minute.
const DRIFT_SCALE_PER_S: f64 = 1e-4;
/// Time after which the random walk (5) is as far as the drift itself \[s\].
const FOLLOWED_S: f64 = 60.0;
/// Share of Σ t² that counts as rounding in Σ u².
const ROUNDING: f64 = 1e-12;

/// The offset of a joint.
#[derive(Debug, Clone, Copy)]
pub(super) struct DriftTerm {
    joint: usize,
    /// Its column in the rows of the joint; the last column is that of t.
    column: usize,
    /// Its index in θ.
    parameter: usize,
    /// Index of a among the effective parameters, after all of θ.
    index: usize,
    /// s.
    scale: f64,
}

impl DriftTerm {
    /// For a joint with these terms of friction, of which the first is at `column` and `parameter`;
    /// `scale` is that of the offset. `None` if none of them is an offset.
    pub fn of(
        joint: usize,
        terms: &[FrictionTerm],
        (column, parameter): (usize, usize),
        index: usize,
        scale: f64,
    ) -> Option<Self> {
        let at = terms.iter().position(|term| *term == FrictionTerm::Offset)?;
        Some(Self {
            joint,
            column: column + at,
            parameter: parameter + at,
            index,
            scale: DRIFT_SCALE_PER_S * scale,
        })
    }

    /// Σ u² of a joint's rows, at least the rounding of Σ t².
    fn square(&self, sums: &JointSums, origin_s: f64) -> f64 {
        let (m, last) = (sums.columns().len(), sums.columns().len() - 1);
        let (square, mean) = (sums.gram[last * m + last], sums.gram[last * m + self.column]);
        (square - origin_s * (2.0 * mean - origin_s * sums.squares(self.column))).max(ROUNDING * square)
    }

    /// V, for rows of this weight.
    fn spread(&self, sums: &JointSums, origin_s: f64, weight: f64) -> f64 {
        self.square(sums, origin_s) + 1.0 / (weight * self.scale * self.scale)
    }

    /// Σ x u of one column.
    fn product(&self, sums: &JointSums, column: usize, origin_s: f64) -> f64 {
        let m = sums.columns().len();
        sums.gram[(m - 1) * m + column] - origin_s * sums.gram[self.column * m + column]
    }

    /// Adds a slope to effective parameters whose offset is that at t_r.
    fn add(&self, slope: f64, origin_s: f64, effective: &mut [f64]) {
        effective[self.index] = slope; // (1)
        effective[self.parameter] -= slope * origin_s; // (1)
    }

    /// e.
    fn moment(&self, sums: &JointSums, origin_s: f64) -> f64 {
        sums.moment[sums.moment.len() - 1] - origin_s * sums.moment[self.column]
    }

    /// Mean of t.
    fn mean_s(&self, sums: &JointSums) -> f64 {
        let m = sums.columns().len();
        // Σ 1 is the number of rows, also if they are faded
        sums.gram[(m - 1) * m + self.column] / sums.squares(self.column).max(f64::MIN_POSITIVE)
    }
}

/// t_r.
#[derive(Debug, Clone, Copy)]
pub(super) enum Origin {
    /// The mean of t over the rows of the joint.
    Mean,
    /// This time since the start \[s\].
    At(f64),
}

/// The slopes, with their workspace.
#[derive(Debug, Clone)]
pub(super) struct OffsetDrift {
    terms: Vec<DriftTerm>,
    is_on: bool,
    /// â of each term, 0 once the sums are condensed, and t_r of the estimates.
    slopes: Vec<f64>,
    mean_s: Vec<f64>,
    /// The last â.
    rates: Vec<f64>,
    /// The distance in (4).
    lag: Vec<f64>,
    /// (2) of each joint.
    without: Vec<JointSums>,
}

impl OffsetDrift {
    /// Workspace for these offsets; `is_on` is false if they are constant.
    pub fn new(terms: Vec<DriftTerm>, is_on: bool, empty: &[JointSums]) -> Self {
        let none = vec![0.0; terms.len()];
        Self {
            is_on,
            slopes: none.clone(),
            mean_s: none.clone(),
            rates: none.clone(),
            lag: none,
            terms,
            without: empty.to_vec(),
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        for values in [&mut self.slopes, &mut self.mean_s, &mut self.rates, &mut self.lag] {
            values.fill(0.0);
        }
    }

    /// State kept in a checkpoint: from then on the past no longer has equal weight.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.rates);
        v.reals(&mut self.lag);
    }

    /// (2): a joint's sums without its slope, for the offset at `origin`. `fixed` are the
    /// parameters whose value is known.
    pub fn eliminate<'a>(
        &'a mut self,
        joint: usize,
        sums: &'a JointSums,
        weight: f64,
        (origin, fixed): (Origin, &[bool]),
    ) -> &'a JointSums {
        let drifts = |term: &DriftTerm| self.is_on && term.joint == joint && !fixed[term.parameter];
        let Some(k) = self.terms.iter().position(drifts) else {
            return sums;
        };
        let term = self.terms[k];
        if matches!(origin, Origin::Mean) {
            self.mean_s[k] = term.mean_s(sums);
        }
        let origin_s = self.origin_s(k, origin);
        let without = &mut self.without[joint];
        without.copy_from(sums);
        let m = sums.columns().len();
        let spread = term.spread(sums, origin_s, weight);
        let moment = term.moment(sums, origin_s);
        let (gram, products) = without.gram.split_at_mut((m - 1) * m);
        for (column, product) in products.iter_mut().enumerate() {
            *product = term.product(sums, column, origin_s);
        }
        for (i, row) in gram.chunks_exact_mut(m).enumerate() {
            let share = products[i] / spread;
            row.iter_mut().zip(&*products).for_each(|(a, v)| *a -= share * v); // (2)
            without.moment[i] -= share * moment; // (2)
        }
        without.square -= moment * moment / spread; // (2)
        without
    }

    /// (3) and (4) from the sums of the joints, at `now_s` since the start. `effective` are the
    /// effective parameters without slopes, to which the slopes are added.
    pub fn estimate(
        &mut self,
        sums: &[JointSums],
        weight: impl Fn(usize) -> f64,
        (fixed, now_s): (&[bool], f64),
        effective: &mut [f64],
    ) {
        for k in 0..self.terms.len() {
            let slope = self.slope(k, sums, &weight, fixed, |sums, column| sums.gradient(column, effective));
            (self.slopes[k], self.rates[k]) = (slope, slope); // (3)
            self.lag[k] = slope * (now_s - self.mean_s[k]); // (4)
        }
        self.add_to(effective, Origin::Mean);
    }

    /// (3) for other effective parameters, to which the slopes are added; those of this estimate
    /// stay.
    pub fn refit(&self, sums: &[JointSums], weight: impl Fn(usize) -> f64, fixed: &[bool], effective: &mut [f64]) {
        for (k, term) in self.terms.iter().enumerate() {
            let slope = self.slope(k, sums, &weight, fixed, |sums, column| sums.gradient(column, effective));
            term.add(slope, self.mean_s[k], effective);
        }
    }

    /// Adds how far the slopes change with a step of the effective parameters to the step.
    pub fn follow(&self, sums: &[JointSums], weight: impl Fn(usize) -> f64, fixed: &[bool], step: &mut [f64]) {
        for (k, term) in self.terms.iter().enumerate() {
            let change = |sums: &JointSums, column: usize| sums.gradient(column, step) - sums.moment[column];
            let slope = self.slope(k, sums, &weight, fixed, change);
            term.add(slope, self.mean_s[k], step);
        }
    }

    /// (3), with this gradient of the sums of a joint along a column; 0 if the offset is constant.
    fn slope(
        &self,
        k: usize,
        sums: &[JointSums],
        weight: impl Fn(usize) -> f64,
        fixed: &[bool],
        gradient: impl Fn(&JointSums, usize) -> f64,
    ) -> f64 {
        let (term, origin_s) = (&self.terms[k], self.mean_s[k]);
        let sums = &sums[term.joint];
        if !self.is_on || sums.rows == 0 || fixed[term.parameter] {
            return 0.0;
        }
        let left = gradient(sums, sums.columns().len() - 1) - origin_s * gradient(sums, term.column);
        left / term.spread(sums, origin_s, weight(term.joint)) // (3)
    }

    /// Adds the slopes to effective parameters whose offsets are those at `origin`. With them the
    /// offsets are those at the start.
    pub fn add_to(&self, effective: &mut [f64], origin: Origin) {
        for (k, term) in self.terms.iter().enumerate() {
            term.add(self.slopes[k], self.origin_s(k, origin), effective);
        }
    }

    /// t_r of an offset \[s\].
    fn origin_s(&self, k: usize, origin: Origin) -> f64 {
        match origin {
            Origin::At(t_s) => t_s,
            Origin::Mean => self.mean_s[k],
        }
    }

    /// Moves the offsets of θ from the mean to this time since the start.
    pub fn move_offsets(&self, theta: &mut [f64], now_s: f64) {
        for (k, term) in self.terms.iter().enumerate() {
            theta[term.parameter] += self.slopes[k] * (now_s - self.mean_s[k]);
        }
    }

    /// Makes a joint's sums those of torques without the drift before this time since the start.
    pub fn remove_from(&self, joint: usize, sums: &mut JointSums, now_s: f64) {
        let of_joint = |(_, term): &(usize, &DriftTerm)| term.joint == joint;
        let Some((k, term)) = self.terms.iter().enumerate().find(of_joint) else {
            return;
        };
        let slope = self.slopes[k];
        let (square, moment) = (term.square(sums, now_s), term.moment(sums, now_s));
        sums.square -= slope * (2.0 * moment - slope * square);
        sums.sum -= slope * (term.mean_s(sums) - now_s) * sums.rows as f64;
        for column in 0..sums.moment.len() {
            sums.moment[column] -= slope * term.product(sums, column, now_s);
        }
    }

    /// Forgets the drift of a parameter that becomes known, if it is an offset.
    pub fn forget(&mut self, parameter: usize) {
        if let Some(k) = self.of(parameter) {
            (self.slopes[k], self.rates[k], self.lag[k]) = (0.0, 0.0, 0.0);
        }
    }

    /// Ends the estimation of slopes: past data no longer have equal weight.
    pub fn end(&mut self) {
        self.slopes.fill(0.0);
    }

    /// Drops (4), which information on the present offset does not need.
    pub fn forget_lag(&mut self) {
        self.lag.fill(0.0);
    }

    /// What (4) adds to a variance.
    pub fn variance(&self, parameter: usize) -> f64 {
        self.of(parameter).map_or(0.0, |k| self.lag[k] * self.lag[k]) // (4)
    }

    /// (5) of a parameter, 0 if it is not an offset.
    pub fn walk_per_s(&self, parameter: usize) -> f64 {
        self.of(parameter)
            .map_or(0.0, |k| self.rates[k] * self.rates[k] * FOLLOWED_S) // (5)
    }

    fn of(&self, parameter: usize) -> Option<usize> {
        self.terms.iter().position(|term| term.parameter == parameter)
    }
}

#[cfg(test)]
mod tests {
    use super::super::information::{Information, Solver};
    use super::*;

    const WEIGHT: f64 = 4.0;
    const ORIGIN_S: f64 = 3.0;

    /// Rows of a column, the offset and the time, and their drift.
    fn drifting(scale: f64) -> (JointSums, DriftTerm) {
        let term = DriftTerm {
            joint: 0,
            column: 1,
            parameter: 1,
            index: 2,
            scale,
        };
        let mut sums = JointSums::new(&[0, 1, 2]);
        for k in 0..20 {
            let t_s = 0.5 * f64::from(k);
            let x = (1.3 * t_s).sin() + 0.1 * t_s;
            sums.add_row(&[x, 1.0, t_s], 2.0 * x + 0.7 - 0.05 * t_s + 0.01 * (9.0 * t_s).cos());
        }
        sums.mirror();
        (sums, term)
    }

    /// θ̂ and P with the slope as a third parameter, its column being u, beside those by (2) and
    /// (3). Products of 20 rows of up to 10 leave rounding of 1e-13.
    #[test]
    fn val_an_eliminated_slope_is_an_estimated_one() {
        let (sums, term) = drifting(0.1);
        let mut of_u = JointSums::new(&[0, 1, 2]);
        for k in 0..20 {
            let t_s = 0.5 * f64::from(k);
            let x = (1.3 * t_s).sin() + 0.1 * t_s;
            let torque = 2.0 * x + 0.7 - 0.05 * t_s + 0.01 * (9.0 * t_s).cos();
            of_u.add_row(&[x, 1.0, t_s - ORIGIN_S], torque);
        }
        of_u.mirror();
        let with_slope = |n: usize, sums: &JointSums| {
            let mut known = Information::new(n);
            (0..n).for_each(|i| known.set_prior(i, 0.0, [10.0, 10.0, 0.1][i]));
            sums.scatter(WEIGHT, &mut known);
            let (mut solver, mut theta, mut covariance) = (Solver::new(n), vec![0.0; n], vec![0.0; n * n]);
            let free = vec![false; n];
            assert!(solver.solve(&known, &free, &mut theta));
            assert!(solver.covariance(&known, &free, &mut covariance));
            (theta, covariance)
        };
        let (all, covariance) = with_slope(3, &of_u);
        let mut drift = OffsetDrift::new(vec![term], true, std::slice::from_ref(&sums));
        let origin = (Origin::At(ORIGIN_S), &[false; 2][..]);
        let (theta, reduced) = with_slope(2, drift.eliminate(0, &sums, WEIGHT, origin));
        for i in 0..2 {
            assert!((theta[i] - all[i]).abs() < 1e-11, "{theta:?} {all:?}");
            for j in 0..2 {
                assert!((reduced[i * 2 + j] - covariance[i * 3 + j]).abs() < 1e-11);
            }
        }
        drift.mean_s[0] = ORIGIN_S;
        let mut effective = [theta[0], theta[1], 0.0];
        let sums = std::slice::from_ref(&sums);
        drift.estimate(sums, |_| WEIGHT, (&[false; 2], 10.0), &mut effective);
        assert!((effective[2] - all[2]).abs() < 1e-11, "{effective:?} {all:?}");
        assert!((effective[1] - (all[1] - ORIGIN_S * all[2])).abs() < 1e-10);
        // (4): the offset is that at 3 s, and the newest that at 10 s
        assert!((drift.variance(1).sqrt() - 7.0 * all[2].abs()).abs() < 1e-10);
        // the sums of the torques without the drift are those with the offset at 10 s
        let mut without = sums[0].clone();
        drift.remove_from(0, &mut without, 10.0);
        let now = [theta[0], effective[1] + 10.0 * effective[2], 0.0];
        assert!((without.residual_square(&now) - sums[0].residual_square(&effective)).abs() < 1e-10);
    }

    #[test]
    fn prop_a_constant_offset_has_no_slope() {
        let (sums, term) = drifting(0.1);
        let known = |is_on: bool, fixed: bool| {
            let mut drift = OffsetDrift::new(vec![term], is_on, std::slice::from_ref(&sums));
            let fixed = [false, fixed];
            assert_eq!(*drift.eliminate(0, &sums, WEIGHT, (Origin::Mean, &fixed)), sums);
            let mut effective = [1.0, 0.5, 0.0];
            let all = std::slice::from_ref(&sums);
            drift.estimate(all, |_| WEIGHT, (&fixed, 10.0), &mut effective);
            assert_eq!(effective, [1.0, 0.5, 0.0]);
            assert_eq!((drift.variance(1), drift.walk_per_s(1)), (0.0, 0.0));
        };
        known(false, false);
        known(true, true);
    }
}
