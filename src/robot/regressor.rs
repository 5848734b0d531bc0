//! Momentum and Lagrangian regressors of a robot, by one recursive pass from the base to the tips.
//!
//! With J_ki the unit motion of joint i as seen by body k, v_k the velocity of body k, I_k π-linear
//! as in (4) of [`spatial`](super::spatial), and g gravity in the frame of body k:
//!
//! ```text
//! v_k = X_k v_λ(k) + s_k q̇_k,    J_ki = X_k J_λ(k),i,    J_kk = s_k                          (1)
//! p_i     = Σ_{k ≥ i} J_ki · (I_k v_k)                        = Y_p π,  p = ∂T/∂q̇ = M q̇      (2)
//! ∂T/∂q_i = Σ_{k ≥ i} (v_λ(i) × J_ki) · (I_k v_k)                                              (3)
//! ∂V/∂q_i = −Σ_{k ≥ i} [m J_l·g + h·(g × J_a)]                                                 (4)
//! Y_L π   = ∂(T − V)/∂q,         τ = d/dt (Y_p π) − Y_L π                                      (5)
//! ```
//!
//! The gravity torques change with the zero of an encoder and with the direction of gravity. With m
//! and h those of joint j and all bodies that it carries:
//!
//! ```text
//! u_j = m J_l,jj + J_a,jj × h,    ∂V/∂q_j = −g·u_j                                            (6)
//! ∂²V/∂q_i ∂q_j = −J_a,ji·(u_j × g)    for i on the path of j                                  (7)
//! ∂²V/∂α ∂q_j = −|g| e·u_j    if gravity turns towards the horizontal direction e by α         (8)
//! ```
//!
//! No acceleration enters, as the weak form requires. v_λ(i) × J_ki is transformed like J_ki
//! itself, so both are carried along. Sources: P. Hsu, M. Bodson, S. Sastry, B. Paden, ICRA 1987;
//! M. Gautier, IROS 1997; H. Wang, Automatica 2012.

use super::spatial::{BODY_PARAMETERS, BodyParameters, Motion, Placement};
use super::tree::Robot;
use crate::model::MAX_JOINTS;
use nalgebra::Vector3;

/// Y_p and Y_L at one state, n × 10 n row-major: row i belongs to joint i, columns 10 k to 10 k + 9
/// to body k.
#[derive(Debug, Clone, PartialEq)]
pub struct EnergyRegressors {
    joints: usize,
    momentum: Vec<f64>,
    lagrangian: Vec<f64>,
    /// For each body: J_ki and v_λ(i) × J_ki of the joints i on its path, bit i of `path`.
    unit: [[Motion; MAX_JOINTS]; MAX_JOINTS],
    turned: [[Motion; MAX_JOINTS]; MAX_JOINTS],
    path: [u32; MAX_JOINTS],
    /// Gravity in the frame of each body.
    gravity: [Vector3<f64>; MAX_JOINTS],
    /// Placement of each body in its parent.
    placement: [Placement; MAX_JOINTS],
}

/// Directions in which a base can tilt.
pub(super) const TILTS: usize = 2;

/// ∂²V/∂q_i ∂q_j at \[i\]\[j\], and after the joints the derivatives with respect to the base's
/// tilts (8).
pub(super) type WeightSlopes = [[f64; MAX_JOINTS]; MAX_JOINTS + TILTS];

/// [`WeightSlopes`] that are recomputed at intervals, not at each sample.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct HeldSlopes {
    pub slopes: WeightSlopes,
    hold_s: f64,
    made_s: Option<f64>,
}

impl HeldSlopes {
    /// With this interval \[s\].
    pub fn new(hold_s: f64) -> Self {
        Self {
            slopes: WeightSlopes::default(),
            hold_s,
            made_s: None,
        }
    }

    /// Recomputes them at time `t_s`, at which `regressors` have been evaluated, unless the
    /// interval has not passed.
    #[inline]
    pub fn renew(&mut self, t_s: f64, regressors: &EnergyRegressors, robot: &Robot) {
        if self.made_s.is_none_or(|made_s| t_s - made_s >= self.hold_s) {
            regressors.weight_slopes(robot, &mut self.slopes);
            self.made_s = Some(t_s);
        }
    }

    /// Call this if a new recording begins.
    pub fn forget(&mut self) {
        self.made_s = None;
    }
}

impl EnergyRegressors {
    /// Workspace for a robot of this many joints.
    pub fn new(joints: usize) -> Self {
        let size = joints * joints * BODY_PARAMETERS;
        Self {
            joints,
            momentum: vec![0.0; size],
            lagrangian: vec![0.0; size],
            unit: [[Motion::default(); MAX_JOINTS]; MAX_JOINTS],
            turned: [[Motion::default(); MAX_JOINTS]; MAX_JOINTS],
            path: [0; MAX_JOINTS],
            gravity: [Vector3::zeros(); MAX_JOINTS],
            placement: [Placement::identity(); MAX_JOINTS],
        }
    }

    /// Row i of Y_p, over the ten parameters of each body.
    pub fn momentum(&self, joint: usize) -> &[f64] {
        let width = self.joints * BODY_PARAMETERS;
        &self.momentum[joint * width..(joint + 1) * width]
    }

    /// Row i of Y_L = ∂(T − V)/∂q, over the ten parameters of each body.
    pub fn lagrangian(&self, joint: usize) -> &[f64] {
        let width = self.joints * BODY_PARAMETERS;
        &self.lagrangian[joint * width..(joint + 1) * width]
    }

