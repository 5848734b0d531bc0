//! A robot drawn at random, identified as in the service by default, and compared with the truth.

use super::random_case::RandomRobotCase;
use super::random_faults::RandomFaults;
use super::random_machine::{LENGTH_S, RandomRobot};
use crate::messages::{Estimate, Sample, State, estimate_flags, nanoseconds};
use crate::random::Random;
use crate::robot::{FrictionTerm, RobotError, RobotSimulator};
use crate::studies::draw::Draw;
use crate::studies::trials::{TrialResult, Truth};

/// Runs a case with the machine of a seed.
///
/// # Errors
/// If the robot cannot be simulated or identified.
pub fn random_robot_trial(case: RandomRobotCase, seed: u64) -> Result<TrialResult, RobotError> {
    let mut draw = Draw(Random(seed.wrapping_mul(64).wrapping_add(case as u64)));
    let mut machine = RandomRobot::new(case, seed, &mut draw)?;
    let mut faults = RandomFaults::new(case, &mut machine, &mut draw);
    let (options, n) = (&machine.options, machine.robot.len());
    let simulator = RobotSimulator::new(&machine.robot, options.clone())?;
    let mut node = machine.node()?;
    let model = node.learner().robot().model();
    let names: Vec<String> = model.parameters().iter().map(|p| p.name.clone()).collect();
    let offsets: Vec<usize> = (0..n)
        .filter_map(|j| model.friction_term(j, FrictionTerm::Offset))
        .collect();
    let period_ns = nanoseconds(options.sample_period_s);
    let truths = [0.0, LENGTH_S].map(|t_s| simulator.truth(model, t_s));
    let mut result = TrialResult::default();
    let count = (LENGTH_S / options.sample_period_s) as usize;
    for (seq, mut joints) in (0..).zip(simulator.take(count)) {
        let Some(t_ns) = faults.disturb(seq, period_ns, &mut joints) else {
            continue;
        };
        let sample = Sample::new(1, seq, t_ns, n, machine.mask(), &joints);
        let mut closed: Option<Estimate> = None;
        node.on_sample(&sample, &mut |estimate| closed = Some(*estimate));
        let Some(estimate) = closed else { continue };
        let end_s = estimate.t_last_ns as f64 * 1e-9;
        let is_loaded = faults.changes_within(f64::NEG_INFINITY, end_s);
        let mut theta = truths[usize::from(is_loaded)].clone();
        let payload = theta.split_off(names.len()).first().copied().unwrap_or(0.0);
        for (joint, &i) in offsets.iter().enumerate() {
            theta[i] += faults.offset(joint, end_s);
        }
        let truth = Truth {
            names: &names,
            theta: &theta,
            derived: &[("payload_mass".to_owned(), payload)],
            bound: None,
            changed: faults.changes_within(end_s - 1.0, end_s),
            changed_before: faults.changes_within(end_s - 2.0, end_s - 1.0),
            mark: false,
        };
        result.add(&estimate, &truth);
        if estimate.state == State::Misfit as u32 {
            result.named_cause = Some(node.status().error.words().to_owned());
        }
        let is_told = estimate.flags & estimate_flags::CHANGED != 0;
        result.detected |= u64::from(is_told && is_loaded);
    }
    result.changes = u64::from(faults.changes_within(0.0, LENGTH_S));
    Ok(result)
}
