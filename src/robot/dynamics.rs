//! Inverse and forward dynamics of a robot, independent of its regressors: the recursive
//! Newton–Euler algorithm, and the articulated-body algorithm.
//!
//! Inverse, from the base to the tips and back, with gravity as an acceleration −g of the base:
//!
//! ```text
//! a_k = X_k a_λ(k) + s_k q̈_k + v_k × s_k q̇_k                                                 (1)
//! f_k = I_k a_k + v_k ×* (I_k v_k) + Σ_children Xᵀ f                                          (2)
//! τ_k = s_k · f_k                                                                             (3)
//! ```
//!
//! Forward, with the articulated inertia A_k and its bias force b_k, from the tips to the base and
//! back:
//!
//! ```text
//! U = A_k s_k,   d = s_kᵀ U,   u = τ_k − s_kᵀ b_k                                            (4)
//! A_λ += Xᵀ (A_k − U Uᵀ/d) X,   b_λ += Xᵀ [b_k + (A_k − U Uᵀ/d) c_k + U u/d]                 (5)
//! q̈_k = (u − Uᵀ a'_k)/d,        a_k = a'_k + s_k q̈_k,   a'_k = X_k a_λ + c_k                 (6)
//! ```
//!
//! Source: R. Featherstone, *Rigid Body Dynamics Algorithms* (2008), tables 5.1 and 7.1.

use super::spatial::{BodyParameters, Motion, Placement};
use super::tree::Robot;
use crate::model::MAX_JOINTS;
use nalgebra::{Matrix6, Vector3, Vector6};

/// A moment about the origin and a force.
#[derive(Debug, Clone, Copy, Default)]
struct Force {
    moment: Vector3<f64>,
    force: Vector3<f64>,
}

impl Force {
    fn plus(&self, other: &Self) -> Self {
        Self {
            moment: self.moment + other.moment,
            force: self.force + other.force,
        }
    }

    /// In the parent's frame, about the parent's origin.
    fn into_parent(self, x: &Placement) -> Self {
        let force = x.rotation * self.force;
        Self {
            moment: x.rotation * self.moment + x.translation.cross(&force),
            force,
        }
    }
}

fn axis(robot: &Robot, joint: usize) -> Motion {
    let joint = &robot.joints[joint];
    match joint.turns {
        true => Motion::new(joint.axis, Vector3::zeros()),
        false => Motion::new(Vector3::zeros(), joint.axis),
    }
}

/// Torques or forces τ \[N m or N\] of the rigid bodies at one state; `bodies` need not be
/// physically possible, τ is linear in them.
///
/// All slices have one entry per joint.
pub fn inverse_dynamics(robot: &Robot, bodies: &[BodyParameters], q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
    let n = robot.len();
    let mut x = [Placement::identity(); MAX_JOINTS];
    let mut velocity = [Motion::default(); MAX_JOINTS];
    let mut acceleration = [Motion::default(); MAX_JOINTS];
    let mut force = [Force::default(); MAX_JOINTS];
    let at_base = Motion::new(Vector3::zeros(), -robot.gravity);
    for k in 0..n {
        x[k] = robot.placement(k, q[k]);
        let s = axis(robot, k);
        let (v, a) = match robot.joints[k].parent {
            Some(parent) => (velocity[parent], acceleration[parent]),
            None => (Motion::default(), at_base),
        };
        let moved = s.scaled(dq[k]);
        velocity[k] = x[k].into_child(&v).plus(&moved);
        acceleration[k] = x[k]
            .into_child(&a)
            .plus(&s.scaled(ddq[k]))
            .plus(&velocity[k].cross(&moved)); // (1)
        force[k] = rigid_force(&bodies[k], &acceleration[k], &velocity[k]); // (2)
    }
    for k in (0..n).rev() {
        let s = axis(robot, k);
        tau[k] = s.angular.dot(&force[k].moment) + s.linear.dot(&force[k].force); // (3)
        if let Some(parent) = robot.joints[k].parent {
            force[parent] = force[parent].plus(&force[k].into_parent(&x[k])); // (2)
        }
    }
}

