//! What gravity sees of the URDF's bodies, as a prior: honest errors of masses and centres are
//! allowed for, a wrong gravity or zero is not.
//!
//! ```text
//! d = β̂ − β₀ ~ N(0, C),    C = P + D,    D = Σ_b s² v_b v_bᵀ + Σ_b,a (s m_b r_b)² u_ba u_baᵀ      (1)
//! χ²(β) = (β̂ − β)ᵀ C⁻¹ (β̂ − β)                                                               (2)
//! c = β₀ᵀ C⁻¹ β̂ / β₀ᵀ C⁻¹ β₀:    gravity is c times what the configuration says                  (3)
//! β_jα = argmin Σ_q ‖G(q) β − g(q − α e_j)‖²:    joint j has another zero, by α                   (4)
//! ```
//!
//! β are the base parameters that stand for masses and first moments and that gravity sees, β₀
//! those of the URDF and P the covariance of the estimates. Each body's mass may be another one by
//! s = 0.3 of it (v_b is what it gives to β₀), and its centre may lie elsewhere by s times its
//! radius of gyration about the joint, in each direction (u_ba). As standard deviations they make
//! errors of 50 % ordinary. Such errors are independent from body to body, and no body's moment
//! turns round; under a wrong gravity or zero all moments behind it do, by one factor or angle.
//!
//! A cause is believed if χ²(β₀) is beyond any chance, and that of the cause is smaller by
//! [`CLEAR`] and is less than a quarter of it. G is the gravity's regressor and g the URDF's weight
//! at random positions. A torque in another unit scales inertias with the moments, which gravity
//! does not: then (3) says nothing.

use super::model::RobotModel;
use super::random::Random;
use super::regressor::EnergyRegressors;
use super::spatial::BODY_PARAMETERS;
use crate::estimator::linalg::{Cholesky, dot};
use crate::model::MAX_JOINTS;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;
use std::fmt;

/// s.
const DIFFERENCE: f64 = 0.3;
/// χ² by which a cause must be likelier than an honest URDF: a Bayes factor of e¹⁰.
const CLEAR: f64 = 20.0;
/// Part of χ² that a cause may leave.
const LEFT: f64 = 0.25;
/// Angles by which a zero may be off [degrees].
const TURNS: [i32; 7] = [-135, -90, -45, 45, 90, 135, 180];
/// Positions that (4) is over, and their seed.
const STATES: usize = 60;
const SEED: u64 = 0x7572_6466;
/// Part of the largest moment's column that gravity must move.
const SEEN: f64 = 1e-6;
/// (3) of a gravity of the wrong sign; of one in g instead of m/s², and the other way round.
const REVERSED: std::ops::Range<f64> = -2.5..-0.4;
const IN_G: [std::ops::Range<f64>; 2] = [5.0..20.0, 0.05..0.2];
/// Inertias that are off by the same factor as moments, to within this one, are of another unit.
const SAME: f64 = 3.0;

/// What contradicts the URDF altogether.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UrdfContradiction {
    /// Gravity is this many times what the configuration says.
    Gravity {
        /// c of (3).
        factor: f64,
    },
    /// A joint's position is off, or its frame in the URDF is turned.
    Zero {
        /// The joint, counted from 0.
        joint: usize,
        /// About by so much.
        degrees: i32,
    },
}

impl fmt::Display for UrdfContradiction {
    /// Rounded, so that the words change only with the matter.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Gravity { factor } if factor < 0.0 => {
                f.write_str("gravity moments have the opposite sign of the URDF's: look at model.gravity_m_per_s2")
            }
            Self::Gravity { factor } => {
                let times = if factor > 1.0 { "10 times" } else { "a tenth of" };
                write!(
                    f,
                    "gravity moments are some {times} the URDF's: look at model.gravity_m_per_s2"
                )
            }
            Self::Zero { joint, degrees } => write!(
                f,
                "moments from joint {} on are turned by some {degrees} degrees against the URDF: look at its zero",
                joint + 1
            ),
        }
    }
}

