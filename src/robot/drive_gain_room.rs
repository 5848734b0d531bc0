//! Sums, workspace and result of the test of [`drive_gain`](super::drive_gain), allocated at the
//! start; (1) to (8) are its equations.

use super::information::{Information, Solver};
use super::model::RobotModel;
use super::offset_drift::{DriftTerm, OffsetDrift, Origin};
use super::sums::JointSums;
use crate::estimator::linalg::dot;
use crate::estimator::persist::Visit;
use crate::model::MAX_JOINTS;
use std::fmt;

/// A joint whose torque contradicts those of the other joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrongGain {
    /// The joint, counted from 0.
    pub joint: usize,
    /// s: what it reports, relative to what the other joints' torques say.
    pub factor: f64,
    /// Another joint and its factor that explain the torques nearly as well.
    pub other: Option<(usize, f64)>,
}

impl WrongGain {
    /// True if this joint is named.
    pub fn names(&self, joint: usize) -> bool {
        self.joint == joint || self.other.is_some_and(|(other, _)| other == joint)
    }
}

impl fmt::Display for WrongGain {
    /// Rounded, so that the text does not change with every block.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |factor: f64| 5.0 * (20.0 * factor).round();
        let (joint, own) = (self.joint + 1, percent(self.factor));
        match self.other {
            None => write!(
                f,
                "torque of joint {joint} is some {own:.0} % of what the other joints' torques say: look at its gain"
            ),
            Some((other, factor)) => write!(
                f,
                "torque of joint {joint} is some {own:.0} %, or of joint {} {:.0} %, of what others say: look at the gains",
                other + 1,
                percent(factor)
            ),
        }
    }
}

/// The sums (2) of the joints, and the workspace of the test.
#[derive(Debug, Clone)]
pub(super) struct DriveGains {
    /// A, b, c over the columns of the arm, and that of the time.
    pub sums: Vec<JointSums>,
    /// Number of rows in them, faded.
    pub rows: Vec<f64>,
    drift: OffsetDrift,
    /// The sums without slopes of the offsets; those of the suspected joint are of τ/s.
    reduced: Vec<JointSums>,
    /// W.
    pub weights: [f64; MAX_JOINTS],
    pub known: Information,
    solver: Solver,
    /// θ̂, then zeros.
    pub theta: Vec<f64>,
    /// θ̂(1) − θ̂(s).
    pub change: Vec<f64>,
    /// θ̂(1) and its R.
    pub plain: Vec<f64>,
    pub misfits: [f64; MAX_JOINTS],
    /// v and d.
    cross: Vec<f64>,
    step: Vec<f64>,
    /// s_i θ̂ and e of the other joints, then of the suspected one, with slopes.
    pub effective: [Vec<f64>; 2],
    pub along: [Vec<f64>; 2],
    /// The last result.
    pub found: Option<WrongGain>,
}

impl DriveGains {
    /// Workspace for a model; `wide` is the same model with further columns, on `acting` effective
    /// parameters, and `drifts` are the offsets that drift.
    pub fn new(
        model: &RobotModel,
        wide: &RobotModel,
        drifts: Vec<DriftTerm>,
        (is_drifting, acting): (bool, usize),
    ) -> Self {
        let joints = model.robot().len();
        let n = model.parameters().len();
        let empty: Vec<JointSums> = (0..joints)
            .map(|joint| {
                let time = wide.columns(joint).last().filter(|_| wide.ends_with_time(joint));
                let columns: Vec<usize> = model.columns(joint).iter().chain(time).copied().collect();
                JointSums::new(&columns)
            })
            .collect();
        Self {
            rows: vec![0.0; joints],
            drift: OffsetDrift::new(drifts, is_drifting, &empty),
            reduced: empty.clone(),
            sums: empty,
            weights: [0.0; MAX_JOINTS],
            known: Information::new(n),
            solver: Solver::new(n),
            theta: vec![0.0; acting],
            change: vec![0.0; acting],
            plain: vec![0.0; n],
            misfits: [0.0; MAX_JOINTS],
            cross: vec![0.0; n],
            step: vec![0.0; n],
            effective: [vec![0.0; acting], vec![0.0; acting]],
            along: [vec![0.0; acting], vec![0.0; acting]],
            found: None,
        }
    }

