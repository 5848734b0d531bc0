//! A robot as a model that is linear in its parameters: base parameters, then the friction of each
//! joint.
//!
//! ```text
//! τ_i = d/dt [Y_p,i β + Ia_i q̇_i] − Y_L,i β + f_i(q̇_i, g_i)                                  (1)
//!     = d/dt (d_i · θ) + c_i · θ,        θ = (β, friction of joint 1, 2, …)                    (2)
//! ```
//!
//! Row i depends only on the parameters of the bodies after joint i and on the joint's friction;
//! d_i and c_i have entries for these, its *columns*.

use super::base_parameters::{BaseParameters, Standard};
use super::dynamics::inverse_dynamics;
use super::error::FrictionError;
use super::friction::{Engagement, FrictionTerm, JointFriction};
use super::offset_drift::DriftTerm;
use super::regressor::{EnergyRegressors, HeldSlopes, TILTS};
use super::scales::Scales;
use super::spatial::{BODY_PARAMETERS, BodyParameters};
use super::state::{FilteredSample, RobotSample};
use super::tree::Robot;
use super::unmodelled::{LeftOutTerm, Unmodelled};
use crate::model::MAX_JOINTS;
use std::ops::Range;

/// A parameter of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotParameter {
    /// Short name: `Izz3`, `coulomb_2`; joints are counted from 1.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// The combination that it stands for, or its meaning.
    pub meaning: String,
    /// Its value by the URDF, 0 for parameters that a URDF does not have.
    pub nominal: f64,
    /// Standard deviation that covers any machine of this size.
    pub scale: f64,
    /// Range of meaningful values.
    pub range: Meaningful,
}

/// The meaningful values of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaningful {
    /// Any.
    All,
    /// 0 and above; a negative value may be compensated by other terms, and alone has no meaning.
    NonNegative,
    /// 0 and above, because no machine has a negative value: that refutes the model.
    RefutedBelowZero,
    /// None: the parameter absorbs errors of others.
    None,
}

impl Meaningful {
    /// True if a value in this range can be used.
    pub fn holds(self, value: f64) -> bool {
        match self {
            Self::All => true,
            Self::NonNegative | Self::RefutedBelowZero => value >= 0.0,
            Self::None => false,
        }
    }

    /// True if no machine can have this value, which is known to within `margin`.
    pub fn refutes(self, value: f64, margin: f64) -> bool {
        self == Self::RefutedBelowZero && value < -margin
    }

    fn of_friction(term: FrictionTerm) -> Self {
        match term {
            FrictionTerm::Viscous => Self::NonNegative,
            FrictionTerm::Coulomb => Self::RefutedBelowZero,
            FrictionTerm::Reversal => Self::None,
            FrictionTerm::Offset | FrictionTerm::Load | FrictionTerm::Stribeck => Self::All,
            FrictionTerm::Spring | FrictionTerm::Drag | FrictionTerm::Asymmetric => Self::All,
        }
    }
}

/// Standard deviations that cover any error of a zero or of the base \[rad\], and any delay \[s\].
const ANGLE_SCALE: f64 = 0.1;
const DELAY_SCALE: f64 = 0.02;
/// Factor on the speed of Stribeck friction, up or down, of the two columns that stand for another.
const STRIBECK_FACTOR: f64 = 3.0;

/// Origin of a column of a joint's row.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Column {
    /// Entry of the regressors.
    Body(usize),
    /// The joint's own rotor.
    Rotor,
    /// Term of the joint's own friction.
    Friction(usize),
    /// Stribeck friction with this times its speed.
    Stribeck(f64),
    /// Derivative of the joint's weight with respect to a position or a tilt.
    Slope(usize),
    /// Derivative of the joint's measured torque.
    Delay,
    /// Time since the start, which is known of windows and not of samples.
    Elapsed,
}

/// A robot with its friction as a linear model; made by [`new`](Self::new).
#[derive(Debug, Clone)]
pub struct RobotModel {
    robot: Robot,
    base: BaseParameters,
    friction: Vec<JointFriction>,
    /// The same with the terms beyond those of the model.
    built: Vec<JointFriction>,
    parameters: Vec<RobotParameter>,
    columns: Vec<Vec<Column>>,
    indices: Vec<Vec<usize>>,
    first_friction: Vec<usize>,
    has_load: bool,
    /// True if rows have columns of the weight's derivatives.
    has_slopes: bool,
}

