//! The payload at the flange: ten parameters in addition to the arm's.
//!
//! ```text
//! β' = β + M π,     M = K T                                                                    (1)
//! x' = (x, x M),    A' = [A, A M; Mᵀ A, Mᵀ A M],   b' = (b, Mᵀ b)                              (2)
//! ```
//!
//! T moves a body from the flange into the frame of the last joint, K takes standard to base
//! parameters. A rigid payload is equivalent to a change of the last body, so its columns are
//! combinations of the arm's: rows need not be recomputed, and rows alone cannot distinguish the
//! payload from the arm. The arm's estimates without payload can.

use super::information::Information;
use super::model::{Meaningful, RobotModel, RobotParameter};
use super::spatial::{BODY_PARAMETERS, BodyParameters};
use super::sums::JointSums;

/// Names of the ten, in the order of [`BODY_PARAMETERS`].
const NAMES: [(&str, &str, &str); BODY_PARAMETERS] = [
    ("payload_m", "kg", "mass of the payload"),
    ("payload_hx", "kg m", "first moment of the payload about the flange, x"),
    ("payload_hy", "kg m", "first moment of the payload about the flange, y"),
    ("payload_hz", "kg m", "first moment of the payload about the flange, z"),
    ("payload_Ixx", "kg m^2", "inertia of the payload about the flange, xx"),
    ("payload_Ixy", "kg m^2", "inertia of the payload about the flange, xy"),
    ("payload_Iyy", "kg m^2", "inertia of the payload about the flange, yy"),
    ("payload_Ixz", "kg m^2", "inertia of the payload about the flange, xz"),
    ("payload_Iyz", "kg m^2", "inertia of the payload about the flange, yz"),
    ("payload_Izz", "kg m^2", "inertia of the payload about the flange, zz"),
];
/// Scale of a payload: mass relative to the robot's mass, and distance from the flange relative to
/// the robot's reach.
const LARGEST: (f64, f64) = (0.25, 0.15);

/// M with the prior of a payload.
#[derive(Debug, Clone)]
pub struct Payload {
    /// Index of its first parameter: the number of the arm's.
    pub(super) first: usize,
    /// M, one row of ten per parameter of the arm.
    map: Vec<[f64; BODY_PARAMETERS]>,
    /// Standard deviations of the prior, about 0.
    pub(super) prior: [f64; BODY_PARAMETERS],
    product: Vec<[f64; BODY_PARAMETERS]>,
}

impl Payload {
    /// For a robot whose flange may carry a payload.
    pub fn new(model: &RobotModel) -> Self {
        let robot = model.robot();
        let n = robot.len();
        let mut bare = robot.clone();
        bare.bodies
            .iter_mut()
            .for_each(|body| *body = BodyParameters::default());
        let mut map = vec![[0.0; BODY_PARAMETERS]; model.parameters().len()];
        for p in 0..BODY_PARAMETERS {
            let mut unit = BodyParameters::default();
            unit.0[p] = 1.0;
            bare.bodies[n - 1] = unit.moved(&robot.flange);
            // K of (1): the parameters that are linear in the bodies.
            for (row, entry) in map
                .iter_mut()
                .zip(model.base().nominal(&bare, &[0.0; crate::model::MAX_JOINTS]))
            {
                row[p] = entry;
            }
        }
        let mass: f64 = LARGEST.0 * robot.bodies.iter().map(BodyParameters::mass).sum::<f64>();
        let reach: f64 = robot
            .joints
            .iter()
            .map(|joint| joint.placement.translation.norm())
            .sum();
        let arm = LARGEST.1 * reach.max(0.1);
        let prior = std::array::from_fn(|p| match p {
            0 => mass,
            1..4 => mass * arm,
            _ => mass * arm * arm,
        });
        Self {
            first: map.len(),
            product: vec![[0.0; BODY_PARAMETERS]; map.len()],
            map,
            prior,
        }
    }

    /// The same for rows with columns up to this index; columns after the arm's parameters do not
    /// depend on the payload.
    pub(super) fn over_columns(mut self, columns: usize) -> Self {
        self.map.resize(columns, [0.0; BODY_PARAMETERS]);
        self.product.resize(columns, [0.0; BODY_PARAMETERS]);
        self
    }

    /// Its parameters.
    pub fn parameters(&self) -> impl Iterator<Item = RobotParameter> + '_ {
        NAMES
            .iter()
            .zip(self.prior)
            .map(|((name, unit, meaning), scale)| RobotParameter {
                name: (*name).to_owned(),
                unit,
                meaning: (*meaning).to_owned(),
                nominal: 0.0,
                scale,
                range: match *name {
                    "payload_m" => Meaningful::RefutedBelowZero,
                    "payload_Ixx" | "payload_Iyy" | "payload_Izz" => Meaningful::NonNegative,
                    _ => Meaningful::All,
                },
            })
    }

    /// Indices of its parameters.
    pub fn indices(&self) -> std::ops::Range<usize> {
        self.first..self.first + BODY_PARAMETERS
    }

    /// A row of M.
    pub(super) fn row(&self, parameter: usize) -> &[f64; BODY_PARAMETERS] {
        &self.map[parameter]
    }

    /// (1): writes the parameters of an arm that is equivalent to arm and payload of `theta`
    /// together.
    pub fn effective(&self, theta: &[f64], out: &mut [f64]) {
        let payload = &theta[self.indices()];
        for (i, (row, theta)) in self.map.iter().zip(theta).enumerate() {
            out[i] = theta + row.iter().zip(payload).map(|(m, x)| m * x).sum::<f64>(); // (1)
        }
    }

    /// (2): adds the payload's part of weight · (A, b) of a joint.
    pub(super) fn scatter(&mut self, sums: &JointSums, weight: f64, into: &mut Information) {
        let (n, m) = (into.n, sums.columns().len());
        let columns = sums.columns_below(n);
        for (i, product) in self.product.iter_mut().take(columns.len()).enumerate() {
            *product = [0.0; BODY_PARAMETERS];
            for (entry, &k) in sums.gram[i * m..(i + 1) * m].iter().zip(columns) {
                for (product, factor) in product.iter_mut().zip(&self.map[k]) {
                    *product += entry * factor; // (2): A M
                }
            }
        }
        for (i, &a) in columns.iter().enumerate() {
            for p in 0..BODY_PARAMETERS {
                let entry = weight * self.product[i][p];
                into.matrix[a * n + self.first + p] += entry; // (2)
                into.matrix[(self.first + p) * n + a] += entry;
                let factor = weight * self.map[a][p];
                into.vector[self.first + p] += factor * sums.moment[i]; // (2)
                into.bias[self.first + p] += factor * sums.bias[i];
                for q in 0..BODY_PARAMETERS {
                    into.matrix[(self.first + p) * n + self.first + q] += factor * self.product[i][q]; // (2)
                }
            }
        }
    }
}
