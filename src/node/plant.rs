//! The plant as a value: each call gives the next sample of the stream.

use crate::messages::{Passage, Sample, sample_flags};
use crate::model::JointSample;

/// Turns a simulated machine into the sample stream seq 0, 1, 2, …, t = seq·Δ unless stamps say
/// otherwise, the last one flagged `END`.
pub struct PlantNode<S> {
    source: S,
    stream_id: u64,
    joints: usize,
    signals: u32,
    period_ns: u64,
    seq: u64,
    samples: u64,
    lost: Option<Box<dyn FnMut() -> bool + Send>>,
    faults: Option<Box<dyn FnMut(&mut Sample) -> Passage + Send>>,
    stamps: Option<Box<dyn FnMut() -> i64 + Send>>,
    /// Due time of the last sample \[ns of stream time\].
    due_ns: u64,
    /// Stream time until which the last command is valid \[ns\]; `None` if there is none.
    #[cfg(feature = "sim")]
    commanded_until_ns: Option<u64>,
}

impl<S: Iterator<Item = JointSample>> PlantNode<S> {
    /// A stream of at most `samples` samples from `source`, `period_ns` apart.
    ///
    /// `signals` states which of the sample's arrays hold data ([`crate::messages::signals`]).
    pub fn new(source: S, stream_id: u64, joints: usize, signals: u32, period_ns: u64, samples: u64) -> Self {
        Self {
            source,
            stream_id,
            joints,
            signals,
            period_ns,
            seq: 0,
            samples,
            lost: None,
            faults: None,
            stamps: None,
            due_ns: 0,
            #[cfg(feature = "sim")]
            commanded_until_ns: None,
        }
    }

    /// Loses the samples for which `lost` returns true: their `seq` never appears. The last one is
    /// always sent.
    #[must_use]
    pub fn with_losses(mut self, lost: impl FnMut() -> bool + Send + 'static) -> Self {
        self.lost = Some(Box::new(lost));
        self
    }

    /// Shifts each time stamp from its place on the grid by less than half a period either way
    /// \[ns\].
    #[must_use]
    pub fn with_stamps(mut self, offset_ns: impl FnMut() -> i64 + Send + 'static) -> Self {
        self.stamps = Some(Box::new(offset_ns));
        self
    }

    /// Lets `faults` change, lose or delay each sample. The last one is always sent.
    #[must_use]
    pub fn with_faults(mut self, faults: impl FnMut(&mut Sample) -> Passage + Send + 'static) -> Self {
        self.faults = Some(Box::new(faults));
        self
    }

    /// The next sample; `None` after the one flagged `END`.
    pub fn next_sample(&mut self) -> Option<Sample> {
        while self.seq < self.samples {
            let joints = self.source.next()?;
            let offset_ns = self.stamps.as_mut().map_or(0, |stamps| stamps());
            let t_ns = (self.seq * self.period_ns).saturating_add_signed(offset_ns);
            let mut sample = Sample::new(self.stream_id, self.seq, t_ns, self.joints, self.signals, &joints);
            self.seq += 1;
            let is_last = self.seq == self.samples;
            // Both draw for every sample except the last, so that neither affects the other's
            // random numbers.
            let lost = !is_last && self.lost.as_mut().is_some_and(|lost| lost());
            let passage = self
                .faults
                .as_mut()
                .map_or_else(Passage::default, |faults| faults(&mut sample));
            if is_last {
                sample.flags |= sample_flags::END;
            } else if lost || passage.lost {
                continue;
            }
            // A late sample delays the following ones.
            self.due_ns = self.due_ns.max(t_ns.saturating_add(passage.late_ns));
            return Some(sample);
        }
        None
    }

    /// Due time of the last sample \[ns of stream time\], independent of its time stamp.
    pub fn due_ns(&self) -> u64 {
        self.due_ns
    }

    /// Makes the next sample the last one, so that every consumer receives the end.
    pub fn end_early(&mut self) {
        self.samples = self.samples.min(self.seq + 1);
    }

    /// Number of samples so far.
    pub fn position(&self) -> u64 {
        self.seq
    }

    /// Number of samples of the whole stream.
    pub fn len(&self) -> u64 {
        self.samples
    }

    /// True for a stream without samples.
    pub fn is_empty(&self) -> bool {
        self.samples == 0
    }
}

#[cfg(feature = "sim")]
impl<S: crate::sim::Commanded> PlantNode<S> {
    /// Applies a controller's command to the following samples; false if it is for another stream,
    /// late, or not a number.
    pub fn command(&mut self, command: &crate::messages::MachineCommand) -> bool {
        let now_ns = self.seq * self.period_ns;
        let fits = command.stream_id == self.stream_id
            && command.until_ns > now_ns
            && command.feed_forward.iter().all(|input| input.is_finite());
        if fits {
            self.source.command(&command.feed_forward);
            self.commanded_until_ns = Some(command.until_ns);
        }
        fits
    }

    /// Drops a command that is too old, so that only the machine's own loop acts.
    pub fn forget_late_command(&mut self) {
        let now_ns = self.seq * self.period_ns;
        if self
            .commanded_until_ns
            .take_if(|until_ns| *until_ns <= now_ns)
            .is_some()
        {
            self.source.command(&[0.0; crate::model::MAX_JOINTS]);
        }
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
    fn fault_a_sample_held_up_is_due_later_and_holds_up_what_follows_it() {
        let mut plant = plant(6).with_faults(|sample| Passage {
            lost: sample.seq == 1,
            late_ns: if sample.seq == 2 { 2_500_000 } else { 0 },
        });
        let mut due = Vec::new();
        while let Some(sample) = plant.next_sample() {
            due.push((sample.seq, plant.due_ns()));
        }
        let ms = 1_000_000;
        assert_eq!(
            due,
            [(0, 0), (2, 4_500_000), (3, 4_500_000), (4, 4_500_000), (5, 5 * ms)]
        );
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