impl RobotModel {
    /// A model of a robot, with or without rotor inertias, and with the friction of each joint.
    ///
    /// # Errors
    /// If friction is not given for each joint, or is invalid.
    pub fn new(robot: Robot, rotors: bool, friction: Vec<JointFriction>) -> Result<Self, FrictionError> {
        let n = robot.len();
        if friction.len() != n {
            return Err(FrictionError::Joints {
                expected: n,
                got: friction.len(),
            });
        }
        for (joint, friction) in robot.joints.iter().zip(&friction) {
            friction.validate().map_err(|source| FrictionError::Joint {
                joint: joint.name.clone(),
                source: Box::new(source),
            })?;
        }
        let base = BaseParameters::of(&robot, rotors);
        let nominal = base.nominal(&robot, &vec![0.0; n]);
        let scales = Scales::of(&robot);
        let mut parameters: Vec<RobotParameter> = base
            .parameters
            .iter()
            .zip(nominal)
            .map(|(parameter, nominal)| RobotParameter {
                name: parameter.leading.name(),
                unit: parameter.leading.unit(&robot),
                meaning: parameter.combination(),
                nominal,
                scale: scales.base(parameter),
                range: Meaningful::All,
            })
            .collect();
        let mut columns = vec![Vec::new(); n];
        let mut indices = vec![Vec::new(); n];
        for (index, parameter) in base.parameters.iter().enumerate() {
            match parameter.leading {
                Standard::Body { joint, parameter } => {
                    // Each joint from the body to the base.
                    let mut next = Some(joint);
                    while let Some(i) = next {
                        columns[i].push(Column::Body(joint * BODY_PARAMETERS + parameter));
                        indices[i].push(index);
                        next = robot.joints[i].parent;
                    }
                }
                Standard::Rotor { joint } => {
                    columns[joint].push(Column::Rotor);
                    indices[joint].push(index);
                }
            }
        }
        let mut first_friction = Vec::with_capacity(n);
        for i in 0..n {
            first_friction.push(parameters.len());
            for (k, term) in friction[i].terms.iter().enumerate() {
                columns[i].push(Column::Friction(k));
                indices[i].push(parameters.len());
                parameters.push(RobotParameter {
                    name: format!("{}_{}", term.name(), i + 1),
                    unit: term.unit(robot.joints[i].turns),
                    meaning: format!("{} of {}", term.meaning(), robot.joints[i].name),
                    nominal: 0.0,
                    scale: scales.friction(i, *term),
                    range: Meaningful::of_friction(*term),
                });
            }
        }
        Ok(Self {
            has_load: has_load(&friction),
            has_slopes: false,
            robot,
            base,
            built: friction.clone(),
            friction,
            parameters,
            columns,
            indices,
            first_friction,
        })
    }

