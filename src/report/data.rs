//! A run, reduced to the data for its figures: every estimate, and thinned samples.

use super::summary::Summary;
use super::words::{DERIVED_USABLE, Known, headline};
use crate::messages::{Estimate, Sample, Status, sample_flags, signals};
use crate::model::MAX_JOINTS;
use crate::node::monitor::{Label, MonitorNode, seconds};
use crate::node::predicted_input::PredictedInput;
use crate::recording::{Entry, Loss, ReadError, RecordingReader, RunInfo};
use std::collections::VecDeque;

/// Buckets of a thinned trace: at least twice the pixels of a figure's width.
const BUCKETS: usize = 4096;
/// Number of samples remembered until the estimate of their block arrives.
const REMEMBERED: usize = 1 << 16;
/// Stream time at the end of the run over which inputs are compared \[ns\].
const COMPARED_NS: u64 = 10_000_000_000;
/// Smallest time between two of them \[ns\]: a figure has some hundreds of pixels.
const COMPARED_STEP_NS: u64 = 4_000_000;

/// A thinned signal over time: of neighbouring samples the first, last, smallest and largest value
/// stay, and so do steps and peaks.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    buckets: Vec<Bucket>,
    per_bucket: usize,
    /// Samples in the last bucket.
    filled: usize,
}

#[derive(Debug, Clone, Copy)]
struct Bucket {
    t_s: f64,
    first: f64,
    min: f64,
    max: f64,
    last: f64,
}

impl Bucket {
    fn add(&mut self, later: &Self) {
        self.min = self.min.min(later.min);
        self.max = self.max.max(later.max);
        self.last = later.last;
    }
}

impl Trace {
    fn push(&mut self, t_s: f64, value: f64) {
        if !value.is_finite() {
            return;
        }
        let new = Bucket {
            t_s,
            first: value,
            min: value,
            max: value,
            last: value,
        };
        self.per_bucket = self.per_bucket.max(1);
        match self.buckets.last_mut() {
            Some(bucket) if self.filled < self.per_bucket => {
                bucket.add(&new);
                self.filled += 1;
                return;
            }
            _ => {}
        }
        if self.buckets.len() == BUCKETS {
            self.buckets = self
                .buckets
                .chunks(2)
                .map(|pair| {
                    let mut merged = pair[0];
                    pair[1..].iter().for_each(|later| merged.add(later));
                    merged
                })
                .collect();
            self.per_bucket *= 2;
        }
        self.buckets.push(new);
        self.filled = 1;
    }

    /// Time \[s\] and value, to be connected by a line.
    pub fn points(&self) -> Vec<(f64, f64)> {
        let mut points = Vec::with_capacity(self.buckets.len());
        for b in &self.buckets {
            points.push((b.t_s, b.first));
            for value in [b.min, b.max, b.last] {
                if points.last().is_none_or(|p| p.1 != value) {
                    points.push((b.t_s, value));
                }
            }
        }
        // A constant level needs only its ends.
        let mut kept: Vec<(f64, f64)> = Vec::with_capacity(points.len());
        for (i, &point) in points.iter().enumerate() {
            let held = kept.last().is_some_and(|p| p.1 == point.1) && points.get(i + 1).is_some_and(|p| p.1 == point.1);
            if !held {
                kept.push(point);
            }
        }
        kept
    }
}

/// Timing of an estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// The block.
    pub block: u64,
    /// Stream time of the block's last sample \[s\].
    pub t_s: f64,
    /// Clock time of sending that sample \[ns\].
    pub sample_sent_ns: u64,
    /// From sending that sample to sending the estimate \[s\].
    pub latency_s: f64,
}

/// Notes on a run beyond its recording, from the configuration and the machine.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Notes {
    /// Meaning of each parameter, in the order of θ, then of each derived value; may be shorter or
    /// empty.
    pub meanings: Vec<String>,
    /// Rows are divided by their standard deviation, so that residuals have no unit.
    pub whitened: bool,
    /// When the recording began, as text; empty if unknown.
    pub begun: String,
    /// Where the report was made; empty if unknown.
    pub host: String,
    /// Lower and upper bound of each parameter, in the order of θ, infinite if there is none; may
    /// be empty.
    pub bounds: Vec<(f64, f64)>,
}

/// Measured and predicted inputs of the machine at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Stream time \[ns\].
    pub t_ns: u64,
    /// Measured input of each joint, in the drive's unit; `NaN` if it is not measured.
    pub measured: [f64; MAX_JOINTS],
    /// Predicted by the estimate of the blocks before; `NaN` if it is not known.
    pub predicted: [f64; MAX_JOINTS],
}

