//! Base parameters: the combinations of a robot's standard parameters that its torques depend on.
//!
//! Torques depend on the standard parameters π only through Y_p and Y_L of
//! [`regressor`](super::regressor): a π whose torques vanish for all q, q̇, q̈ has M(q) = 0 by the
//! factor of q̈, hence T = 0 and p = 0, and then ∂V/∂q = 0. With Y the two stacked at random
//! states, columns taken in a fixed order,
//!
//! ```text
//! y_c = Q r_c + e,   ‖e‖ ≤ tolerance ‖y_c‖: column c depends on those kept before it           (1)
//! x_c = R⁻¹ r_c:     y_c = Y_kept x_c                                                          (2)
//! Y π = Y_kept β,    β = π_kept + Σ_dropped x_c π_c = K π                                      (3)
//! ```
//!
//! Proximal bodies come before distal ones, and inertias before first moments before masses: so the
//! inertia of a proximal body absorbs the masses after it, as in base parameters derived by hand.
//! The order, the seed of the states and the tolerance are fixed: the set depends on the URDF
//! alone. Source: M. Gautier, J. of Robotic Systems 8 (1991); orthogonalisation twice after B.
//! Parlett, *The Symmetric Eigenvalue Problem* (1980), 6-9.

use super::regressor::EnergyRegressors;
use super::spatial::{BODY_PARAMETERS, Placement};
use super::tree::Robot;
use crate::random::Random;
use nalgebra::{Matrix3, Vector3};

/// Order of a body's parameters: inertias about the axes, products, first moments, mass.
const ORDER: [usize; BODY_PARAMETERS] = [9, 4, 6, 5, 7, 8, 1, 2, 3, 0];
/// Names of a body's parameters as in [`BODY_PARAMETERS`].
const NAMES: [&str; BODY_PARAMETERS] = ["m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"];
/// Units of the same.
const UNITS: [&str; BODY_PARAMETERS] = [
    "kg", "kg m", "kg m", "kg m", "kg m^2", "kg m^2", "kg m^2", "kg m^2", "kg m^2", "kg m^2",
];
/// Random states: several times as many rows as the largest robot has columns.
const STATES: usize = 120;
/// Seed of the states.
const SEED: u64 = 0x7465_7461_6275_7321;
/// Relative length of the independent part of a column below which it depends on those before it.
/// Rounding leaves about 1e-14; a length of 0.1 mm compared with one of metres gives 1e-8 in an
/// inertia.
const TOLERANCE: f64 = 1e-9;
/// Lengths \[m\] and direction cosines below this are rounding in the URDF: 1.5708 for π/2.
const ROUNDED: f64 = 2e-5;
/// Factors below this are rounding.
const NO_FACTOR: f64 = 1e-9;

/// A standard parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Standard {
    /// One of the ten of a body: index of the joint that carries it, index among
    /// [`BODY_PARAMETERS`].
    Body {
        /// Joint, counted from 0.
        joint: usize,
        /// Parameter, 0 to 9.
        parameter: usize,
    },
    /// Inertia of a drive's rotor, as seen at its joint.
    Rotor {
        /// Joint, counted from 0.
        joint: usize,
    },
}

impl Standard {
    /// `Izz3`, `m4`, `Ia2`: joints are counted from 1.
    pub fn name(self) -> String {
        match self {
            Self::Body { joint, parameter } => format!("{}{}", NAMES[parameter], joint + 1),
            Self::Rotor { joint } => format!("Ia{}", joint + 1),
        }
    }

    /// SI unit; for a prismatic joint, that of a rotor's inertia is kg.
    pub fn unit(self, robot: &Robot) -> &'static str {
        match self {
            Self::Body { parameter, .. } => UNITS[parameter],
            Self::Rotor { joint } if robot.joints[joint].turns => "kg m^2",
            Self::Rotor { .. } => "kg",
        }
    }

    /// Joint and index among the ten of a body; `None` for a rotor.
    pub fn in_body(self) -> Option<(usize, usize)> {
        match self {
            Self::Body { joint, parameter } => Some((joint, parameter)),
            Self::Rotor { .. } => None,
        }
    }

    /// The joint that carries it.
    pub fn joint(self) -> usize {
        match self {
            Self::Body { joint, .. } | Self::Rotor { joint } => joint,
        }
    }

    /// Its value in a robot of these rotors.
    fn value(self, robot: &Robot, rotors: &[f64]) -> f64 {
        match self {
            Self::Body { joint, parameter } => robot.bodies[joint].0[parameter],
            Self::Rotor { joint } => rotors[joint],
        }
    }
}

