//! Which samples were commanded elsewhere than the one before: an input may jump there.

use crate::model::MAX_JOINTS;

/// Samples after a step of the setpoint in which a jump of the input is due to it.
const ANSWER: usize = 5;

/// Steps of the setpoints, sample by sample.
#[derive(Debug, Clone)]
pub(super) struct SetpointSteps {
    /// Commanded positions of the sample before.
    last: [f64; MAX_JOINTS],
    /// Bit j: joint j was commanded elsewhere by the sample that came last.
    now: u32,
    /// There was ever a setpoint.
    commanded: bool,
    /// The same for each sample in the buffers.
    stepped: Vec<u32>,
}

impl SetpointSteps {
    /// Room for `capacity` samples.
    pub fn new(capacity: usize) -> Self {
        Self {
            last: [0.0; MAX_JOINTS],
            now: 0,
            commanded: false,
            stepped: vec![0; capacity],
        }
    }

    /// Looks at the setpoints of a sample that comes in.
    pub fn look(&mut self, setpoint: &[f64; MAX_JOINTS], joints: usize) {
        self.now = 0;
        for joint in 0..joints {
            self.now |= u32::from(setpoint[joint] != self.last[joint]) << joint;
        }
        self.last = *setpoint;
        self.commanded |= self.now != 0;
    }

    /// The sample that was looked at last becomes sample `at` of the buffers.
    pub fn note(&mut self, at: usize) {
        self.stepped[at] = self.now;
    }

    /// True if the setpoint explains a jump of a joint's input at sample `at`, or if there are no
    /// setpoints that could. A drive may answer a few samples late.
    pub fn explain(&self, joint: usize, at: usize) -> bool {
        let mut recent = self.stepped[at.saturating_sub(ANSWER)..=at].iter();
        !self.commanded || recent.any(|mask| mask >> joint & 1 == 1)
    }

    /// Makes `kept` samples from `from` on the first ones.
    pub fn keep(&mut self, from: usize, kept: usize) {
        self.stepped.copy_within(from..from + kept, 0);
    }

    /// Begins a new stream.
    pub fn reset(&mut self) {
        (self.last, self.commanded) = ([0.0; MAX_JOINTS], false);
    }
}
