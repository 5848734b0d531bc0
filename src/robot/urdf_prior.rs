//! The gravity parameters of the URDF as a prior that allows for ordinary errors of masses and
//! centres, but not for a wrong gravity or zero.
//!
//! ```text
//! d = β̂ − β₀ ~ N(0, C),    C = P + D,    D = Σ_b s² v_b v_bᵀ + Σ_b,a (s m_b r_b)² u_ba u_baᵀ      (1)
//! χ²(β) = (β̂ − β)ᵀ C⁻¹ (β̂ − β)                                                               (2)
//! c = β₀ᵀ C⁻¹ β̂ / β₀ᵀ C⁻¹ β₀:    gravity is c times the configured one                           (3)
//! β_jα = argmin Σ_q ‖W [G(q) β − g(q − α e_j)]‖²:    joint j has another zero, by α             (4)
//! β_j± = argmin Σ_q ‖W [G(q) β − S_j g(R_j q)]‖²:    a sign of joint j is wrong                 (5)
//! β_k = argmin Σ_q ‖W [G(q) β − g_k(q)]‖²:    gravity has direction k of the base                (6)
//! ```
//!
//! β are the base parameters for masses and first moments that affect gravity torques, and the
//! constant forces (`offset`) of prismatic joints, which hide the effect of gravity on them; β₀ are
//! those of the URDF, 0 for a constant force, and P is the covariance of the estimates. The
//! standard deviation of each body's mass is s = 0.3 of it (v_b is its contribution to β₀), and
//! that of its centre is s times its radius of gyration about the joint, in each direction (u_ba),
//! so errors of 50 % are ordinary. Such errors are independent between bodies, and no body's moment
//! is reversed; under a wrong gravity or zero all moments after it are scaled or rotated together.
//! A constant force has a standard deviation of s times the weight that the joint carries, or a
//! third of that if the axis is perpendicular to gravity.
//!
//! In (5), R_j reverses the sign of position j and S_j that of torque j: the torque, the position,
//! or both (the axis) are reversed. W weights each joint's rows by the mean square of its weight.
//!
//! A cause is accepted if its χ² is smaller than χ²(β₀) by [`CLEAR`] and less than a quarter of it;
//! a zero, or another magnitude of gravity, only if χ²(β₀) also exceeds chance, because a heavy
//! undeclared tool resembles them. For a sign 12 suffices if almost nothing remains: the wrist of a
//! common arm gives 16 to 24, and no ordinary error reverses a moment. G is the regressor of
//! gravity and g the URDF's weight at random positions. A torque in another unit scales inertias
//! together with the moments, which gravity does not: (3) then does not apply.

use super::friction::FrictionTerm;
use super::model::RobotModel;
use super::regressor::EnergyRegressors;
use super::spatial::BODY_PARAMETERS;
use super::tree::Robot;
use crate::estimator::linalg::{Cholesky, dot};
use crate::model::MAX_JOINTS;
use crate::random::Random;
use nalgebra::{DMatrix, DVector, Vector3};
use std::f64::consts::PI;
use std::fmt;
use std::ops::Range;

/// s.
const DIFFERENCE: f64 = 0.3;
/// χ² by which a cause must be better than a correct URDF: a Bayes factor of e¹⁰.
const CLEAR: f64 = 20.0;
/// Largest share of χ² that may remain with a cause.
const LEFT: f64 = 0.25;
/// The same for a sign: a Bayes factor of e⁶, with almost nothing remaining.
const CLEAR_SIGN: f64 = 12.0;
const LEFT_SIGN: f64 = 0.15;
/// χ² by which a cause must be better than one tested before it.
const ALIKE: f64 = 1.0;
/// Angles by which a zero may be off [degrees].
const TURNS: [i32; 7] = [-135, -90, -45, 45, 90, 135, 180];
/// Number of positions in (4), and their seed.
const STATES: usize = 60;
const SEED: u64 = 0x7572_6466;
/// Smallest effect of gravity on a column, relative to the largest moment's.
const SEEN: f64 = 1e-6;
/// Largest share of the weight in another direction that moments and constant forces may leave
/// unexplained.
const IMITATED: f64 = 0.3;
/// Cosine below which gravity has another direction.
const ACROSS: f64 = 0.7;
/// Lower limit of a joint's weight, relative to the largest joint's.
const LEAST_WEIGHT: f64 = 0.01;
/// (3) for a gravity of the wrong sign; for one in g instead of m/s², and vice versa.
const REVERSED: Range<f64> = -2.5..-0.4;
const IN_G: [Range<f64>; 2] = [5.0..20.0, 0.05..0.2];
/// If inertias are off by the same factor as moments, to within this one, the unit is wrong.
const SAME: f64 = 3.0;