/// Everything that a report shows of a run.
pub struct RunData {
    /// Names, units, configuration.
    pub info: RunInfo,
    /// Summary, changes, truth.
    pub monitor: MonitorNode,
    /// The estimates of the last stream.
    pub estimates: Vec<Estimate>,
    /// Commanded position of each joint.
    pub setpoint: Vec<Trace>,
    /// Position of each joint.
    pub position: Vec<Trace>,
    /// Timing of each block whose samples were received.
    pub timing: Vec<Timing>,
    /// What the recording has lost.
    pub loss: Loss,
    /// Number of samples.
    pub samples: u64,
    /// Further notes.
    pub notes: Notes,
    /// The inputs of the last seconds; empty without a model that predicts them.
    pub inputs: VecDeque<Inputs>,
    prediction: Option<PredictedInput>,
    ended: bool,
    /// Stream time and clock time of the last samples.
    sent: VecDeque<(u64, u64)>,
    /// Estimates that arrived before the last sample of their block.
    waiting: Vec<(u64, u64, u64)>,
}

impl RunData {
    /// A run without data.
    pub fn new(info: RunInfo, monitor: MonitorNode) -> Self {
        let joints = info.joints;
        Self {
            info,
            monitor,
            estimates: Vec::new(),
            setpoint: vec![Trace::default(); joints],
            position: vec![Trace::default(); joints],
            timing: Vec::new(),
            loss: Loss::default(),
            samples: 0,
            notes: Notes::default(),
            inputs: VecDeque::new(),
            prediction: None,
            ended: false,
            sent: VecDeque::new(),
            waiting: Vec::new(),
        }
    }

    /// The same with a prediction of the inputs.
    #[must_use]
    pub fn predicting(mut self, prediction: Option<PredictedInput>) -> Self {
        self.prediction = prediction;
        self
    }

    /// Reads a whole recording; `look` is called after each message.
    ///
    /// # Errors
    /// If the file system fails.
    pub fn read(
        mut self,
        mut reader: RecordingReader,
        mut look: impl FnMut(&RecordingReader),
    ) -> Result<Self, ReadError> {
        let run = &mut self;
        while let Some(entry) = reader.next_entry()? {
            match entry {
                Entry::Sample { sample, sent_ns } => run.sample(sample, sent_ns),
                Entry::Estimate { estimate, sent_ns } => run.estimate(estimate, sent_ns),
                Entry::Status { status, .. } => run.status(status),
                Entry::Recorder(_) => {}
            }
            look(&reader);
        }
        run.loss = reader.loss();
        Ok(self)
    }

    /// Takes a sample; `sent_ns` is the clock at sending, 0 if it is not known.
    pub fn sample(&mut self, sample: &Sample, sent_ns: u64) {
        self.samples += 1;
        self.ended |= sample.flags & sample_flags::END != 0;
        let t_s = seconds(sample.t_ns);
        for (trace, &value) in self.setpoint.iter_mut().zip(&sample.setpoint) {
            trace.push(t_s, value);
        }
        for (trace, &value) in self.position.iter_mut().zip(&sample.q) {
            trace.push(t_s, value);
        }
        self.compare(sample);
        if sent_ns == 0 {
            return;
        }
        if let Some(index) = self.waiting.iter().position(|w| w.0 == sample.t_ns) {
            let (t_ns, block, estimate_sent_ns) = self.waiting.swap_remove(index);
            self.time(block, t_ns, sent_ns, estimate_sent_ns);
        }
        if self.sent.len() == REMEMBERED {
            self.sent.pop_front();
        }
        self.sent.push_back((sample.t_ns, sent_ns));
    }

    /// Takes an estimate; `sent_ns` is the clock at sending, 0 if it is not known.
    pub fn estimate(&mut self, estimate: &Estimate, sent_ns: u64) {
        let stream_id = self.estimates.last().map(|e| e.stream_id);
        if stream_id.is_some_and(|own| own != estimate.stream_id) {
            self.estimates.clear();
            self.timing.clear();
            self.inputs.clear();
        }
        if !self.monitor.on_estimate(estimate) {
            return;
        }
        if let Some(prediction) = &mut self.prediction {
            prediction.on_estimate(estimate);
        }
        self.estimates.push(*estimate);
        if sent_ns == 0 {
            return;
        }
        let last = estimate.t_last_ns;
        match self.sent.iter().rev().find(|sample| sample.0 == last) {
            Some(&(_, sample_sent_ns)) => self.time(estimate.block, last, sample_sent_ns, sent_ns),
            None => self.waiting.push((last, estimate.block, sent_ns)),
        }
    }

    /// Time over which derivatives of the motion were computed to predict inputs \[s\]; `None` if
    /// the samples carry them.
    pub fn smoothed_s(&self) -> Option<f64> {
        self.prediction.as_ref().and_then(PredictedInput::smoothed_s)
    }

