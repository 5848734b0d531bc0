//! The rows since the last block, as sums.

use super::model::RobotModel;
use super::rows::WeakRow;
use super::sums::JointSums;

/// Sums of the open slice and of the open block, per joint.
#[derive(Debug, Clone)]
pub(super) struct OpenBlock {
    slice: Vec<JointSums>,
    slice_begin_s: f64,
    sums: Vec<JointSums>,
    /// Effective parameters of the mass matrix in the bias of the rows by errors of the positions.
    of_mass: Vec<f64>,
}

impl OpenBlock {
    /// No rows; `acting` is the number of effective parameters.
    pub fn new(acting: usize, empty: &[JointSums]) -> Self {
        Self {
            slice: empty.to_vec(),
            slice_begin_s: 0.0,
            sums: empty.to_vec(),
            of_mass: vec![0.0; acting],
        }
    }

    /// Adopts a mass matrix for the next rows.
    pub fn set_mass(&mut self, effective: &[f64]) {
        self.of_mass.copy_from_slice(effective);
    }

    /// Adds a row to the slice.
    pub fn add(&mut self, row: &WeakRow<'_>, model: &RobotModel) {
        if self.has_empty_slice() {
            self.slice_begin_s = row.t_s;
        }
        let sums = &mut self.slice[row.joint];
        sums.add_row(row.regressor, row.torque);
        sums.add_bias(&mut |bias| row.errors.bias(model, row.joint, &self.of_mass, bias));
    }

    /// True if the slice has no rows.
    pub fn has_empty_slice(&self) -> bool {
        self.slice.iter().all(|sums| sums.rows == 0)
    }

    /// True if the block has no rows; those of the slice do not count.
    pub fn is_empty(&self) -> bool {
        self.sums.iter().all(|sums| sums.rows == 0)
    }

    /// Sums of the slice, complete after [`add_slice`](Self::add_slice).
    pub fn slice(&self) -> &[JointSums] {
        &self.slice
    }

    /// Middle of the first window of the slice \[s\].
    pub fn slice_begin_s(&self) -> f64 {
        self.slice_begin_s
    }

    /// Sums of the block, without those of the slice.
    pub fn sums(&self) -> &[JointSums] {
        &self.sums
    }

    /// Completes the sums of the slice and adds them to the block.
    pub fn add_slice(&mut self) {
        for (slice, sums) in self.slice.iter_mut().zip(&mut self.sums) {
            slice.mirror();
            sums.add(slice);
        }
    }

    /// Begins a slice.
    pub fn clear_slice(&mut self) {
        self.slice.iter_mut().for_each(JointSums::clear);
    }

    /// Begins a block; the slice keeps its rows.
    pub fn clear_sums(&mut self) {
        self.sums.iter_mut().for_each(JointSums::clear);
    }

    /// Drops all rows.
    pub fn clear(&mut self) {
        self.clear_slice();
        self.clear_sums();
    }
}
