//! The simulated machine as a stream of messages, with its losses, faults and time stamps.

use super::plant::PlantNode;
use crate::sim::{Faults, Losses, MachineSimulator, SampleInstants, SimError, SimOptions};

/// All samples of a run, from seq 0 to END; `boot_id` names the stream.
///
/// # Errors
/// The options are not valid, see [`SimOptions::validate`].
pub fn sample_stream(options: &SimOptions, boot_id: u64) -> Result<PlantNode<MachineSimulator>, SimError> {
    let simulator = MachineSimulator::new(options)?;
    let period_ns = (options.sample_period_s * 1e9).round() as u64;
    let (joints, signals) = (options.joints(), options.signals());
    let mut node = PlantNode::new(simulator, boot_id, joints, signals, period_ns, options.sample_count());
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
    Ok(node)
}