    /// Forgets the rows, not the result.
    pub fn clear(&mut self) {
        self.sums.iter_mut().for_each(JointSums::clear);
        self.rows.fill(0.0);
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.clear();
        self.found = None;
    }

    /// (2).
    pub fn take(&mut self, block: &[JointSums], kept: f64) {
        for ((sums, rows), block) in self.sums.iter_mut().zip(&mut self.rows).zip(block) {
            sums.fade(kept, block);
            *rows = kept * *rows + block.rows as f64;
        }
    }

    /// (3) for a joint with this factor, or for none; false if it cannot be solved.
    pub fn solve(&mut self, model: &RobotModel, suspect: Option<(usize, f64)>, fixed: &[bool]) -> bool {
        self.known.clear();
        for (i, parameter) in model.parameters().iter().enumerate() {
            self.known.set_prior(i, parameter.nominal, parameter.scale);
        }
        for (joint, sums) in self.sums.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let (own, mut weight) = (&mut self.reduced[joint], self.weights[joint]);
            own.copy_from(self.drift.eliminate(joint, sums, weight, (Origin::Mean, fixed)));
            if let Some((_, factor)) = suspect.filter(|(suspect, _)| *suspect == joint) {
                own.divide_torque(factor);
                weight *= factor * factor;
            }
            own.scatter(weight, &mut self.known);
        }
        let n = self.known.n;
        self.solver.solve(&self.known, fixed, &mut self.theta[..n]) // (3)
    }

    /// U and I of (4) for the system solved last, and d in `step`.
    pub fn slope(&mut self, joint: usize, factor: f64) -> (f64, f64) {
        let n = self.known.n;
        let (sums, theta) = (&self.reduced[joint], &self.theta[..n]);
        let (m, weight) = (sums.columns().len(), self.weights[joint]);
        let columns = sums.columns_below(n);
        let (mut score, mut power) = (0.0, 0.0);
        self.cross.fill(0.0);
        for (i, &a) in columns.iter().enumerate() {
            let row = sums.gram[i * m..(i + 1) * m].iter().zip(columns);
            let product: f64 = row.map(|(entry, &k)| entry * theta[k]).sum();
            self.cross[a] = weight * factor * product; // (4)
            power += weight * theta[a] * product;
            score += weight * factor * theta[a] * (sums.moment[i] - product); // (4)
        }
        self.step.copy_from_slice(&self.cross);
        self.solver.apply(&mut self.step); // (4)
        (score, power - dot(&self.cross, &self.step)) // (4)
    }

    /// B of (7), behind [`slope`](Self::slope).
    pub fn bias(&self, joint: usize, factor: f64) -> f64 {
        let sums = &self.reduced[joint];
        let own: f64 = sums
            .columns()
            .iter()
            .zip(&sums.bias)
            .map(|(&k, b)| self.theta[k] * b)
            .sum();
        self.weights[joint] * factor * own - dot(&self.step, &self.known.bias) // (7)
    }

    /// R of (6).
    pub fn misfit(&self, joint: usize, factor: f64) -> f64 {
        factor * factor * self.reduced[joint].residual_square(&self.theta)
    }

    /// s_i θ̂ with the slopes of the offsets.
    pub fn scale(&mut self, factor: f64, fixed: &[bool]) {
        for (effective, factor) in self.effective.iter_mut().zip([1.0, factor]) {
            effective.fill(0.0);
            effective
                .iter_mut()
                .zip(&self.theta)
                .for_each(|(x, theta)| *x = factor * theta);
            let weights = &self.weights;
            self.drift.refit(&self.sums, |joint| weights[joint], fixed, effective);
        }
    }

    /// e of (7).
    pub fn point(&mut self, factor: f64, fixed: &[bool]) {
        for (k, along) in self.along.iter_mut().enumerate() {
            let (of_step, of_theta) = if k == 0 { (1.0, 0.0) } else { (factor, 1.0) };
            along.fill(0.0);
            for ((e, d), theta) in along.iter_mut().zip(&self.step).zip(&self.theta) {
                *e = of_theta * theta - of_step * d; // (7)
            }
            let weights = &self.weights;
            self.drift.follow(&self.sums, |joint| weights[joint], fixed, along);
        }
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.sums.iter_mut().for_each(|sums| sums.visit(v));
        v.reals(&mut self.rows);
        let found = self.found;
        let mut factors = [
            found.map_or(1.0, |found| found.factor),
            found.and_then(|found| found.other).map_or(1.0, |other| other.1),
        ];
        let mut joints = [
            found.map(|found| found.joint),
            found.and_then(|found| found.other).map(|other| other.0),
        ]
        .map(|joint| joint.map_or(0, |joint| joint as u64 + 1));
        v.reals(&mut factors);
        joints.iter_mut().for_each(|joint| v.count(joint));
        let of = |at: usize| (joints[at] as usize).checked_sub(1).map(|joint| (joint, factors[at]));
        self.found = of(0).map(|(joint, factor)| WrongGain {
            joint,
            factor,
            other: of(1),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::selection::Selection;
    use super::super::tree::Robot;
    use super::*;

    fn model() -> RobotModel {
        let urdf = include_str!("../../config/robots/six_axis.urdf");
        let robot = Robot::from_urdf(urdf, &Selection::default()).unwrap();
        RobotModel::new(robot, true, vec![Default::default(); 6]).unwrap()
    }

    /// Rows without noise, those of joint 3 with 1.3 times their torques. The prior, whose mean is
    /// the truth, weighs 1e-8 of the rows.
    #[test]
    fn val_steps_find_the_factor_of_exact_rows() {
        let model = model();
        let n = model.parameters().len();
        let truth: Vec<f64> = model.parameters().iter().map(|p| p.nominal).collect();
        let mut gains = DriveGains::new(&model, &model, Vec::new(), (false, n));
        let mut block: Vec<JointSums> = (0..6).map(|joint| JointSums::new(model.columns(joint))).collect();
        for (joint, sums) in block.iter_mut().enumerate() {
            let columns = model.columns(joint);
            for row in 0..300 {
                let entry = |c: usize| ((row * (3 * c + 7) + joint * 11) as f64 * 0.37).cos();
                let x: Vec<f64> = (0..columns.len()).map(entry).collect();
                let torque: f64 = x.iter().zip(columns).map(|(x, &k)| x * truth[k]).sum();
                sums.add_row(&x, if joint == 2 { 1.3 * torque } else { torque });
            }
            sums.mirror();
        }
        gains.take(&block, 1.0);
        gains.weights = [1e8; MAX_JOINTS];
        let (fixed, mut factor) = (vec![false; n], 1.0);
        for _ in 0..10 {
            assert!(gains.solve(&model, Some((2, factor)), &fixed));
            let (score, information) = gains.slope(2, factor);
            factor += score / information;
        }
        assert!((factor - 1.3).abs() < 1e-6, "{factor}");
        assert!(gains.misfit(2, factor) < 1e-6 * block[2].square);
    }

    /// Half the rows of before and all of the new ones, without the columns between.
    #[test]
    fn val_faded_sums_are_those_of_weighted_rows() {
        let (mut faded, mut other) = (JointSums::new(&[0, 1, 5]), JointSums::new(&[0, 1, 3, 5]));
        let mut weighted = JointSums::new(&[0, 1, 5]);
        let row = |k: usize| [0.5 * k as f64, 1.0, 7.0, 0.25 * k as f64 - 1.0];
        for (count, weight) in [(3, 0.5_f64), (4, 1.0)] {
            other.clear();
            for k in 0..count {
                let [a, b, c, t] = row(k + count);
                other.add_row(&[a, b, c, t], a - t);
                let w = weight.sqrt();
                weighted.add_row(&[w * a, w * b, w * t], w * (a - t));
            }
            other.mirror();
            faded.fade(0.5, &other);
        }
        weighted.mirror();
        let pairs = faded
            .gram
            .iter()
            .zip(&weighted.gram)
            .chain(faded.moment.iter().zip(&weighted.moment));
        // sums of ten products of up to 10
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-12));
        assert!((faded.square - weighted.square).abs() < 1e-12);
    }

    #[test]
    fn prop_words_fit_a_status() {
        for other in [None, Some((7, 1.0 / 3.0))] {
            let found = WrongGain {
                joint: 7,
                factor: 2.9,
                other,
            };
            assert!(found.to_string().len() <= crate::messages::ERROR_TEXT, "{found}");
        }
    }
}