/// A fundamental contradiction of the URDF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UrdfContradiction {
    /// Gravity is a multiple of the configured one.
    Gravity {
        /// c of (3).
        factor: f64,
    },
    /// A joint's position has an offset, or its frame in the URDF is rotated.
    Zero {
        /// The joint, counted from 0.
        joint: usize,
        /// Approximate angle.
        degrees: i32,
    },
    /// Gravity has another direction than the configured one.
    Direction {
        /// Along this axis of the base: 0 for x, 1 for y, 2 for z.
        axis: usize,
        /// Along its negative direction.
        negative: bool,
    },
    /// A joint's torque, position or axis is reversed.
    Sign {
        /// The joint, counted from 0.
        joint: usize,
        /// The reversed quantity.
        of: Reversed,
    },
}

/// The reversed quantity of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reversed {
    /// Its torque.
    Torque,
    /// Its position and velocity.
    Position,
    /// Both: the axis in the URDF.
    Axis,
}

impl UrdfContradiction {
    /// All that are tested of a robot, except another magnitude of gravity.
    fn all(robot: &Robot) -> Vec<Self> {
        let of_joint = |joint: usize| Self::of(joint, robot.joints[joint].turns);
        let of_joints = (0..robot.len()).flat_map(of_joint);
        of_joints.chain(Self::instead_of(robot.gravity)).collect()
    }

    /// Possible contradictions at a joint.
    fn of(joint: usize, turns: bool) -> impl Iterator<Item = Self> {
        let zeros = TURNS.map(move |degrees| Self::Zero { joint, degrees });
        let signs = [Reversed::Torque, Reversed::Position, Reversed::Axis].map(move |of| Self::Sign { joint, of });
        zeros.into_iter().filter(move |_| turns).chain(signs)
    }

    /// Directions that gravity may have instead of this one.
    fn instead_of(gravity: Vector3<f64>) -> impl Iterator<Item = Self> {
        let all = (0..3).flat_map(|axis| [false, true].map(|negative| Self::Direction { axis, negative }));
        let along = gravity.try_normalize(f64::MIN_POSITIVE).unwrap_or_default();
        let is_across = move |axis: usize| gravity != Vector3::zeros() && along[axis].abs() < ACROSS;
        all.filter(move |cause| matches!(*cause, Self::Direction { axis, .. } if is_across(axis)))
    }

    /// The robot with the gravity of (6).
    fn robot(self, robot: &Robot) -> Robot {
        let mut robot = robot.clone();
        if let Self::Direction { axis, negative } = self {
            let size = robot.gravity.norm();
            robot.gravity = Vector3::zeros();
            robot.gravity[axis] = if negative { -size } else { size };
        }
        robot
    }

    /// R_j q of (5), or q − α e_j of (4); returns the joint whose torque is reversed.
    fn apply(self, q: &mut [f64]) -> Option<usize> {
        match self {
            Self::Gravity { .. } | Self::Direction { .. } => None,
            Self::Zero { joint, degrees } => {
                q[joint] -= f64::from(degrees).to_radians();
                None
            }
            Self::Sign { joint, of } => {
                if of != Reversed::Torque {
                    q[joint] = -q[joint];
                }
                (of != Reversed::Position).then_some(joint)
            }
        }
    }
}

impl fmt::Display for UrdfContradiction {
    /// Rounded, so that the text does not change with every block.
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
            Self::Direction { axis, negative } => write!(
                f,
                "gravity seems to have the direction {}{} of the base: look at model.gravity_m_per_s2",
                if negative { '-' } else { '+' },
                ['x', 'y', 'z'][axis]
            ),
            Self::Sign { joint, of } => {
                let what = match of {
                    Reversed::Torque => "sign of its torque, and gravity",
                    Reversed::Position => "sign of its position",
                    Reversed::Axis => "axis in the URDF",
                };
                write!(
                    f,
                    "moments from joint {} on are the other way round than the URDF's: look at the {what}",
                    joint + 1
                )
            }
        }
    }
}

/// Gravity moments at random positions; row `n s + i` is joint i at position s.
struct GravityMoments {
    /// G(q): one column per parameter.
    g: DMatrix<f64>,
    /// What the URDF's bodies give if a cause is true, at q − α e_j for (4): one column per cause.
    weights: DMatrix<f64>,
    /// Root mean square of each joint's moment according to the URDF.
    means: Vec<f64>,
}

