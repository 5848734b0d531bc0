//! The controller's loop.
//!
//! ```text
//! sample k ─▶ motion wanted between k + 1 and k + 2 ─▶ feed-forward from θ ─▶ command in answer to k
//! estimates ─▶ θ, at once
//! ```

use super::{RunError, Shutdown, Stay, TICK};
use crate::bus::{Publisher, SampleSubscriber, Subscriber};
use crate::control::{AdaptiveFeedForward, Trajectory};
use crate::messages::{Estimate, MachineCommand, Sample};
use std::time::Instant;

/// Samples received before estimates and signals are checked again.
const BATCH: usize = 64;

/// Ports of a controller.
#[derive(Debug)]
pub struct ControllerPorts {
    /// Samples in.
    pub samples: SampleSubscriber,
    /// Estimates in; `None` for a controller that does not adapt.
    pub estimates: Option<Subscriber<Estimate>>,
    /// Commands out.
    pub commands: Publisher<MachineCommand>,
}

/// The trajectory and the feed-forward.
#[derive(Debug)]
pub struct Follower {
    /// The trajectory from its beginning, restarted for each stream.
    pub trajectory: Trajectory,
    /// Converts motion to input.
    pub feed_forward: AdaptiveFeedForward,
    /// Sample period \[ns\].
    pub period_ns: u64,
    /// Stream time for which a command is valid \[ns\].
    pub deadline_ns: u64,
}

/// Answers samples with commands until asked to stop, or to the end of the first stream; returns
/// the number of answers.
///
/// # Errors
/// If the bus fails.
pub fn run_controller(
    follower: &mut Follower,
    ports: &mut ControllerPorts,
    stay: Stay,
    shutdown: &Shutdown,
) -> Result<u64, RunError> {
    let mut path = Path::new(follower);
    let mut answered = 0;
    let mut tick = Instant::now();
    while !shutdown.requested() {
        ports.samples.refresh()?;
        ports.samples.wait(TICK)?;
        if tick.elapsed() >= TICK {
            ports.commands.serve_late_joiners()?;
            tick = Instant::now();
        }
        if let Some(estimates) = &mut ports.estimates {
            estimates.drain(|estimate| _ = follower.feed_forward.on_estimate(estimate))?;
        }
        let mut last: Option<Sample> = None;
        let mut ended = false;
        ports.samples.drain(BATCH, |sample| {
            ended |= sample.is_end();
            last = Some(*sample);
        })?;
        // Of samples that arrived together, only the newest needs an answer.
        let Some(sample) = last else { continue };
        if let Some(command) = path.answer(follower, &sample) {
            ports.commands.send(&command)?;
            answered += 1;
        }
        // the next stream may have begun in the same batch
        if ended && stay == Stay::UntilEnd {
            break;
        }
    }
    Ok(answered)
}

/// Position of the machine on the trajectory.
struct Path {
    stream_id: u64,
    last_seq: u64,
    beginning: Trajectory,
}

impl Path {
    fn new(follower: &Follower) -> Self {
        Self {
            stream_id: 0,
            last_seq: 0,
            beginning: follower.trajectory.clone(),
        }
    }

    /// The command that answers a sample; `None` if the trajectory has not caught up with it yet.
    fn answer(&mut self, follower: &mut Follower, sample: &Sample) -> Option<MachineCommand> {
        let next = sample.seq.checked_add(1)?;
        if sample.stream_id != self.stream_id || next <= follower.trajectory.position() && sample.seq < self.last_seq {
            (self.stream_id, self.last_seq) = (sample.stream_id, sample.seq);
            follower.trajectory = self.beginning.clone();
        }
        let samples = sample.seq.saturating_sub(self.last_seq).max(1);
        self.last_seq = sample.seq;
        if !follower.trajectory.advance_to(next) {
            return None;
        }
        let motion = follower.trajectory.advance();
        let dt_s = samples as f64 * follower.period_ns as f64 * 1e-9;
        Some(MachineCommand {
            stream_id: sample.stream_id,
            seq: sample.seq,
            until_ns: sample.t_ns.saturating_add(follower.deadline_ns),
            joints: sample.joints,
            feed_forward: follower.feed_forward.next(&motion, dt_s),
            ..MachineCommand::EMPTY
        })
    }
}