    /// Coefficients of the ten parameters of a body in entry (i, j) of the mass matrix, ∂p_i/∂q̇_j
    /// by (2), at the last evaluated positions; `None` if i or j does not move the body.
    pub(super) fn inertia(&self, body: usize, i: usize, j: usize) -> Option<[f64; BODY_PARAMETERS]> {
        let moves = |joint: usize| self.path[body] >> joint & 1 == 1;
        (moves(i) && moves(j)).then(|| {
            let mut row = [0.0; BODY_PARAMETERS];
            self.unit[body][i].momentum_row(&self.unit[body][j], &mut row); // (2)
            row
        })
    }

    /// ∂V/∂q of these bodies at the last evaluated state: the torques that hold them at rest, by
    /// (4).
    pub fn weight(&self, bodies: &[BodyParameters], weight: &mut [f64]) {
        weight.fill(0.0);
        for (k, body) in bodies.iter().enumerate() {
            let (gravity, [mass, hx, hy, hz, ..]) = (&self.gravity[k], body.0);
            let moment = Vector3::new(hx, hy, hz);
            for i in joints_of(self.path[k], k) {
                let unit = &self.unit[k][i];
                weight[i] -= mass * unit.linear.dot(gravity) + moment.dot(&gravity.cross(&unit.angular)); // (4)
            }
        }
    }

    /// (7) and (8) of the robot's bodies at the last evaluated state \[N m/rad\].
    fn weight_slopes(&self, robot: &Robot, slopes: &mut WeightSlopes) {
        let n = self.joints;
        let mut mass = [0.0; MAX_JOINTS];
        let mut moment = [Vector3::zeros(); MAX_JOINTS];
        for (k, body) in robot.bodies.iter().enumerate() {
            (mass[k], moment[k]) = (body.mass(), body.first_moment());
        }
        for k in (0..n).rev() {
            if let Some(parent) = robot.joints[k].parent {
                let Placement { rotation, translation } = &self.placement[k];
                let carried = rotation * moment[k] + mass[k] * translation;
                mass[parent] += mass[k];
                moment[parent] += carried;
            }
        }
        let level = horizontals(&robot.gravity);
        let mut horizontal = [[Vector3::zeros(); TILTS]; MAX_JOINTS];
        for j in 0..n {
            let before = robot.joints[j].parent.map_or(&level, |parent| &horizontal[parent]);
            horizontal[j] = before.map(|e| self.placement[j].rotation.tr_mul(&e));
            let own = &self.unit[j][j];
            let u = mass[j] * own.linear + own.angular.cross(&moment[j]); // (6)
            let turned = u.cross(&self.gravity[j]);
            for i in joints_of(self.path[j], j) {
                let slope = -self.unit[j][i].angular.dot(&turned); // (7)
                (slopes[i][j], slopes[j][i]) = (slope, slope);
            }
            for (e, direction) in horizontal[j].iter().enumerate() {
                slopes[n + e][j] = -robot.gravity.norm() * direction.dot(&u); // (8)
            }
        }
    }

    /// Evaluates both at positions `q` \[rad or m\] and velocities `dq`; the robot must have the
    /// joints given to `new`.
    pub fn evaluate(&mut self, robot: &Robot, q: &[f64], dq: &[f64]) {
        let n = self.joints;
        let width = n * BODY_PARAMETERS;
        let zero = Motion::default();
        let mut velocity = [zero; MAX_JOINTS];
        let Self {
            unit,
            turned,
            path,
            gravity,
            placement,
            ..
        } = self;
        for k in 0..n {
            let joint = &robot.joints[k];
            placement[k] = robot.placement(k, q[k]);
            let x = &placement[k];
            let axis = if joint.turns {
                Motion::new(joint.axis, Vector3::zeros())
            } else {
                Motion::new(Vector3::zeros(), joint.axis)
            };
            let before = match joint.parent {
                Some(parent) => {
                    for i in joints_of(path[parent], parent) {
                        unit[k][i] = x.into_child(&unit[parent][i]); // (1)
                        turned[k][i] = x.into_child(&turned[parent][i]);
                    }
                    path[k] = path[parent] | 1 << k;
                    gravity[k] = x.rotation.tr_mul(&gravity[parent]);
                    x.into_child(&velocity[parent])
                }
                None => {
                    path[k] = 1 << k;
                    gravity[k] = x.rotation.tr_mul(&robot.gravity);
                    zero
                }
            };
            velocity[k] = before.plus(&axis.scaled(dq[k])); // (1)
            unit[k][k] = axis; // (1)
            turned[k][k] = before.cross(&axis); // (3)
            let mut row = [0.0; BODY_PARAMETERS];
            for i in joints_of(path[k], k) {
                let at = i * width + k * BODY_PARAMETERS;
                let (j, g) = (&unit[k][i], &gravity[k]);
                j.momentum_row(&velocity[k], &mut row);
                self.momentum[at..at + BODY_PARAMETERS].copy_from_slice(&row); // (2)
                turned[k][i].momentum_row(&velocity[k], &mut row); // (3)
                let moment = g.cross(&j.angular);
                row[0] += j.linear.dot(g); // (4), (5)
                row[1] += moment.x;
                row[2] += moment.y;
                row[3] += moment.z;
                self.lagrangian[at..at + BODY_PARAMETERS].copy_from_slice(&row); // (5)
            }
        }
    }
}

/// Two directions perpendicular to gravity and to each other.
fn horizontals(gravity: &Vector3<f64>) -> [Vector3<f64>; TILTS] {
    let down = gravity.try_normalize(0.0).unwrap_or_else(Vector3::z);
    let aside = if down.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let first = (aside - down * down.dot(&aside)).normalize();
    [first, down.cross(&first)]
}

/// The joints on a body's path, itself included.
fn joints_of(path: u32, body: usize) -> impl Iterator<Item = usize> {
    (0..=body).filter(move |i| path >> i & 1 == 1)
}
