//! The simulated machine as a stream of messages, with its losses, faults and time stamps.

use super::model::{Model, ModelError, SampleSource};
use super::plant::PlantNode;
use crate::messages::nanoseconds;
use crate::model::JointSample;
use crate::sim::{Faults, Losses, Machine, MachineSimulator, SampleInstants, SimError, SimOptions};

/// Why there are no samples of a machine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StreamError {
    /// The options of the simulation.
    #[error(transparent)]
    Options(#[from] SimError),
    /// The model, whose equations are simulated.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// All samples of a run of a built-in machine, from seq 0 to END; `stream_id` identifies the
/// stream.
///
/// # Errors
/// If the options are invalid, see [`SimOptions::validate`].
pub fn sample_stream(options: &SimOptions, stream_id: u64) -> Result<PlantNode<MachineSimulator>, SimError> {
    Ok(with_sensor_faults(MachineSimulator::new(options)?, options, stream_id))
}

/// The same for any machine that the options name; `model` has the equations if these are
/// simulated.
///
/// # Errors
/// If the options are invalid, or the model cannot be simulated.
pub fn sample_stream_of(
    model: &dyn Model,
    options: &SimOptions,
    stream_id: u64,
) -> Result<PlantNode<SampleSource>, StreamError> {
    let source: SampleSource = match options.machine {
        Machine::Plant(_) => model.simulator(options)?,
        _ => Box::new(MachineSimulator::new(options)?),
    };
    Ok(with_sensor_faults(source, options, stream_id))
}

/// Counts the samples that a simulation loses on purpose, by `plant.sensors.loss_probability`.
#[derive(Debug, Clone)]
pub struct SimulatedLosses {
    /// `None` if none are lost.
    losses: Option<Losses>,
    /// Samples of which some may be lost: the last one of a run is always sent.
    most: u64,
    samples: u64,
    lost: u64,
}

impl SimulatedLosses {
    /// Those of a run.
    pub fn new(options: &SimOptions) -> Self {
        let any = options.sensors.loss_probability > 0.0;
        Self {
            losses: any.then(|| Losses::new(&options.sensors, options.seed)),
            most: options.sample_count().saturating_sub(1),
            samples: 0,
            lost: 0,
        }
    }

    /// Number of lost samples among the first `samples`, which may not decrease from call to call.
    pub fn among(&mut self, samples: u64) -> u64 {
        if let Some(losses) = &mut self.losses {
            while self.samples < samples.min(self.most) {
                self.lost += u64::from(losses.next_is_lost());
                self.samples += 1;
            }
        }
        self.lost
    }
}

/// Applies sensor and transport faults to the samples of a machine.
fn with_sensor_faults<S: Iterator<Item = JointSample>>(
    source: S,
    options: &SimOptions,
    stream_id: u64,
) -> PlantNode<S> {
    let period_ns = nanoseconds(options.sample_period_s);
    let (joints, signals) = (options.joints(), options.signals());
    let mut node = PlantNode::new(source, stream_id, joints, signals, period_ns, options.sample_count());
    if options.sensors.loss_probability > 0.0 {
        let mut losses = Losses::new(&options.sensors, options.seed);
        node = node.with_losses(move || losses.next_is_lost());
    }
    if options.sensors.stamp_jitter_s > 0.0 {
        let mut instants = SampleInstants::new(options);
        node = node.with_stamps(move || instants.next_offset_ns());
    }
    if !options.faults.is_empty() {
        let mut faults = Faults::new(&options.faults, options.sample_period_s, options.seed);
        node = node.with_faults(move |sample| faults.apply(sample));
    }
    node
}
