//! One trial: an identifier's estimates from the simulated machine's samples, compared with the
//! truth.

use super::bound::CramerRaoBound;
use super::score::{TrialResult, Truth};
use crate::messages::{Estimate, Sample, estimate_flags, nanoseconds};
use crate::model::{DerivedValues, KnownConstants, Manipulator, ManipulatorDerived, Plant};
use crate::node::simulated_plant::sample_stream;
use crate::sim::{ArmSimulator, ControllerKind, Machine, SensorOptions, SimOptions, Unmodelled};
use crate::studies::CompareError;

/// Shares of the run before the change at which efficiency is measured.
const MARKS: [f64; 3] = [0.33, 0.66, 1.0];
/// Both joints are at rest if for this time \[s\]
const REST_S: f64 = 0.5;
/// neither is faster than this \[rad/s\].
const REST_RAD_PER_S: f64 = 1e-3;

/// A trial ready to run.
#[derive(Debug, Clone, Copy)]
pub struct Trial<'a> {
    /// The machine and its sensors.
    pub sim: &'a SimOptions,
    /// N of the identifier.
    pub block_len: u64,
    /// Names of the identifier's parameters.
    pub names: &'a [String],
    /// Constants for the identifier's derived values.
    pub known: Option<KnownConstants>,
}

impl Trial<'_> {
    /// Passes each sample to `identify`, which appends the published estimates, and scores these.
    ///
    /// The Cramér–Rao bound of the same run without its disturbance is computed until the payload
    /// changes.
    ///
    /// # Errors
    /// If the simulation's options are invalid.
    pub fn run(&self, mut identify: impl FnMut(&Sample, &mut Vec<Estimate>)) -> Result<TrialResult, CompareError> {
        let sim = self.sim;
        let mut plant = sample_stream(sim, 1)?;
        let derived = self.known.and_then(|known| ManipulatorDerived::new(known).ok());
        let block_ns = self.block_len * nanoseconds(sim.sample_period_s);
        let end_ns = nanoseconds(sim.duration_s);
        let changes_ns = self.changes_ns();
        let first_change_ns = changes_ns.first().copied().unwrap_or(u64::MAX);
        let quiet_blocks = first_change_ns.min(end_ns) / block_ns;
        let marks = MARKS.map(|share| ((share * quiet_blocks as f64) as u64).max(1));
        // A new mass applies from its own sample on, so a change at a border belongs to the block
        // that begins there.
        let changes_in = |block: u64| {
            let from_ns = block.saturating_sub(1) * block_ns;
            changes_ns.iter().any(|&t| t >= from_ns && t < from_ns + block_ns)
        };

        let mut bound = self.reference()?;
        let mut result = TrialResult::default();
        let mut estimates: Vec<Estimate> = Vec::with_capacity(2);
        let mut announced_ns: Vec<u64> = Vec::new();
        while let Some(sample) = plant.next_sample() {
            if sample.t_ns >= first_change_ns {
                bound = None;
            }
            if let Some(reference) = &mut bound {
                reference.advance_to(sample.seq);
            }
            identify(&sample, &mut estimates);
            for estimate in estimates.drain(..) {
                let theta = self.true_theta(estimate.t_last_ns as f64 * 1e-9);
                let std = bound.as_ref().map(|reference| reference.bound.std());
                if estimate.flags & estimate_flags::CHANGED != 0 {
                    announced_ns.push(estimate.t_last_ns);
                }
                let truth = Truth {
                    names: self.names,
                    theta: &theta,
                    derived: &derived_truth(derived.as_ref(), &sim.true_theta(estimate.t_last_ns as f64 * 1e-9)),
                    bound: std.as_ref().map(|std| &std[..]),
                    changed: changes_in(estimate.block),
                    changed_before: estimate.block > 1 && changes_in(estimate.block - 1),
                    mark: marks.contains(&estimate.block),
                };
                result.add(&estimate, &truth);
            }
        }
        result.changes = changes_ns.len() as u64;
        let in_time = |t: u64| announced_ns.iter().any(|&last| last >= t && last < t + 2 * block_ns);
        result.detected = changes_ns.iter().filter(|&&t| in_time(t)).count() as u64;
        Ok(result)
    }

    /// True θ, in the order of the identifier's parameters.
    fn true_theta(&self, t_s: f64) -> Vec<f64> {
        let names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        self.sim.true_values(&names, t_s)
    }

    /// When the mass changes.
    fn changes_ns(&self) -> Vec<u64> {
        let schedule = match &self.sim.machine {
            Machine::Arm => &self.sim.mass_2,
            Machine::ServoAxis(axis) => &axis.mass,
            Machine::Plant(plant) => {
                let changes = plant.truth.iter().skip(1);
                return changes.map(|(t_s, _)| nanoseconds(*t_s)).collect();
            }
        };
        let changes = schedule.points.windows(2).filter(|pair| pair[0].1 != pair[1].1);
        changes.map(|pair| nanoseconds(pair[1].0)).collect()
    }

    /// The undisturbed arm with its bound; `None` for other machines and controllers.
    fn reference(&self) -> Result<Option<Reference>, CompareError> {
        let sim = self.sim;
        let sensors = &sim.sensors;
        let sampled = sim.controller.kind == ControllerKind::Sampled;
        // the bound is that of the paper's nine parameters, whose indices a delay does not change
        let arm = Manipulator::default();
        let nine = arm.parameters().iter().map(|p| &*p.name);
        let nine = nine.eq(self.names.iter().map(String::as_str).take(arm.parameters().len()));
        if sim.machine != Machine::Arm || !sampled || sensors.encoder_bits == 0 || !nine {
            return Ok(None);
        }
        let ideal = SimOptions {
            sensors: SensorOptions::exact(),
            unmodelled: Unmodelled::none(),
            ..sim.clone()
        };
        let variance = sensors.resolution_rad().powi(2) / 12.0 + sensors.position_noise_rad.powi(2);
        Ok(Some(Reference {
            arm: ArmSimulator::new(&ideal)?,
            bound: CramerRaoBound::new(&ideal, variance.sqrt(), sensors.input_noise_v).with_unknown_start(),
        }))
    }
}

