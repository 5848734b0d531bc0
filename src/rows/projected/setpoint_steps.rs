//! Finds steps of the setpoint: an input may jump there.

use crate::model::MAX_JOINTS;

/// Samples after a step of the setpoint in which a jump of the input is attributed to it.
const ANSWER: usize = 5;

/// Steps of the setpoints, sample by sample.
#[derive(Debug, Clone)]
pub(super) struct SetpointSteps {
    /// Commanded positions of the sample before.
    last: [f64; MAX_JOINTS],
    /// Bit j: the setpoint of joint j has stepped since the last sample in the buffers.
    now: u32,
    /// True if `now` belongs to a sample in the buffers.
    recorded: bool,
    /// True if there has been any setpoint.
    commanded: bool,
    /// The same for each sample in the buffers.
    stepped: Vec<u32>,
}

impl SetpointSteps {
    /// Workspace for `capacity` samples.
    pub fn new(capacity: usize) -> Self {
        Self {
            last: [0.0; MAX_JOINTS],
            now: 0,
            recorded: false,
            commanded: false,
            stepped: vec![0; capacity],
        }
    }

    /// Checks the setpoints of an incoming sample. A sample between two grid instants is not stored
    /// in the buffers: its step belongs to the next one.
    pub fn look(&mut self, setpoint: &[f64; MAX_JOINTS], joints: usize) {
        if std::mem::take(&mut self.recorded) {
            self.now = 0;
        }
        for joint in 0..joints {
            self.now |= u32::from(setpoint[joint] != self.last[joint]) << joint;
        }
        self.last = *setpoint;
        self.commanded |= self.now != 0;
    }

    /// Stores the last checked sample as sample `at` of the buffers.
    pub fn note(&mut self, at: usize) {
        self.stepped[at] = self.now;
        self.recorded = true;
    }

    /// True if the setpoint explains a jump of a joint's input at sample `at`, or if there are no
    /// setpoints. A drive may respond a few samples late.
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
        (self.now, self.recorded) = (0, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_step_between_two_places_of_the_grid_belongs_to_the_next_one() {
        let mut steps = SetpointSteps::new(20);
        let at = |q: f64| {
            let mut setpoint = [0.0; MAX_JOINTS];
            setpoint[1] = q;
            setpoint
        };
        for k in 0..10 {
            steps.look(&at(0.0), 2);
            steps.note(k);
        }
        // a step in a sample that completes no grid value, then no step
        steps.look(&at(1.0), 2);
        steps.look(&at(1.0), 2);
        steps.note(10);
        for k in 11..20 {
            steps.look(&at(1.0), 2);
            steps.note(k);
        }
        let explained: Vec<usize> = (0..20).filter(|&k| steps.explain(1, k)).collect();
        assert_eq!(explained, [10, 11, 12, 13, 14, 15]);
        assert!(!(0..20).any(|k| steps.explain(0, k)));
    }
}