impl GravityMoments {
    /// `parameters` as (index, (joint, parameter of its body)).
    fn new(robot: &Robot, parameters: &[(usize, (usize, usize))], causes: &[UrdfContradiction]) -> Self {
        let n = robot.len();
        let mut regressors = EnergyRegressors::new(n);
        let mut random = Random(SEED);
        let still = [0.0; MAX_JOINTS];
        let robots: Vec<Robot> = causes.iter().map(|cause| cause.robot(robot)).collect();
        let mut g = DMatrix::zeros(STATES * n, parameters.len());
        let mut weights = DMatrix::zeros(STATES * n, causes.len());
        let mut own = DMatrix::zeros(n, STATES);
        let mut weight = [0.0; MAX_JOINTS];
        for state in 0..STATES {
            let q: Vec<f64> = (0..n).map(|_| random.within(PI)).collect();
            regressors.evaluate(robot, &q, &still[..n]);
            for (column, (_, (joint, parameter))) in parameters.iter().enumerate() {
                for i in 0..n {
                    g[(state * n + i, column)] = -regressors.lagrangian(i)[joint * BODY_PARAMETERS + parameter];
                }
            }
            regressors.weight(&robot.bodies, &mut weight[..n]);
            own.column_mut(state).copy_from_slice(&weight[..n]);
            for (column, cause) in causes.iter().enumerate() {
                let mut other = q.clone();
                let turned = cause.apply(&mut other);
                regressors.evaluate(&robots[column], &other, &still[..n]);
                regressors.weight(&robot.bodies, &mut weight[..n]);
                for i in 0..n {
                    weights[(state * n + i, column)] = if turned == Some(i) { -weight[i] } else { weight[i] };
                }
            }
        }
        let means = own.row_iter().map(|row| row.norm() / (STATES as f64).sqrt()).collect();
        Self { g, weights, means }
    }

    /// Weights the rows by W; returns the factor of each joint.
    fn weight_rows(&mut self) -> Vec<f64> {
        let heaviest = self.means.iter().copied().fold(0.0, f64::max);
        let factor = |mean: &f64| 1.0 / mean.max(LEAST_WEIGHT * heaviest).max(f64::MIN_POSITIVE);
        let factors: Vec<f64> = self.means.iter().map(factor).collect();
        for row in 0..self.g.nrows() {
            self.g.row_mut(row).scale_mut(factors[row % factors.len()]);
            self.weights.row_mut(row).scale_mut(factors[row % factors.len()]);
        }
        factors
    }
}

/// Indices of the parameters that lead with one of these parameters of a body, as (index, (joint,
/// parameter of its body)).
fn parameters_of_bodies(model: &RobotModel, wanted: Range<usize>) -> Vec<(usize, (usize, usize))> {
    let leading = model.base().parameters.iter().map(|parameter| parameter.leading);
    let of_bodies = leading
        .enumerate()
        .filter_map(|(i, leading)| leading.in_body().map(|at| (i, at)));
    of_bodies
        .filter(|(_, (_, parameter))| wanted.contains(parameter))
        .collect()
}

/// The constant force of a prismatic joint, which hides the effect of gravity on it.
struct ConstantForce {
    joint: usize,
    /// Its index among the parameters.
    index: usize,
    variance: f64,
}

/// The constant forces of a model; `means` are the root mean squares of its joints' moments.
fn constant_forces<'a>(model: &'a RobotModel, means: &'a [f64]) -> impl Iterator<Item = ConstantForce> + 'a {
    let robot = model.robot();
    let slides = (0..robot.len()).filter(|joint| !robot.joints[*joint].turns);
    slides.flat_map(move |joint| {
        let weight = carried(robot, joint) * robot.gravity.norm();
        let variance = (DIFFERENCE * means[joint].max(weight / 3.0)).powi(2);
        let terms = model.friction()[joint].terms.iter().zip(model.friction_of(joint));
        terms
            .filter(|(term, _)| **term == FrictionTerm::Offset)
            .map(move |(_, index)| ConstantForce { joint, index, variance })
    })
}