/// β₀, D and β_jα, and room for the test.
#[derive(Debug, Clone)]
pub(super) struct UrdfPrior {
    /// Of the parameters β, and of those that stand for inertias.
    pub indices: Vec<usize>,
    pub inertias: Vec<usize>,
    nominal: Vec<f64>,
    spread: Vec<f64>,
    zeros: Vec<(UrdfContradiction, Vec<f64>)>,
    factor: Cholesky,
    /// C, filled by the caller with P.
    pub covariance: Vec<f64>,
    /// β̂.
    pub estimate: Vec<f64>,
    off: Vec<f64>,
    solved: Vec<f64>,
    /// What was found last.
    pub found: Option<UrdfContradiction>,
}

impl UrdfPrior {
    /// Of a model's URDF.
    pub fn new(model: &RobotModel) -> Self {
        let robot = model.robot();
        let n = robot.len();
        let base = model.base();
        let of = |wanted: std::ops::Range<usize>| {
            let leading = base.parameters.iter().map(|parameter| parameter.leading);
            let own = leading
                .enumerate()
                .filter_map(|(i, leading)| leading.in_body().map(|at| (i, at)));
            own.filter(move |(_, (_, parameter))| wanted.contains(parameter))
                .collect::<Vec<_>>()
        };
        // G(q) and the weight at q − α e_j, over random positions
        let mut regressors = EnergyRegressors::new(n);
        let mut random = Random(SEED);
        let still = [0.0; MAX_JOINTS];
        let moments = of(0..4);
        let turning = (0..n).filter(|joint| robot.joints[*joint].turns);
        let causes: Vec<(usize, i32)> = turning
            .flat_map(|joint| TURNS.map(|degrees| (joint, degrees)))
            .collect();
        let mut g = DMatrix::zeros(STATES * n, moments.len());
        let mut weights = DMatrix::zeros(STATES * n, causes.len());
        let mut weight = [0.0; MAX_JOINTS];
        for state in 0..STATES {
            let q: Vec<f64> = (0..n).map(|_| random.within(PI)).collect();
            regressors.evaluate(robot, &q, &still[..n]);
            for (column, (_, (joint, parameter))) in moments.iter().enumerate() {
                for i in 0..n {
                    g[(state * n + i, column)] = -regressors.lagrangian(i)[joint * BODY_PARAMETERS + parameter];
                }
            }
            for (column, (joint, degrees)) in causes.iter().enumerate() {
                let mut turned = q.clone();
                turned[*joint] -= f64::from(*degrees).to_radians();
                regressors.evaluate(robot, &turned, &still[..n]);
                regressors.weight(&robot.bodies, &mut weight[..n]);
                (0..n).for_each(|i| weights[(state * n + i, column)] = weight[i]);
            }
        }
        let largest = g.column_iter().map(|column| column.norm()).fold(0.0, f64::max);
        let seen: Vec<usize> = (0..moments.len())
            .filter(|column| g.column(*column).norm() > SEEN * largest.max(f64::MIN_POSITIVE))
            .collect();
        let indices: Vec<usize> = seen.iter().map(|column| moments[*column].0).collect();
        let g = g.select_columns(&seen);
        let nominal: Vec<f64> = indices.iter().map(|i| model.parameters()[*i].nominal).collect();
        let (k, start) = (indices.len(), DVector::from_column_slice(&nominal));
        let gram = g.tr_mul(&g) + DMatrix::identity(k, k) * (SEEN * largest).powi(2);
        let mut zeros = Vec::new();
        if let Some(factor) = gram.cholesky().filter(|_| largest > 0.0) {
            for (column, (joint, degrees)) in causes.into_iter().enumerate() {
                let wanted = weights.column(column) - &g * &start;
                let beta = &start + factor.solve(&g.tr_mul(&wanted)); // (4)
                let cause = UrdfContradiction::Zero { joint, degrees };
                zeros.push((cause, beta.as_slice().to_vec()));
            }
        }
        Self {
            spread: spread(model, &indices),
            inertias: of(4..BODY_PARAMETERS).into_iter().map(|(i, _)| i).collect(),
            nominal,
            zeros,
            factor: Cholesky::new(k),
            covariance: vec![0.0; k * k],
            estimate: vec![0.0; k],
            off: vec![0.0; k],
            solved: vec![0.0; k],
            found: None,
            indices,
        }
    }