/// One base parameter: a standard parameter with others that cannot be distinguished from it.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseParameter {
    /// The parameter that it is named after, with factor 1.
    pub leading: Standard,
    /// The others with their factors.
    pub others: Vec<(Standard, f64)>,
}

impl BaseParameter {
    /// `Izz3 + 0.376 (m4 + m5 + m6) - 1.2 hx4`; factors are rounded to four digits.
    pub fn combination(&self) -> String {
        let mut text = self.leading.name();
        let mut rest: Vec<(Standard, f64)> = self.others.clone();
        while let Some(&(_, factor)) = rest.first() {
            let close = |x: f64| (x - factor).abs() <= 1e-6 * factor.abs();
            let names: Vec<String> = rest
                .iter()
                .filter(|(_, x)| close(*x))
                .map(|(standard, _)| standard.name())
                .collect();
            rest.retain(|(_, x)| !close(*x));
            let sign = if factor < 0.0 { '-' } else { '+' };
            let size = match four_digits(factor.abs()).as_str() {
                "1" => String::new(),
                digits => format!("{digits} "),
            };
            let names = match (names.len(), size.is_empty()) {
                (1, _) => names[0].clone(),
                (_, true) if sign == '+' => names.join(" + "),
                _ => format!("({})", names.join(" + ")),
            };
            text.push_str(&format!(" {sign} {size}{names}"));
        }
        text
    }
}