/// β of (4), (5) and (6) for each cause that moments can imitate. `weights` has one column per
/// cause, and `g` one per moment and constant force, with the values β₀ in `nominal` and the
/// covariance D in `spread`.
fn imitations(
    causes: Vec<UrdfContradiction>,
    weights: &DMatrix<f64>,
    g: &DMatrix<f64>,
    nominal: &[f64],
    spread: &[f64],
) -> Vec<(UrdfContradiction, Vec<f64>)> {
    let (k, start) = (nominal.len(), DVector::from_column_slice(nominal));
    // of parameters that gravity cannot distinguish, those that the URDF knows best stay
    let Some(sure) = DMatrix::from_row_slice(k, k, spread).cholesky().map(|d| d.inverse()) else {
        return Vec::new();
    };
    let size = g.norm_squared() / k.max(1) as f64;
    let sure = &sure * (SEEN * size / sure.norm().max(f64::MIN_POSITIVE));
    let Some(factor) = (g.tr_mul(g) + sure).cholesky() else {
        return Vec::new();
    };
    let mut imitated = Vec::new();
    for (column, cause) in causes.into_iter().enumerate() {
        let wanted = weights.column(column) - g * &start;
        let beta = &start + factor.solve(&g.tr_mul(&wanted)); // (4), (5), (6)
        let left = (weights.column(column) - g * &beta).norm() / weights.column(column).norm();
        // a direction that moments cannot imitate causes a misfit instead
        if left < IMITATED || !matches!(cause, UrdfContradiction::Direction { .. }) {
            imitated.push((cause, beta.as_slice().to_vec()));
        }
    }
    imitated
}

/// β₀, D and β_jα, and the workspace of the test.
#[derive(Debug, Clone)]
pub(super) struct UrdfPrior {
    /// Indices of the parameters β, and of the inertias.
    pub indices: Vec<usize>,
    pub inertias: Vec<usize>,
    nominal: Vec<f64>,
    spread: Vec<f64>,
    /// The causes of (4) to (6).
    causes: Vec<(UrdfContradiction, Vec<f64>)>,
    factor: Cholesky,
    /// C, filled by the caller with P.
    pub covariance: Vec<f64>,
    /// β̂.
    pub estimate: Vec<f64>,
    off: Vec<f64>,
    solved: Vec<f64>,
    /// The last result.
    pub found: Option<UrdfContradiction>,
}

impl UrdfPrior {
    /// The prior of a model's URDF.
    pub fn new(model: &RobotModel) -> Self {
        let robot = model.robot();
        let moments = parameters_of_bodies(model, 0..4);
        let causes = UrdfContradiction::all(robot);
        let mut gravity = GravityMoments::new(robot, &moments, &causes);
        let factors = gravity.weight_rows();
        let norms = gravity.g.column_iter().map(|column| column.norm());
        let largest = norms.fold(0.0, f64::max);
        let has_weight = largest > 0.0;
        let seen: Vec<usize> = (0..moments.len())
            .filter(|column| gravity.g.column(*column).norm() > SEEN * largest.max(f64::MIN_POSITIVE))
            .collect();
        let mut indices: Vec<usize> = seen.iter().map(|column| moments[*column].0).collect();
        let mut nominal: Vec<f64> = indices.iter().map(|i| model.parameters()[*i].nominal).collect();
        let mut g = gravity.g.select_columns(&seen);
        let mut variances = Vec::new();
        for force in constant_forces(model, &gravity.means).filter(|_| has_weight) {
            indices.push(force.index);
            nominal.push(0.0);
            variances.push(force.variance);
            let (column, joint) = (g.ncols(), force.joint);
            g = g.insert_column(column, 0.0);
            (0..STATES).for_each(|state| g[(state * robot.len() + joint, column)] = factors[joint]);
        }
        let spread = spread(model, &indices[..seen.len()], &variances);
        let imitated = match has_weight {
            true => imitations(causes, &gravity.weights, &g, &nominal, &spread),
            false => Vec::new(),
        };
        let inertias = parameters_of_bodies(model, 4..BODY_PARAMETERS);
        let k = indices.len();
        Self {
            spread,
            inertias: inertias.into_iter().map(|(i, _)| i).collect(),
            nominal,
            causes: imitated,
            factor: Cholesky::new(k),
            covariance: vec![0.0; k * k],
            estimate: vec![0.0; k],
            off: vec![0.0; k],
            solved: vec![0.0; k],
            found: None,
            indices,
        }
    }

