//! Size of a robot's parameters and drives, by its URDF.

use super::base_parameters::{BaseParameter, Standard};
use super::friction::FrictionTerm;
use super::spatial::BodyParameters;
use super::tree::Robot;

/// Acceleration of free fall, for sizes \[m/s²\].
const G: f64 = 9.81;

/// Scales of a robot's parameters: mass and reach of the bodies that each joint carries, and the
/// effort of its drive, 0 if the URDF states none.
pub(super) struct Scales {
    mass: Vec<f64>,
    reach: Vec<f64>,
    turns: Vec<bool>,
    effort: Vec<f64>,
}

impl Robot {
    /// Largest torque or force of each joint's drive \[N m or N\]: that of the URDF, or without one
    /// by the weight that the joint carries.
    pub fn drive_sizes(&self) -> Vec<f64> {
        let scales = Scales::of(self);
        (0..self.len()).map(|joint| scales.drive(joint)).collect()
    }
}

impl Scales {
    /// Those of a robot.
    pub fn of(robot: &Robot) -> Self {
        let n = robot.len();
        let mut mass: Vec<f64> = robot.bodies.iter().map(BodyParameters::mass).collect();
        let centre = |i: usize| robot.bodies[i].first_moment().norm() / robot.bodies[i].mass();
        let gyration = |i: usize| (robot.bodies[i].inertia().trace() / robot.bodies[i].mass()).sqrt();
        let mut reach: Vec<f64> = (0..n).map(|i| centre(i).max(gyration(i))).collect();
        for i in (0..n).rev() {
            if let Some(parent) = robot.joints[i].parent {
                mass[parent] += mass[i];
                reach[parent] = reach[parent].max(robot.joints[i].placement.translation.norm() + reach[i]);
            }
        }
        Self {
            mass,
            reach,
            turns: robot.joints.iter().map(|joint| joint.turns).collect(),
            effort: robot
                .joints
                .iter()
                .map(|j| j.limits.effort.unwrap_or(0.0).max(0.0))
                .collect(),
        }
    }

    /// Standard deviation of a parameter of a body or a rotor that covers any machine of this size.
    pub fn body(&self, standard: Standard) -> f64 {
        let i = standard.joint();
        let (mass, reach) = (self.mass[i], self.reach[i]);
        match standard {
            Standard::Body { parameter: 0, .. } => mass,
            Standard::Body { parameter: 1..4, .. } => mass * reach,
            // Through its gear, the rotor of a small joint can have more inertia than the bodies
            // that the joint carries.
            Standard::Rotor { .. } if !self.turns[i] => mass.max(self.mass[0]),
            Standard::Rotor { .. } => (mass * reach * reach).max(0.1 * self.mass[0] * self.reach[0].powi(2)),
            Standard::Body { .. } => mass * reach * reach,
        }
    }

    /// The same of a base parameter. If axes have arbitrary directions, the factors of its other
    /// standard parameters may be far above 1.
    pub fn base(&self, parameter: &BaseParameter) -> f64 {
        let own = self.body(parameter.leading).powi(2);
        let others = parameter.others.iter();
        let others: f64 = others.map(|(other, factor)| (factor * self.body(*other)).powi(2)).sum();
        (own + others).sqrt()
    }

    /// The same of a term of a joint's friction.
    pub fn friction(&self, joint: usize, term: FrictionTerm) -> f64 {
        match term {
            FrictionTerm::Load => 1.0,
            _ => self.weight(joint).max(self.drive(joint)),
        }
    }

    /// Largest torque or force of a joint's drive: the URDF's, or the weight that the joint bears.
    /// The drive of a small joint is stronger than that, so it has at least a tenth of what the
    /// first joint bears.
    pub fn drive(&self, joint: usize) -> f64 {
        let whole = match self.turns[joint] {
            true => self.mass[0] * G * self.reach[0],
            false => self.mass[0] * G,
        };
        match self.effort[joint] {
            stated if stated > 0.0 => stated,
            _ => self.weight(joint).max(0.1 * whole),
        }
    }

    /// Torque or force that bears the weight that a joint carries.
    fn weight(&self, joint: usize) -> f64 {
        let force = self.mass[joint] * G;
        match self.turns[joint] {
            true => force * self.reach[joint],
            false => force,
        }
    }
}