    /// Looks for a cause. `inertias` is the factor of the inertias against the URDF's.
    pub fn look(&mut self, inertias: f64) {
        self.found = None;
        let k = self.indices.len();
        self.covariance.iter_mut().zip(&self.spread).for_each(|(c, d)| *c += d); // (1)
        if k == 0 || !self.factor.factor(k, &self.covariance) {
            return;
        }
        let room = (&mut self.off[..], &mut self.solved[..]);
        let before = distance(&self.factor, (&self.estimate, &self.nominal), 1.0, room);
        if !(before > k as f64 + CLEAR) {
            return;
        }
        let mut least = (LEFT * before).min(before - CLEAR);
        self.solved.copy_from_slice(&self.nominal);
        self.factor.solve(&mut self.solved);
        let factor = dot(&self.solved, &self.estimate) / dot(&self.solved, &self.nominal); // (3)
        let is_unit = inertias > 0.0 && (factor / inertias).max(inertias / factor) < SAME;
        if REVERSED.contains(&factor) || IN_G.iter().any(|range| range.contains(&factor)) && !is_unit {
            let room = (&mut self.off[..], &mut self.solved[..]);
            // what is allowed for grows with the moments
            let grown = factor.abs().max(1.0);
            let left = distance(&self.factor, (&self.estimate, &self.nominal), factor, room) / (grown * grown);
            if left < least {
                (least, self.found) = (left, Some(UrdfContradiction::Gravity { factor }));
            }
        }
        for (cause, beta) in &self.zeros {
            let room = (&mut self.off[..], &mut self.solved[..]);
            let left = distance(&self.factor, (&self.estimate, beta), 1.0, room); // (2)
            if left < least {
                (least, self.found) = (left, Some(*cause));
            }
        }
    }
}

/// χ² of (2) from a multiple of β.
fn distance(
    factor: &Cholesky,
    (estimate, beta): (&[f64], &[f64]),
    times: f64,
    (off, solved): (&mut [f64], &mut [f64]),
) -> f64 {
    for ((off, estimate), beta) in off.iter_mut().zip(estimate).zip(beta) {
        *off = estimate - times * beta;
    }
    solved.copy_from_slice(off);
    factor.solve(solved);
    dot(off, solved)
}

/// D of (1), row-major.
fn spread(model: &RobotModel, indices: &[usize]) -> Vec<f64> {
    let (robot, k) = (model.robot(), indices.len());
    let mut spread = vec![0.0; k * k];
    let rows: Vec<Vec<_>> = model.base().rows().map(Iterator::collect).collect();
    let factor = |index: usize, joint: usize, parameter: usize| -> f64 {
        let own = rows[index]
            .iter()
            .filter(|(standard, _)| standard.in_body() == Some((joint, parameter)));
        own.map(|(_, factor)| factor).sum()
    };
    let mut add = |v: &[f64]| {
        for i in 0..k {
            (0..k).for_each(|j| spread[i * k + j] += v[i] * v[j]);
        }
    };
    for (joint, body) in robot.bodies.iter().enumerate() {
        let of = |p: usize| indices.iter().map(move |i| (*i, p)).collect::<Vec<_>>();
        let column = |p: usize| -> Vec<f64> { of(p).into_iter().map(|(i, p)| factor(i, joint, p)).collect() };
        let columns: [Vec<f64>; 4] = std::array::from_fn(column);
        let mass: Vec<f64> = (0..k)
            .map(|i| DIFFERENCE * (0..4).map(|p| columns[p][i] * body.0[p]).sum::<f64>())
            .collect();
        add(&mass);
        let gyration = (0.5 * body.inertia().trace() * body.mass()).max(0.0).sqrt();
        for column in &columns[1..] {
            add(&column.iter().map(|x| DIFFERENCE * gyration * x).collect::<Vec<_>>());
        }
    }
    let largest = (0..k).map(|i| spread[i * (k + 1)]).fold(0.0, f64::max);
    (0..k).for_each(|i| spread[i * (k + 1)] += 1e-8 * largest);
    spread
}