    /// Tests all causes. `inertias` is the factor of the inertias relative to the URDF's.
    pub fn test(&mut self, inertias: f64) {
        self.found = None;
        let k = self.indices.len();
        self.covariance.iter_mut().zip(&self.spread).for_each(|(c, d)| *c += d); // (1)
        if k == 0 || !self.factor.factor(k, &self.covariance) {
            return;
        }
        let room = (&mut self.off[..], &mut self.solved[..]);
        let before = distance(&self.factor, (&self.estimate, &self.nominal), 1.0, room);
        if !(before > CLEAR_SIGN) {
            return;
        }
        let is_beyond_chance = before > k as f64 + CLEAR;
        let mut least = before;
        self.solved.copy_from_slice(&self.nominal);
        self.factor.solve(&mut self.solved);
        let factor = dot(&self.solved, &self.estimate) / dot(&self.solved, &self.nominal); // (3)
        let is_unit = inertias > 0.0 && (factor / inertias).max(inertias / factor) < SAME;
        let is_in_g = IN_G.iter().any(|range| range.contains(&factor)) && !is_unit && is_beyond_chance;
        let is_reversed = REVERSED.contains(&factor);
        let of_sign = (LEFT_SIGN * before).min(before - CLEAR_SIGN);
        let of_size = (LEFT * before).min(before - CLEAR);
        if is_reversed || is_in_g {
            let room = (&mut self.off[..], &mut self.solved[..]);
            // the allowance grows with the moments
            let grown = factor.abs().max(1.0);
            let left = distance(&self.factor, (&self.estimate, &self.nominal), factor, room) / (grown * grown);
            if left < if is_reversed { of_sign } else { of_size } {
                (least, self.found) = (left, Some(UrdfContradiction::Gravity { factor }));
            }
        }
        for (cause, beta) in &self.causes {
            let most = match cause {
                UrdfContradiction::Sign { .. } => of_sign,
                UrdfContradiction::Zero { .. } if !is_beyond_chance => continue,
                _ => of_size,
            };
            let room = (&mut self.off[..], &mut self.solved[..]);
            let left = distance(&self.factor, (&self.estimate, beta), 1.0, room); // (2)
            if left < most.min(least - ALIKE) {
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

/// Mass that a joint carries \[kg\].
fn carried(robot: &Robot, joint: usize) -> f64 {
    let is_behind = |body: &usize| {
        let mut at = Some(*body);
        while at.is_some_and(|own| own > joint) {
            at = at.and_then(|own| robot.joints[own].parent);
        }
        at == Some(joint)
    };
    let bodies = (0..robot.len()).filter(is_behind);
    bodies.map(|body| robot.bodies[body].mass()).sum()
}

/// D of (1), row-major, of these moments and of constant forces with these variances.
fn spread(model: &RobotModel, indices: &[usize], constant: &[f64]) -> Vec<f64> {
    let (robot, moments) = (model.robot(), indices.len());
    let k = moments + constant.len();
    let mut spread = vec![0.0; k * k];
    let rows: Vec<Vec<_>> = model.base().rows().map(Iterator::collect).collect();
    let factor = |index: usize, joint: usize, parameter: usize| -> f64 {
        let own = rows[index]
            .iter()
            .filter(|(standard, _)| standard.in_body() == Some((joint, parameter)));
        own.map(|(_, factor)| factor).sum()
    };
    let mut add = |v: &[f64]| {
        for i in 0..moments {
            (0..moments).for_each(|j| spread[i * k + j] += v[i] * v[j]);
        }
    };
    for (joint, body) in robot.bodies.iter().enumerate() {
        let of = |p: usize| indices.iter().map(move |i| (*i, p)).collect::<Vec<_>>();
        let column = |p: usize| -> Vec<f64> { of(p).into_iter().map(|(i, p)| factor(i, joint, p)).collect() };
        let columns: [Vec<f64>; 4] = std::array::from_fn(column);
        let mass: Vec<f64> = (0..moments)
            .map(|i| DIFFERENCE * (0..4).map(|p| columns[p][i] * body.0[p]).sum::<f64>())
            .collect();
        add(&mass);
        let gyration = (0.5 * body.inertia().trace() * body.mass()).max(0.0).sqrt();
        for column in &columns[1..] {
            add(&column.iter().map(|x| DIFFERENCE * gyration * x).collect::<Vec<_>>());
        }
    }
    let largest = (0..moments).map(|i| spread[i * (k + 1)]).fold(0.0, f64::max);
    for (own, variance) in constant.iter().enumerate() {
        spread[(moments + own) * (k + 1)] = *variance;
    }
    (0..moments).for_each(|i| spread[i * (k + 1)] += 1e-8 * largest);
    spread
}
