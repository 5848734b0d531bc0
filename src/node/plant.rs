//! The plant as a value: each call gives the next sample of the stream.

use crate::messages::{Sample, sample_flags};
use crate::model::JointSample;

/// Turns a simulated machine into the sample stream seq 0, 1, 2, …, t = seq·Δ, the last one flagged `END`.
pub struct PlantNode<S> {
    source: S,
    boot_id: u64,
    joints: usize,
    signals: u32,
    period_ns: u64,
    seq: u64,
    samples: u64,
    lost: Option<Box<dyn FnMut() -> bool + Send>>,
}

impl<S: Iterator<Item = JointSample>> PlantNode<S> {
    /// A stream of at most `samples` samples from `source`, `period_ns` apart.
    ///
    /// `signals` states which of the sample's arrays hold data ([`crate::messages::signals`]).
    pub fn new(source: S, boot_id: u64, joints: usize, signals: u32, period_ns: u64, samples: u64) -> Self {
        Self {
            source,
            boot_id,
            joints,
            signals,
            period_ns,
            seq: 0,
            samples,
            lost: None,
        }
    }

    /// Loses the samples for which `lost` says so: their `seq` never appears. The last one is always sent.
    #[must_use]
    pub fn with_losses(mut self, lost: impl FnMut() -> bool + Send + 'static) -> Self {
        self.lost = Some(Box::new(lost));
        self
    }

    /// The next sample; `None` after the one flagged `END`.
    pub fn next_sample(&mut self) -> Option<Sample> {
        if self.seq >= self.samples {
            return None;
        }
        let mut joints = self.source.next()?;
        while self.seq + 1 < self.samples && self.lost.as_mut().is_some_and(|lost| lost()) {
            joints = self.source.next()?;
            self.seq += 1;
        }
        let t_ns = self.seq * self.period_ns;
        let mut sample = Sample::new(self.boot_id, self.seq, t_ns, self.joints, self.signals, &joints);
        self.seq += 1;
        if self.seq == self.samples {
            sample.flags |= sample_flags::END;
        }
        Some(sample)
    }

    /// Makes the next sample the last one, so that every consumer learns of the end.
    pub fn end_early(&mut self) {
        self.samples = self.samples.min(self.seq + 1);
    }

    /// Samples given so far.
    pub fn position(&self) -> u64 {
        self.seq
    }

    /// Samples of the whole stream.
    pub fn len(&self) -> u64 {
        self.samples
    }

    /// True for a stream without samples.
    pub fn is_empty(&self) -> bool {
        self.samples == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::signals;

    fn plant(samples: u64) -> PlantNode<impl Iterator<Item = JointSample>> {
        PlantNode::new(
            std::iter::repeat(JointSample::default()),
            7,
            2,
            signals::ALL,
            1_000_000,
            samples,
        )
    }

    #[test]
    fn prop_170_s_are_seq_0_to_169_999_and_the_last_one_ends_the_stream() {
        let mut plant = plant(170_000);
        let stream: Vec<Sample> = std::iter::from_fn(|| plant.next_sample()).collect();
        assert_eq!(stream.len(), 170_000);
        assert_eq!(stream[169_999].seq, 169_999);
        assert_eq!(stream[169_999].t_ns, 169_999_000_000);
        assert_eq!(stream.iter().filter(|s| s.is_end()).count(), 1);
        assert!(stream[169_999].is_end());
    }

    #[test]
    fn fault_lost_samples_leave_holes_in_seq_and_never_take_the_end() {
        let mut odd = false;
        let mut plant = plant(10).with_losses(move || {
            odd = !odd;
            odd
        });
        let seqs: Vec<u64> = std::iter::from_fn(|| plant.next_sample()).map(|s| s.seq).collect();
        assert_eq!(seqs, [1, 3, 5, 7, 9]);
    }

    #[test]
    fn prop_an_early_end_flags_the_next_sample_and_stops() {
        let mut plant = plant(10);
        assert!(!plant.next_sample().is_some_and(|s| s.is_end()));
        plant.end_early();
        assert!(plant.next_sample().is_some_and(|s| s.is_end() && s.seq == 1));
        assert_eq!(plant.next_sample(), None);
        plant.end_early();
        assert_eq!(plant.next_sample(), None);
    }
}