fn four_digits(x: f64) -> String {
    let decimals = (3 - x.log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{x:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// The base parameters of a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseParameters {
    /// The parameters, proximal before distal.
    pub parameters: Vec<BaseParameter>,
    /// Relative length of the smallest column kept and of the largest dropped: the margin of
    /// decision (1).
    pub gap: (f64, f64),
}

impl BaseParameters {
    /// Finds the base parameters; `rotors` adds the inertia of each drive's rotor to the standard
    /// parameters.
    pub fn of(robot: &Robot, rotors: bool) -> Self {
        let standard = standard_parameters(robot, rotors);
        let columns = columns(&idealised(robot), &standard);
        let mut kept: Vec<usize> = Vec::new();
        // Orthonormal columns, and the coordinates of the kept ones in them: R.
        let mut q: Vec<Vec<f64>> = Vec::new();
        let mut r: Vec<Vec<f64>> = Vec::new();
        let mut dropped: Vec<(Standard, Vec<f64>)> = Vec::new();
        let mut gap = (f64::INFINITY, 0.0_f64);
        for (index, column) in columns.iter().enumerate() {
            let length = norm(column);
            if length < TOLERANCE {
                continue; // No torque depends on it.
            }
            let mut rest = column.clone();
            let mut coordinates = vec![0.0; q.len()];
            // Twice: the second pass removes what rounding left of the first.
            for _ in 0..2 {
                for (basis, coordinate) in q.iter().zip(&mut coordinates) {
                    let along: f64 = basis.iter().zip(&rest).map(|(a, b)| a * b).sum();
                    *coordinate += along;
                    rest.iter_mut().zip(basis).for_each(|(x, b)| *x -= along * b);
                }
            }
            let left = norm(&rest);
            if left > TOLERANCE * length {
                gap.0 = gap.0.min(left / length);
                rest.iter_mut().for_each(|x| *x /= left);
                coordinates.push(left);
                q.push(rest);
                r.push(coordinates);
                kept.push(index);
            } else {
                gap.1 = gap.1.max(left / length); // (1)
                dropped.push((standard[index], coordinates));
            }
        }
        let mut parameters: Vec<BaseParameter> = kept
            .iter()
            .map(|&index| BaseParameter {
                leading: standard[index],
                others: Vec::new(),
            })
            .collect();
        for (standard, mut x) in dropped {
            // (2), backwards: R's column i has the entries 0 to i.
            for i in (0..x.len()).rev() {
                x[i] /= r[i][i];
                for k in 0..i {
                    x[k] -= r[i][k] * x[i];
                }
            }
            for (parameter, factor) in parameters.iter_mut().zip(x) {
                if factor.abs() > NO_FACTOR {
                    parameter.others.push((standard, factor)); // (3)
                }
            }
        }
        Self { parameters, gap }
    }

    /// (3): β of the URDF's own bodies; `rotors` are the inertias of the drives, one per joint.
    pub fn nominal(&self, robot: &Robot, rotors: &[f64]) -> Vec<f64> {
        let value = |standard: &Standard| standard.value(robot, rotors);
        self.parameters
            .iter()
            .map(|p| {
                value(&p.leading)
                    + p.others
                        .iter()
                        .map(|(other, factor)| factor * value(other))
                        .sum::<f64>()
            })
            .collect()
    }

    /// K of (3) by rows: for each base parameter the standard parameters with their factors.
    pub fn rows(&self) -> impl Iterator<Item = impl Iterator<Item = (Standard, f64)> + '_> + '_ {
        self.parameters
            .iter()
            .map(|p| std::iter::once((p.leading, 1.0)).chain(p.others.iter().copied()))
    }
}

/// The standard parameters, in order of preference.
fn standard_parameters(robot: &Robot, rotors: bool) -> Vec<Standard> {
    let mut standard = Vec::new();
    for joint in 0..robot.len() {
        standard.extend(ORDER.map(|parameter| Standard::Body { joint, parameter }));
        if rotors {
            standard.push(Standard::Rotor { joint });
        }
    }
    standard
}

/// The columns of Y_p over Y_L at random states.
fn columns(robot: &Robot, standard: &[Standard]) -> Vec<Vec<f64>> {
    let n = robot.len();
    let mut random = Random(SEED);
    let mut regressors = EnergyRegressors::new(n);
    let mut columns = vec![Vec::with_capacity(2 * n * STATES); standard.len()];
    for _ in 0..STATES {
        let q: Vec<f64> = robot
            .joints
            .iter()
            .map(|joint| random.within(if joint.turns { std::f64::consts::PI } else { 1.0 }))
            .collect();
        let dq: Vec<f64> = (0..n).map(|_| random.within(2.0)).collect();
        regressors.evaluate(robot, &q, &dq);
        for i in 0..n {
            for (column, standard) in columns.iter_mut().zip(standard) {
                match *standard {
                    Standard::Body { joint, parameter } => {
                        let at = joint * BODY_PARAMETERS + parameter;
                        column.push(regressors.momentum(i)[at]);
                        column.push(regressors.lagrangian(i)[at]);
                    }
                    Standard::Rotor { joint } => {
                        column.push(if joint == i { dq[i] } else { 0.0 });
                        column.push(0.0);
                    }
                }
            }
        }
    }
    columns
}

/// The robot with lengths and directions set to 0 if they are rounding: with 1.5708 for π/2,
/// parallel axes would be skew by 4e-6, and parameters would count as identifiable that no
/// measurement can distinguish.
fn idealised(robot: &Robot) -> Robot {
    let clean = |x: f64| if x.abs() < ROUNDED { 0.0 } else { x };
    let mut ideal = robot.clone();
    for joint in &mut ideal.joints {
        let Placement { rotation, translation } = &joint.placement;
        let [x, y]: [Vector3<f64>; 2] = [0, 1].map(|i| Vector3::from(rotation.column(i)).map(clean));
        let x = x.normalize();
        let y = (y - x * x.dot(&y)).normalize();
        joint.placement = Placement {
            rotation: Matrix3::from_columns(&[x, y, x.cross(&y)]),
            translation: translation.map(clean),
        };
        joint.axis = joint.axis.map(clean).normalize();
    }
    ideal
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}