    /// The same model with longer rows: after its own columns each joint has those of the friction
    /// terms that it leaves out and of Stribeck friction over other speeds, then those of errors of
    /// sensors and base that all joints share, with indices from `first` on, then that of the time
    /// if the joint has an offset. They are not parameters.
    pub(super) fn with_left_out(&self, first: usize) -> (Self, Vec<LeftOutTerm>, Vec<DriftTerm>) {
        let (mut wide, mut left_out) = (self.clone(), Vec::new());
        let scales = Scales::of(&self.robot);
        for (joint, built) in wide.built.iter_mut().enumerate() {
            for (_, term) in FrictionTerm::NAMES {
                if built.terms.contains(&term) {
                    continue;
                }
                let index = first + left_out.len();
                wide.columns[joint].push(Column::Friction(built.terms.len()));
                wide.indices[joint].push(index);
                built.terms.push(term);
                left_out.push(LeftOutTerm {
                    what: Unmodelled::Friction { joint, term },
                    index,
                    scale: scales.friction(joint, term),
                });
            }
            if self.friction[joint].terms.contains(&FrictionTerm::Stribeck) {
                for (higher, factor) in [(false, STRIBECK_FACTOR.recip()), (true, STRIBECK_FACTOR)] {
                    let index = first + left_out.len();
                    wide.columns[joint].push(Column::Stribeck(factor));
                    wide.indices[joint].push(index);
                    left_out.push(LeftOutTerm {
                        what: Unmodelled::StribeckSpeed { joint, higher },
                        index,
                        scale: scales.friction(joint, FrictionTerm::Stribeck),
                    });
                }
            }
        }
        wide.has_load = has_load(&wide.built);
        let n = self.robot.len();
        let turning = (0..n).filter(|&joint| self.robot.joints[joint].turns);
        let zeros = turning.map(|joint| (Unmodelled::Zero { joint }, Column::Slope(joint), ANGLE_SCALE));
        let tilts = (0..TILTS).map(|tilt| (Unmodelled::Tilt, Column::Slope(n + tilt), ANGLE_SCALE));
        let shared = zeros
            .chain(tilts)
            .chain([(Unmodelled::Delay, Column::Delay, DELAY_SCALE)]);
        for (what, column, scale) in shared {
            let index = first + left_out.len();
            for joint in 0..n {
                wide.columns[joint].push(column);
                wide.indices[joint].push(index);
            }
            left_out.push(LeftOutTerm { what, index, scale });
        }
        wide.has_slopes = true;
        let mut drifts = Vec::new();
        for joint in 0..n {
            let (own, terms) = (self.friction_of(joint), &self.friction[joint].terms);
            let column = self.columns[joint].len() - own.len();
            let index = first + left_out.len() + drifts.len();
            let scale = scales.friction(joint, FrictionTerm::Offset);
            if let Some(drift) = DriftTerm::of(joint, terms, (column, own.start), index, scale) {
                wide.columns[joint].push(Column::Elapsed);
                wide.indices[joint].push(index);
                drifts.push(drift);
            }
        }
        (wide, left_out, drifts)
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Its base parameters; they are the first parameters of the model.
    pub fn base(&self) -> &BaseParameters {
        &self.base
    }

    /// Friction of each joint.
    pub fn friction(&self) -> &[JointFriction] {
        &self.friction
    }

    /// The parameters θ.
    pub fn parameters(&self) -> &[RobotParameter] {
        &self.parameters
    }

    /// Indices in θ of the columns of a joint's row, ascending.
    pub fn columns(&self, joint: usize) -> &[usize] {
        &self.indices[joint]
    }

    /// Indices in θ of a joint's friction.
    pub fn friction_of(&self, joint: usize) -> Range<usize> {
        let first = self.first_friction[joint];
        first..first + self.friction[joint].terms.len()
    }

    /// Index in θ of a term of a joint's friction; `None` if the model does not have it.
    pub fn friction_term(&self, joint: usize, term: FrictionTerm) -> Option<usize> {
        let place = self.friction[joint].terms.iter().position(|own| *own == term)?;
        Some(self.first_friction[joint] + place)
    }

    /// The columns of a joint's row that are of its friction.
    pub(super) fn friction_columns(&self, joint: usize) -> Range<usize> {
        let end = self.indices[joint].len();
        end - self.friction[joint].terms.len()..end
    }

    /// (2): writes d_i and c_i of all joints, one after the other, at a state; `engagement` is
    /// that of each joint's friction, [`JointFriction::engagement`].
    pub fn rows(
        &self,
        regressors: &mut EnergyRegressors,
        q: &[f64],
        dq: &[f64],
        engagement: &[Engagement],
        differentiated: &mut [f64],
        direct: &mut [f64],
    ) {
        let mut sample = RobotSample::default();
        sample.q[..q.len()].copy_from_slice(q);
        sample.dq[..dq.len()].copy_from_slice(dq);
        let mut slopes = HeldSlopes::new(0.0);
        self.rows_of(regressors, &mut slopes, &sample, engagement, differentiated, direct);
    }

    /// The same for a sample, including the columns beyond those of the model, if there are any.
    pub(super) fn rows_of(
        &self,
        regressors: &mut EnergyRegressors,
        held: &mut HeldSlopes,
        sample: &RobotSample,
        engagement: &[Engagement],
        differentiated: &mut [f64],
        direct: &mut [f64],
    ) {
        let n = self.robot.len();
        let (q, dq) = (&sample.q[..n], &sample.dq[..n]);
        regressors.evaluate(&self.robot, q, dq);
        if self.has_slopes {
            held.renew(sample.t_s, regressors, &self.robot);
        }
        let mut weight = [0.0; MAX_JOINTS];
        if self.has_load {
            regressors.weight(&self.robot.bodies, &mut weight[..self.robot.len()]);
        }
        let mut at = 0;
        for i in 0..self.robot.len() {
            let (momentum, lagrangian) = (regressors.momentum(i), regressors.lagrangian(i));
            let mut friction = [0.0; FrictionTerm::NAMES.len()];
            self.built[i].row(q[i], dq[i], engagement[i], weight[i], &mut friction);
            for column in &self.columns[i] {
                (differentiated[at], direct[at]) = match *column {
                    Column::Body(entry) => (momentum[entry], -lagrangian[entry]), // (1)
                    Column::Rotor => (dq[i], 0.0),                                // (1)
                    Column::Friction(term) => (0.0, friction[term]),              // (1)
                    Column::Stribeck(factor) => (0.0, self.built[i].stribeck(dq[i], engagement[i], factor)),
                    // change of the torque by a position or direction that is too large by 1,
                    // negated
                    Column::Slope(of) => (0.0, -held.slopes[of][i]),
                    // τ measured 1 s late is τ − τ̇
                    Column::Delay => (-sample.tau[i], 0.0),
                    Column::Elapsed => (0.0, 0.0),
                };
                at += 1;
            }
        }
    }

    /// True if the last column of a joint's rows is the time since the start.
    pub(super) fn ends_with_time(&self, joint: usize) -> bool {
        self.columns[joint].last() == Some(&Column::Elapsed)
    }

    /// Index of the column of the joint's own rotor, among its columns.
    pub(super) fn rotor_column(&self, joint: usize) -> Option<usize> {
        self.columns[joint]
            .iter()
            .position(|column| matches!(column, Column::Rotor))
    }

    /// Entry (j, k) of the mass matrix with parameters `theta`, at the last evaluated state.
    pub(super) fn inertia(&self, regressors: &EnergyRegressors, (j, k): (usize, usize), theta: &[f64]) -> f64 {
        let mut sum = 0.0;
        self.inertia_row(regressors, (j, k), |at, x| sum += x * theta[self.indices[j][at]]);
        sum
    }

    /// Adds `factor` times the row whose product with θ is entry (j, k) of the mass matrix, over
    /// the columns of j.
    pub(super) fn add_inertia_row(
        &self,
        regressors: &EnergyRegressors,
        (j, k): (usize, usize),
        factor: f64,
        row: &mut [f64],
    ) {
        self.inertia_row(regressors, (j, k), |at, x| row[at] += factor * x);
    }

    /// The entries of that row that are not 0.
    fn inertia_row(&self, regressors: &EnergyRegressors, (j, k): (usize, usize), mut take: impl FnMut(usize, f64)) {
        let mut of_body = (usize::MAX, None);
        for (at, column) in self.columns[j].iter().enumerate() {
            match *column {
                Column::Body(entry) => {
                    let body = entry / BODY_PARAMETERS;
                    if of_body.0 != body {
                        of_body = (body, regressors.inertia(body, j, k));
                    }
                    if let Some(row) = of_body.1 {
                        take(at, row[entry % BODY_PARAMETERS]);
                    }
                }
                Column::Rotor if j == k => take(at, 1.0),
                Column::Rotor | Column::Friction(_) | Column::Stribeck(_) => {}
                Column::Slope(_) | Column::Delay | Column::Elapsed => {}
            }
        }
    }

    /// g: torque that holds the URDF's bodies at rest, for load-dependent friction; 0 if no joint
    /// has any.
    fn weight(&self, q: &[f64], weight: &mut [f64]) {
        if self.has_load {
            let still = [0.0; MAX_JOINTS];
            let still = &still[..q.len()];
            inverse_dynamics(&self.robot, &self.robot.bodies, q, still, still, weight);
        }
    }

    /// Number of entries that [`rows`](Self::rows) writes.
    pub fn row_entries(&self) -> usize {
        self.columns.iter().map(Vec::len).sum()
    }

    /// The torques of the drives at one state with parameters `theta`, for comparison with a log.
    pub fn torques(&self, theta: &[f64], state: &FilteredSample, tau: &mut [f64]) {
        let FilteredSample {
            q, dq, ddq, engagement, ..
        } = state;
        let n = self.robot.len();
        let mut bodies = [BodyParameters::default(); MAX_JOINTS];
        let mut rotors = [0.0; MAX_JOINTS];
        for (parameter, value) in self.base.parameters.iter().zip(theta) {
            match parameter.leading {
                Standard::Body { joint, parameter } => bodies[joint].0[parameter] = *value,
                Standard::Rotor { joint } => rotors[joint] = *value,
            }
        }
        inverse_dynamics(&self.robot, &bodies[..n], &q[..n], &dq[..n], &ddq[..n], tau);
        let mut weight = [0.0; MAX_JOINTS];
        self.weight(&q[..n], &mut weight[..n]);
        for i in 0..n {
            let friction = self.friction[i].torque(q[i], dq[i], engagement[i], weight[i], &theta[self.friction_of(i)]);
            tau[i] += rotors[i] * ddq[i] + friction; // (1)
        }
    }
}

fn has_load(friction: &[JointFriction]) -> bool {
    friction.iter().any(|f| f.terms.contains(&FrictionTerm::Load))
}