/// I a + v ×* (I v).
fn rigid_force(body: &BodyParameters, a: &Motion, v: &Motion) -> Force {
    let (moment, force) = body.apply(a);
    let (angular, linear) = body.apply(v);
    Force {
        moment: moment + v.angular.cross(&angular) + v.linear.cross(&linear),
        force: force + v.angular.cross(&linear),
    }
}

/// Accelerations q̈ \[rad/s² or m/s²\] due to torques or forces τ; `rotor` is the inertia of each
/// drive at its joint.
///
/// All slices have one entry per joint. The bodies must have a positive definite inertia, as those
/// of a URDF have.
pub fn forward_dynamics(
    robot: &Robot,
    bodies: &[BodyParameters],
    rotor: &[f64],
    q: &[f64],
    dq: &[f64],
    tau: &[f64],
    ddq: &mut [f64],
) {
    let n = robot.len();
    let mut x = [Placement::identity(); MAX_JOINTS];
    let mut velocity = [Motion::default(); MAX_JOINTS];
    let mut coriolis = [Vector6::zeros(); MAX_JOINTS];
    let mut inertia = [Matrix6::zeros(); MAX_JOINTS];
    let mut bias = [Vector6::zeros(); MAX_JOINTS];
    for k in 0..n {
        x[k] = robot.placement(k, q[k]);
        let moved = axis(robot, k).scaled(dq[k]);
        let before = robot.joints[k]
            .parent
            .map_or(Motion::default(), |parent| velocity[parent]);
        velocity[k] = x[k].into_child(&before).plus(&moved);
        coriolis[k] = stacked(&velocity[k].cross(&moved));
        inertia[k] = matrix(&bodies[k]);
        let f = rigid_force(&bodies[k], &Motion::default(), &velocity[k]);
        bias[k] = Vector6::new(f.moment.x, f.moment.y, f.moment.z, f.force.x, f.force.y, f.force.z);
    }
    let mut u_of = [Vector6::zeros(); MAX_JOINTS];
    let mut d_of = [0.0; MAX_JOINTS];
    let mut rest = [0.0; MAX_JOINTS];
    for k in (0..n).rev() {
        let s = stacked(&axis(robot, k));
        let column = inertia[k] * s; // (4)
        let d = s.dot(&column) + rotor[k]; // (4): a rotor adds to its own joint only
        let u = tau[k] - s.dot(&bias[k]); // (4)
        if let Some(parent) = robot.joints[k].parent {
            let into = transform(&x[k]);
            let apparent = inertia[k] - column * column.transpose() / d;
            inertia[parent] += into.transpose() * apparent * into; // (5)
            bias[parent] += into.transpose() * (bias[k] + apparent * coriolis[k] + column * (u / d)); // (5)
        }
        (u_of[k], d_of[k], rest[k]) = (column, d, u);
    }
    let mut acceleration = [Vector6::zeros(); MAX_JOINTS];
    let at_base = stacked(&Motion::new(Vector3::zeros(), -robot.gravity));
    for k in 0..n {
        let before = robot.joints[k].parent.map_or(at_base, |parent| acceleration[parent]);
        let moved = transform(&x[k]) * before + coriolis[k]; // (6)
        ddq[k] = (rest[k] - u_of[k].dot(&moved)) / d_of[k]; // (6)
        acceleration[k] = moved + stacked(&axis(robot, k)) * ddq[k]; // (6)
    }
}

fn stacked(motion: &Motion) -> Vector6<f64> {
    let (a, l) = (&motion.angular, &motion.linear);
    Vector6::new(a.x, a.y, a.z, l.x, l.y, l.z)
}

/// X: motions of the parent's frame into the child's.
fn transform(x: &Placement) -> Matrix6<f64> {
    let e = x.rotation.transpose();
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&e);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&e);
    let below = -(e * x.translation.cross_matrix());
    matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(&below);
    matrix
}

/// The 6 × 6 inertia of a body.
fn matrix(body: &BodyParameters) -> Matrix6<f64> {
    let h = body.first_moment().cross_matrix();
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&body.inertia());
    matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(&h);
    matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(&h.transpose());
    matrix
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(nalgebra::Matrix3::identity() * body.mass()));
    matrix
}
