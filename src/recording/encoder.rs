//! Encodes messages as in a recording, for streaming.

use super::cdr::CdrWriter;
use super::info::RunInfo;
use super::layout::{Channel, Counts, NameCollision, channels, check_names};
use super::unmeasured::marked;
use crate::messages::{Estimate, Message, Sample, Status};

/// Turns messages into the bytes that a [`Recorder`](super::Recorder) writes.
#[derive(Debug)]
pub struct Encoder {
    counts: Counts,
    channels: [Channel; 4],
    buffer: Vec<u8>,
}

impl Encoder {
    /// An encoder for a plant with these names.
    ///
    /// # Errors
    /// If two parameters have the same name in ROS 2 form.
    pub fn new(info: &RunInfo) -> Result<Self, NameCollision> {
        check_names(info)?;
        Ok(Self {
            counts: Counts::of(info),
            channels: channels(info),
            buffer: Vec::new(),
        })
    }

    /// Topics with their schemas: samples, estimates, statuses.
    pub fn channels(&self) -> &[Channel] {
        &self.channels[..3]
    }

    /// A sample as CDR.
    pub fn sample(&mut self, sample: &Sample) -> &[u8] {
        self.encode(marked(sample))
    }

    /// An estimate as CDR.
    pub fn estimate(&mut self, estimate: &Estimate) -> &[u8] {
        self.encode(*estimate)
    }

    /// A status as CDR.
    pub fn status(&mut self, status: &Status) -> &[u8] {
        self.encode(*status)
    }

    fn encode(&mut self, mut message: impl Message) -> &[u8] {
        let Ok(()) = message.visit(&mut CdrWriter::new(&mut self.buffer, &self.counts));
        &self.buffer
    }
}
