//! The closed loop, measured: how well a machine follows its trajectory with feed-forward from estimates.

use super::TrackArgs;
use crate::config::{Config, Source};
use crate::control::{AdaptiveFeedForward, AdaptiveOptions, Trajectory};
use crate::messages::Sample;
use crate::model::MAX_JOINTS;
use crate::node::model::SampleSource;
use crate::runner::Shutdown;
use crate::service::wiring::identifier_node;
use crate::service::{Exit, Failure, logging};
use crate::sim::{Machine, MachineSimulator, SimOptions};
use crate::studies::{Document, Section, Table, for_each_index, two_digits};

/// Time from which on a loop that began at rest is judged \[s\].
const SETTLED_S: f64 = 10.0;
/// Time after a change in which the identifier may find it \[s\].
const FOUND_S: f64 = 3.0;

/// Whose parameters the feed-forward is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Contender {
    Without,
    Fixed,
    Adaptive,
    Knowing,
}

impl Contender {
    const ALL: [(Self, &'static str); 4] = [
        (Self::Without, "own loop alone"),
        (Self::Fixed, "feed-forward, fixed"),
        (Self::Adaptive, "feed-forward, adaptive"),
        (Self::Knowing, "feed-forward that knows theta"),
    ];
}

/// Root mean squares of the tracking error \[rad or m\] per joint, before the change and after it, and the largest input.
#[derive(Debug, Clone, Copy, Default)]
struct Tracking {
    before: [f64; MAX_JOINTS],
    after: [f64; MAX_JOINTS],
    largest_input: f64,
    counts: [f64; 2],
}

/// Runs the loop with each contender and writes the table.
///
/// # Errors
/// A configuration without a controller, a change or smooth setpoints, a file that cannot be written.
pub fn run(args: &TrackArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let mut results: Vec<Vec<Tracking>> = Vec::new();
    let load = |seed: u64| {
        let own = [("plant.seed", Some(seed.to_string()))];
        args.common.load(vec![Source::File(args.file.clone())], &own)
    };
    let config = load(0)?;
    let change_s = change_s(&config.plant.sim)?;
    for (contender, _) in Contender::ALL {
        let runs = for_each_index(args.seeds as usize, |seed| {
            if shutdown.requested() {
                return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
            }
            follow(&load(seed as u64)?, contender, change_s)
        });
        results.push(runs.into_iter().collect::<Result<_, Failure>>()?);
    }
    let text = document(&config, &results, change_s).markdown(&command(args));
    match &args.out {
        Some(file) => {
            std::fs::write(file, text).map_err(|error| Failure::Failed(format!("{}: {error}", file.display())))?;
            logging::result(&format!("{}: written", file.display()))?;
        }
        None => logging::result(&text)?,
    }
    Ok(Exit::Done)
}

/// When the machine changes.
fn change_s(sim: &SimOptions) -> Result<f64, Failure> {
    let change = match &sim.machine {
        Machine::Arm => sim.mass_2.points.get(1).map(|point| point.0),
        Machine::ServoAxis(axis) => axis.mass.points.get(1).map(|point| point.0),
        Machine::Plant(plant) => plant.truth.get(1).map(|(t_s, _)| *t_s),
    };
    let fits = change.filter(|t_s| *t_s > SETTLED_S && t_s + 2.0 * FOUND_S < sim.duration_s);
    fits.ok_or_else(|| {
        Failure::Usage(format!(
            "track compares before and after a change: expected one later than {SETTLED_S} s and {} s before the end, got {change:?}",
            2.0 * FOUND_S
        ))
    })
}

/// One run of the closed loop: machine, sensors, identifier and controller, sample by sample.
fn follow(config: &Config, contender: Contender, change_s: f64) -> Result<Tracking, Failure> {
    let sim = &config.plant.sim;
    let mut machine: SampleSource = match sim.machine {
        Machine::Plant(_) => config.model.simulator(sim)?,
        _ => Box::new(MachineSimulator::new(sim).map_err(|e| Failure::Usage(e.to_string()))?),
    };
    let mut node = identifier_node(config)?;
    let mut trajectory = Trajectory::new(sim).map_err(|e| Failure::Usage(format!("plant.setpoint.kind: {e}")))?;
    let options = match contender {
        // true values are taken as they are
        Contender::Knowing => AdaptiveOptions {
            blend_s: 1e-6,
            ..config.controller.options
        },
        _ => config.controller.options,
    };
    let names: Vec<&str> = config.model.parameters().iter().map(|p| &*p.name).collect();
    let begin = |theta: &[f64]| {
        AdaptiveFeedForward::new(config.model.clone(), theta, options)
            .map_err(|e| Failure::Usage(format!("controller: {e}")))
    };
    let mut feed_forward = match contender {
        Contender::Knowing => begin(&sim.true_values(&names, 0.0))?,
        _ => begin(&config.controller.theta)?,
    };
    let period_s = sim.sample_period_s;
    let (joints, signals) = (sim.joints(), sim.signals());
    let mut tracking = Tracking::default();
    let mut knows = false;
    for seq in 0..sim.sample_count() {
        let t_s = seq as f64 * period_s;
        if contender == Contender::Knowing && t_s >= change_s && !knows {
            feed_forward = begin(&sim.true_values(&names, t_s))?;
            knows = true;
        }
        let motion = trajectory.advance();
        let input = feed_forward.next(&motion, period_s);
        if contender != Contender::Without {
            machine.command(&input);
        }
        let Some(joint_sample) = machine.next() else {
            return Err(Failure::Failed(format!("the loop is unstable at {t_s} s")));
        };
        let t_ns = (t_s * 1e9).round() as u64;
        if contender == Contender::Adaptive {
            let sample = Sample::new(1, seq, t_ns, joints, signals, &joint_sample);
            node.on_sample(&sample, &mut |estimate| {
                feed_forward.on_estimate(estimate);
            });
        }
        let part = match t_s {
            t if (SETTLED_S..change_s).contains(&t) => 0,
            t if t >= change_s + FOUND_S => 1,
            _ => continue,
        };
        tracking.counts[part] += 1.0;
        for joint in 0..joints {
            let error = joint_sample.setpoint[joint] - joint_sample.q[joint];
            let sum = [&mut tracking.before, &mut tracking.after];
            sum.into_iter()
                .nth(part)
                .into_iter()
                .for_each(|sum| sum[joint] += error * error);
            tracking.largest_input = tracking.largest_input.max(joint_sample.input[joint].abs());
        }
    }
    let [before, after] = tracking.counts;
    tracking.before = tracking.before.map(|sum| (sum / before).sqrt());
    tracking.after = tracking.after.map(|sum| (sum / after).sqrt());
    Ok(tracking)
}

fn document(config: &Config, results: &[Vec<Tracking>], change_s: f64) -> Document {
    let joints = config.plant.sim.joints();
    let mut columns = vec!["controller".to_owned()];
    for part in ["before", "after"] {
        columns.extend((1..=joints).map(|joint| format!("{part}, joint {joint}")));
    }
    columns.extend(["before / knowing", "after / fixed", "largest input"].map(str::to_owned));
    let names: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = Table::new(&names);
    let norm = |run: &Tracking, part: usize| {
        let all = if part == 0 { &run.before } else { &run.after };
        all[..joints].iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    let unit = &config.model.definition().position_unit;
    for (index, (_, name)) in Contender::ALL.iter().enumerate() {
        let runs = &results[index];
        let mean = |value: &dyn Fn(&Tracking) -> f64| {
            (runs.iter().map(|run| value(run).powi(2)).sum::<f64>() / runs.len() as f64).sqrt()
        };
        let mut row = vec![(*name).to_owned()];
        for part in [0, 1] {
            for joint in 0..joints {
                let value = mean(&|run| if part == 0 { run.before[joint] } else { run.after[joint] });
                row.push(format!("{} m{unit}", two_digits(1e3 * value)));
            }
        }
        let worst = |other: usize, part: usize| {
            let pairs = runs.iter().zip(&results[other]);
            pairs
                .map(|(own, other)| norm(own, part) / norm(other, part))
                .fold(0.0, f64::max)
        };
        row.push(format!("{:.1} %", 100.0 * worst(3, 0)));
        row.push(format!("{:.1} %", 100.0 * worst(1, 1)));
        row.push(format!(
            "{:.0}",
            runs.iter().map(|run| run.largest_input).fold(0.0, f64::max)
        ));
        table.push(row);
    }
    Document {
        title: "The controller that adapts".to_owned(),
        sections: vec![Section {
            heading: "Tracking error".to_owned(),
            text: vec![format!(
                "Root mean square of setpoint minus measured position, from {SETTLED_S} s to the change at {change_s} s, and from {FOUND_S} s after it to the end; \
                     root mean square over {} seeds. The ratios are of the joints together, the worst seed. The machine's own loop is the same in all rows; fixed \
                     feed-forward is made from the values before the change, adaptive from estimates that may be used, and the last row is told the truth.",
                results[0].len()
            )],
            table,
        }],
    }
}

/// The command that makes the document again.
fn command(args: &TrackArgs) -> String {
    let mut words = vec!["cargo run --release --features studies --bin studies -- track".to_owned()];
    words.push(args.file.display().to_string());
    words.push(format!("--seeds {}", args.seeds));
    words.extend(args.common.set.iter().map(|set| format!("--set {set}")));
    words.extend(args.out.iter().map(|file| format!("--out {}", file.display())));
    words.join(" ")
}
