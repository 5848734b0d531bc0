//! The samples of a block on their grid, and those of the block before that windows still need.

use super::setpoint_steps::SetpointSteps;
use super::weak_form::WeakForm;
use super::windows::Windows;
use crate::model::JointSample;
use crate::rows::FirstBlocks;
use crate::rows::intake::{BRIDGED, GridSample, Intake};
use crate::rows::repair::Repair;
use crate::rows::trajectory::Trajectory;
use std::ops::Range;

/// Samples before a jump of the input from which its size is determined.
const BEFORE_JUMP: usize = 5;

/// Samples in buffers; buffer positions count from the oldest sample kept.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    /// The signals as measured, repaired and filtered.
    pub signals: Trajectory,
    /// Samples so far.
    pub len: usize,
    /// First buffer position after the last hole.
    pub segment: usize,
    pub windows: Windows,
    pub repair: Repair,
    pub steps: SetpointSteps,
    intake: Intake,
    t_ns: Vec<u64>,
    /// Grid number of buffer position 0, for positions from `segment` on.
    offset: i64,
    /// Samples kept over the border of a block.
    history: usize,
    block_len: usize,
    capacity: usize,
}

impl Samples {
    /// Buffers for the samples of a block of `block_len`.
    pub fn new(form: &WeakForm, block_len: usize) -> Self {
        let (options, half) = (&form.options, form.kernels.half);
        let stride = options.stride().max(1);
        // a velocity needs its neighbours, a jump the samples before it
        let reach = (half + 2 * form.velocity.half).max(form.kernels.input_half + BEFORE_JUMP);
        let history = 2 * reach + stride;
        // a stream may bring a few more grid values than samples
        let room = FirstBlocks::room(block_len);
        let capacity = history + room + room / 16 + 4 * BRIDGED;
        let joints = form.plant.joints();
        Self {
            signals: Trajectory::new(joints, form.separation.features, capacity),
            len: 0,
            segment: 0,
            windows: Windows::new(half, reach, stride, capacity / stride + 2),
            repair: Repair::new(joints, capacity),
            steps: SetpointSteps::new(capacity),
            intake: Intake::new(options.sample_period_s, options.timing, joints),
            t_ns: vec![0; capacity],
            offset: 0,
            history,
            block_len,
            capacity,
        }
    }

    /// Samples that a block has.
    pub fn block_len(&self) -> usize {
        self.block_len
    }

    /// Capacity in samples.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Adds a sample; false if the buffers are full.
    pub fn push(&mut self, form: &WeakForm, t_ns: u64, sample: &JointSample) -> bool {
        // one sample may complete this many grid values
        if self.len + BRIDGED + 2 > self.capacity {
            return false;
        }
        if let (Some(change), Some(last)) = (self.intake.take(t_ns, sample), self.len.checked_sub(1)) {
            for (u, change) in self.signals.u.iter_mut().zip(&change) {
                u[last] += change;
            }
        }
        self.steps.look(&sample.setpoint, self.signals.joints());
        while self.len < self.capacity
            && let Some(grid) = self.intake.next()
        {
            self.append(form, &grid);
        }
        true
    }

    /// Adds a sample on the grid; the buffers must have room for it.
    fn append(&mut self, form: &WeakForm, grid: &GridSample) {
        let at = self.len;
        if grid.first || at == 0 {
            // after a hole, or after a clock that went back
            self.segment = at;
            self.offset = grid.number - at as i64;
        }
        self.steps.note(at);
        self.repair.note(at, grid.first || at == 0, grid.lost, grid.gain);
        for joint in 0..self.signals.joints() {
            self.signals.q[joint][at] = grid.q[joint];
            self.signals.u[joint][at] = grid.u[joint];
        }
        self.t_ns[at] = grid.t_ns;
        self.len += 1;

        let (velocity_half, reach) = (form.velocity.half, self.windows.reach);
        if self.len > self.segment + 2 * velocity_half {
            let known = at - velocity_half;
            form.differentiate(&mut self.signals, known..known + 1);
        }
        if self.len > self.segment + 2 * reach {
            let centre = at - reach;
            self.windows.place(centre, self.offset + centre as i64, &self.t_ns);
        }
    }

    /// Repairs single wrong and lost samples, and what was computed from them. `noise` gives the
    /// standard deviations of a joint's position and input, and the size of its encoder's count.
    pub fn mend(&mut self, form: &WeakForm, noise: impl Fn(usize) -> ([f64; 2], f64)) {
        for joint in 0..self.signals.joints() {
            let (std, count) = noise(joint);
            let q = &mut self.signals.q[joint][..self.len];
            let u = &mut self.signals.u[joint][..self.len];
            self.repair.mend(joint, q, u, std, count);
        }
        self.repair.finish(self.len);
        let half = form.velocity.half;
        for change in 0..self.repair.changed().len() {
            let (from, to) = self.repair.changed()[change];
            let stretch = self.repair.stretches(self.len).find(|stretch| stretch.contains(&from));
            let Some(stretch) = stretch else { continue };
            let first = from.saturating_sub(half).max(stretch.start + half);
            let end = (to + half).min(stretch.end.saturating_sub(half));
            form.differentiate(&mut self.signals, first..end);
        }
    }

    /// The longest stretch without a hole.
    pub fn longest_stretch(&self) -> Range<usize> {
        let stretches = self.repair.stretches(self.len);
        stretches.max_by_key(|stretch| stretch.len()).unwrap_or(0..self.len)
    }

    /// Keeps the samples that the next block's windows need.
    pub fn clear(&mut self) {
        let kept = (self.len - self.segment).min(self.history);
        let from = self.len - kept;
        self.signals.keep(from, kept);
        self.t_ns.copy_within(from..from + kept, 0);
        self.steps.keep(from, kept);
        self.repair.clear(from, self.len);
        self.offset += from as i64;
        self.segment = 0;
        self.len = kept;
        self.windows.clear();
    }

    /// Begins a new stream.
    pub fn reset(&mut self) {
        self.len = 0;
        self.segment = 0;
        self.windows.clear();
        self.intake.reset();
        self.repair.reset();
        self.steps.reset();
    }
}
