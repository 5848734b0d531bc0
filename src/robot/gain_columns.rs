//! Columns of a changed drive gain for the rows of a window.
//!
//! A drive whose gain differs from the configured one reports (1 + g) times its torque. With X_j
//! the rows of joint j, W_j their weight, r_j the prediction error, and θ the parameters:
//!
//! ```text
//! τ_j = (1 + g_j) X_j θ:   c_j = X_j θ                                                          (1)
//! X_jᵀ W_j c_j = W_j A_j θ,   c_jᵀ W_j c_j = W_j θᵀ A_j θ,   c_jᵀ W_j r_j = W_j θᵀ b_j          (2)
//! ```
//!
//! A_j and b_j are the sums of the window, b_j relative to the origin θ. If the gains of all drives
//! change alike, for example with the temperature of their magnets, the column is the sum of the
//! c_j.

use super::change::Column;
use super::payload::Payload;
use super::sums::JointSums;

/// The columns of the single joints, and that of all joints alike.
#[derive(Debug, Clone)]
pub(super) struct GainColumns {
    joints: Vec<Column>,
    all: Column,
}

impl GainColumns {
    /// Workspace for `joints` joints and `parameters` parameters.
    pub fn new(joints: usize, parameters: usize) -> Self {
        let empty = Column {
            cross: vec![0.0; parameters],
            square: 0.0,
            score: 0.0,
        };
        Self {
            joints: vec![empty.clone(); joints],
            all: empty,
        }
    }

    /// The column of a joint, or of all.
    pub fn of(&self, joint: Option<usize>) -> &Column {
        joint.and_then(|joint| self.joints.get(joint)).unwrap_or(&self.all)
    }

    /// Clears the columns, before the joints are [added](Self::take).
    pub fn clear(&mut self) {
        for column in self.joints.iter_mut().chain([&mut self.all]) {
            column.cross.fill(0.0);
            (column.square, column.score) = (0.0, 0.0);
        }
    }

    /// (2) of a joint from its sums, [shifted](JointSums::shift) to `effective`; `load` is the
    /// payload among the parameters.
    pub fn take(&mut self, joint: usize, sums: &JointSums, effective: &[f64], weight: f64, load: Option<&Payload>) {
        let (own, m) = (&mut self.joints[joint], sums.columns().len());
        for (i, &a) in sums.columns().iter().enumerate() {
            let row = sums.gram[i * m..(i + 1) * m].iter().zip(sums.columns());
            let product = weight * row.map(|(entry, &k)| entry * effective[k]).sum::<f64>();
            own.square += effective[a] * product; // (2)
            own.score += weight * effective[a] * sums.moment[i]; // (2)
            // the time has no parameter
            let Some(cross) = own.cross.get_mut(a) else { continue };
            *cross = product; // (2)
            if let Some(load) = load {
                for (p, factor) in load.indices().zip(load.row(a)) {
                    own.cross[p] += factor * product; // (2), with M of payload.rs
                }
            }
        }
        for (all, own) in self.all.cross.iter_mut().zip(&own.cross) {
            *all += own;
        }
        self.all.square += own.square;
        self.all.score += own.score;
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::RobotModel;
    use super::super::selection::Selection;
    use super::super::tree::Robot;
    use super::*;

    /// Compares (2) with sums over the rows themselves, for a payload whose columns are those of
    /// the arm times M.
    #[test]
    fn val_products_of_a_gain_are_those_of_its_rows() {
        let urdf = include_str!("../../config/robots/six_axis.urdf");
        let robot = Robot::from_urdf(urdf, &Selection::default()).unwrap();
        let model = RobotModel::new(robot, true, vec![Default::default(); 6]).unwrap();
        let payload = Payload::new(&model);
        let (arm, joint, weight) = (model.parameters().len(), 2, 0.7);
        let n = arm + payload.indices().len();
        let columns = model.columns(joint);
        let effective: Vec<f64> = (0..arm).map(|i| (1.3 * i as f64).sin()).collect();
        let entry = |row: usize, c: usize| (0.7 * row as f64 + 2.1 * c as f64).cos();
        let mut sums = JointSums::new(columns);
        let (mut cross, mut square, mut score) = (vec![0.0; n], 0.0, 0.0);
        for row in 0..40 {
            let x: Vec<f64> = (0..columns.len()).map(|c| entry(row, c)).collect();
            let torque = (row as f64).sin();
            sums.add_row(&x, torque);
            let predicted: f64 = x.iter().zip(columns).map(|(x, &k)| x * effective[k]).sum();
            for (x, &k) in x.iter().zip(columns) {
                cross[k] += weight * x * predicted;
                for (p, factor) in payload.indices().zip(payload.row(k)) {
                    cross[p] += weight * x * factor * predicted;
                }
            }
            square += weight * predicted * predicted;
            score += weight * predicted * (torque - predicted);
        }
        sums.mirror();
        sums.shift(&effective);
        let mut gains = GainColumns::new(6, n);
        gains.take(joint, &sums, &effective, weight, Some(&payload));
        for of in [Some(joint), None] {
            let column = gains.of(of);
            let close = |a: f64, b: f64| (a - b).abs() < 1e-9 * (1.0 + b.abs());
            assert!(close(column.square, square) && close(column.score, score), "{of:?}");
            assert!(column.cross.iter().zip(&cross).all(|(a, b)| close(*a, *b)), "{of:?}");
        }
        assert_eq!(gains.of(Some(0)).square, 0.0);
    }
}