/// The undisturbed run.
struct Reference {
    arm: ArmSimulator,
    bound: CramerRaoBound,
}

impl Reference {
    /// Takes all samples up to this one, including lost ones.
    fn advance_to(&mut self, seq: u64) {
        while self.arm.position() <= seq
            && let Some(sample) = self.arm.next()
        {
            self.bound.advance([sample.setpoint[0], sample.setpoint[1]]);
        }
    }
}

fn derived_truth(derived: Option<&ManipulatorDerived>, theta: &[f64]) -> Vec<(String, f64)> {
    let mut gradient = theta.to_vec();
    derived.map_or_else(Vec::new, |derived| {
        let quantities = derived.quantities().iter().enumerate();
        quantities
            .map(|(i, quantity)| {
                (
                    quantity.name.to_string(),
                    derived.value_and_gradient(i, theta, &mut gradient),
                )
            })
            .collect()
    })
}

/// First time from `from_s` on at which both joints of the arm have rested for half a second \[s\];
/// `None` if they never do.
pub fn rest_instant(sim: &SimOptions, from_s: f64) -> Option<f64> {
    let mut since: Option<u64> = None;
    let needed = (REST_S / sim.sample_period_s) as u64;
    // Derivatives are missing if positions are measured.
    let exact = SimOptions {
        sensors: SensorOptions::exact(),
        ..sim.clone()
    };
    for (k, sample) in (0..sim.sample_count()).zip(ArmSimulator::new(&exact).ok()?) {
        let rests = sample.dq.iter().all(|dq| dq.abs() < REST_RAD_PER_S);
        since = if rests { since.or(Some(k)) } else { None };
        let t_s = k as f64 * sim.sample_period_s;
        if t_s >= from_s && since.is_some_and(|since| k - since >= needed) {
            return Some(t_s);
        }
    }
    None
}