    /// Keeps the inputs of the last seconds, thinned out.
    fn compare(&mut self, sample: &Sample) {
        let (inputs, Some(prediction)) = (&mut self.inputs, &mut self.prediction) else {
            return;
        };
        prediction.push(sample, |passed| {
            let (t_ns, has_input) = (passed.sample.t_ns, passed.sample.signals & signals::INPUT != 0);
            let newest = inputs.back().map(|last| last.t_ns);
            if newest.is_some_and(|newest| t_ns < newest) {
                inputs.clear();
            } else if newest.is_some_and(|newest| t_ns - newest < COMPARED_STEP_NS) {
                return;
            }
            inputs.push_back(Inputs {
                t_ns,
                measured: if has_input {
                    passed.sample.input
                } else {
                    [f64::NAN; MAX_JOINTS]
                },
                predicted: passed.input(),
            });
            while inputs.front().is_some_and(|first| t_ns - first.t_ns > COMPARED_NS) {
                inputs.pop_front();
            }
        });
    }

    /// Takes a status.
    pub fn status(&mut self, status: &Status) {
        self.monitor.on_status(status);
    }

    /// The summary of the run.
    pub fn summary(&self) -> Summary {
        Summary::new(&self.monitor, &self.info.robot, &self.info.model)
    }

    /// The result in a sentence: what changed, otherwise the best-known value; `None` if nothing is
    /// usable.
    pub fn headline(&self) -> Option<String> {
        let last = self.estimates.last()?;
        let change_t_s = self.monitor.changes().last().map(|change| change.t_s);
        let before = |t_s: f64| self.estimates.iter().rev().filter(move |e| seconds(e.t_last_ns) <= t_s);
        let numbers = |index: usize, derived: bool| {
            let of = move |e: &Estimate| match derived {
                false => (e.theta[index], e.theta_std[index], e.is_usable(index)),
                true => {
                    let (value, std) = (e.derived[index], e.derived_std[index]);
                    (value, std, e.use_ok == 1 && 3.0 * std < DERIVED_USABLE * value.abs())
                }
            };
            let earlier = change_t_s.and_then(|t_s| before(t_s).map(of).find(|known| known.2));
            (of(last), earlier.map(|(value, std, _)| (value, std)))
        };
        let known = |(index, label): (usize, &'_ Label), derived: bool| {
            let ((value, std, usable), before) = numbers(index, derived);
            (label.clone(), value, std, usable, derived, before)
        };
        let parameters = self.monitor.parameters().iter().take(last.theta.len()).enumerate();
        let derived = self.monitor.derived().iter().take(last.derived.len()).enumerate();
        let all: Vec<_> = parameters
            .map(|item| known(item, false))
            .chain(derived.map(|item| known(item, true)))
            .collect();
        let all: Vec<Known<'_>> = all
            .iter()
            .map(|(label, value, std, usable, derived, before)| Known {
                name: &label.name,
                unit: &label.unit,
                value: *value,
                std: *std,
                usable: *usable,
                derived: *derived,
                before: *before,
            })
            .collect();
        headline(&all, change_t_s)
    }

    /// Length of a block in stream time \[s\]; `None` with fewer than two estimates.
    pub fn block_s(&self) -> Option<f64> {
        let (first, last) = (self.estimates.first()?, self.estimates.last()?);
        let blocks = last.block.checked_sub(first.block).filter(|&n| n > 0)?;
        let span = last.t_last_ns.checked_sub(first.t_last_ns)?;
        Some(span as f64 * 1e-9 / blocks as f64)
    }

    fn time(&mut self, block: u64, t_ns: u64, sample_sent_ns: u64, estimate_sent_ns: u64) {
        let latency_s = estimate_sent_ns.saturating_sub(sample_sent_ns) as f64 * 1e-9;
        let at = self.timing.partition_point(|t| t.block < block);
        let timing = Timing {
            block,
            t_s: seconds(t_ns),
            sample_sent_ns,
            latency_s,
        };
        self.timing.insert(at, timing);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_thinned_trace_keeps_its_extremes_and_its_steps() {
        let mut trace = Trace::default();
        for i in 0..1_000_000 {
            let value = match i {
                345_678 => 7.0,
                999_999 => -7.0,
                i if i < 500_000 => 0.0,
                _ => 1.0,
            };
            trace.push(i as f64 * 1e-3, value);
        }
        let points = trace.points();
        assert!(points.len() < 20, "{}", points.len());
        assert!(trace.buckets.len() <= BUCKETS);
        let largest = points.iter().map(|p| p.1).fold(f64::MIN, f64::max);
        assert_eq!((largest, points.last().map(|p| p.1)), (7.0, Some(-7.0)));
        // The step lies within a bucket of its time: 1000 s in at least 2048 buckets.
        let step = points.iter().find(|p| p.0 > 400.0 && p.1 == 1.0).unwrap();
        assert!((step.0 - 500.0).abs() < 0.5, "{step:?}");
    }
}
