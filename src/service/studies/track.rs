//! Measures how well a machine follows its trajectory with feed-forward from estimates.

use super::{TrackArgs, output};
use crate::config::{Config, Source};
use crate::control::{AdaptiveFeedForward, AdaptiveOptions, Trajectory};
use crate::messages::{Sample, nanoseconds};
use crate::model::{JointSample, MAX_JOINTS};
use crate::node::model::SampleSource;
use crate::report::{TrackingPanel, tracking_figure};
use crate::runner::Shutdown;
use crate::service::ticker::Ticker;
use crate::service::wiring::identifier_node;
use crate::service::{Exit, Failure};
use crate::sim::{Machine, MachineSimulator, SimOptions};
use crate::studies::{Document, Section, Table, for_each_index, two_digits};
use std::path::Path;

/// Time after which a loop that began at rest is judged \[s\].
const SETTLED_S: f64 = 20.0;
/// Time after a change within which the identifier may find it \[s\].
const FOUND_S: f64 = 3.0;
/// Length of the intervals of the figure's errors \[s\].
const PART_S: f64 = 0.5;

/// Source of the feed-forward's parameters.
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
        (Self::Knowing, "feed-forward, exact"),
    ];
}

/// Tracking errors \[rad or m\].
#[derive(Debug, Clone, Default)]
struct Tracking {
    /// Root mean squares of each joint before the change and after it.
    phases: [[f64; MAX_JOINTS]; 2],
    counts: [f64; 2],
    /// Sum of squares over all joints, and number of samples, of each interval of the run.
    parts: Vec<(f64, f64)>,
    largest_input: f64,
}

impl Tracking {
    fn take(&mut self, t_s: f64, change_s: f64, joints: usize, sample: &JointSample) {
        let part = (t_s / PART_S) as usize;
        if self.parts.len() <= part {
            self.parts.resize(part + 1, (0.0, 0.0));
        }
        self.parts[part].1 += 1.0;
        let phase = match t_s {
            t if (SETTLED_S..change_s).contains(&t) => Some(0),
            t if t >= change_s + FOUND_S => Some(1),
            _ => None,
        };
        for joint in 0..joints {
            let square = (sample.setpoint[joint] - sample.q[joint]).powi(2);
            self.parts[part].0 += square;
            if let Some(phase) = phase {
                self.phases[phase][joint] += square;
                self.largest_input = self.largest_input.max(sample.input[joint].abs());
            }
        }
        phase.into_iter().for_each(|phase| self.counts[phase] += 1.0);
    }

    /// Converts sums to root mean squares.
    fn closed(mut self) -> Self {
        for (phase, count) in self.phases.iter_mut().zip(self.counts) {
            *phase = phase.map(|sum| (sum / count).sqrt());
        }
        self
    }

    /// Root mean square over all joints.
    fn together(&self, phase: usize) -> f64 {
        self.phases[phase].iter().map(|x| x * x).sum::<f64>().sqrt()
    }
}

/// One machine with all contenders, for each seed.
struct Compared {
    config: Config,
    name: String,
    change_s: f64,
    runs: Vec<Vec<Tracking>>,
}

/// Runs the loop with each contender and writes tables and figure.
///
/// # Errors
/// If the configuration has no controller, change or smooth setpoints, or a file cannot be written.
pub fn run(args: &TrackArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let all: Vec<Compared> = args
        .files
        .iter()
        .map(|file| compare(file, args, shutdown))
        .collect::<Result<_, _>>()?;
    let text = Document {
        title: "The controller that adapts".to_owned(),
        purpose:
            "This page compares the tracking error of adaptive feed-forward with fixed and with exact feed-forward."
                .to_owned(),
        sections: all.iter().map(section).collect(),
    };
    let mut text = text.markdown(&command(args));
    if let Some(file) = &args.figure {
        let panels: Vec<TrackingPanel> = all.iter().map(panel).collect();
        output::write(Some(file), &tracking_figure(&panels).svg())?;
        let beside = args.out.as_ref().and_then(|out| file.strip_prefix(out.parent()?).ok());
        text += &format!(
            "\n![tracking error over time]({})\n\nRoot mean square over parts of {PART_S} s, all joints together, seed 0.\n",
            beside.unwrap_or(file).display()
        );
    }
    output::write(args.out.as_deref(), &text)?;
    Ok(Exit::Done)
}

/// All contenders on one machine.
fn compare(file: &Path, args: &TrackArgs, shutdown: &Shutdown) -> Result<Compared, Failure> {
    let load = |seed: u64| {
        let own = [("plant.seed", Some(seed.to_string()))];
        args.common.load(vec![Source::File(file.to_owned())], &own)
    };
    let config = load(0)?;
    let change_s = change_s(&config.plant.sim)?;
    let ticker = Ticker::start(&format!("controllers on {}", file.display()));
    let mut all: Vec<Vec<Tracking>> = Vec::new();
    for (contender, _) in Contender::ALL {
        ticker.at(all.len() as f64 / Contender::ALL.len() as f64);
        let runs = for_each_index(args.seeds as usize, |seed| {
            if shutdown.requested() {
                return Err(Failure::Failed("interrupted, nothing was written".to_owned()));
            }
            follow(&load(seed as u64)?, contender, change_s)
        });
        all.push(runs.into_iter().collect::<Result<_, Failure>>()?);
    }
    let name = file.display().to_string();
    Ok(Compared {
        config,
        name,
        change_s,
        runs: all,
    })
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
    let mut trajectory = Trajectory::of(&*config.model, sim).map_err(Failure::usage)?;
    let options = match contender {
        // true values are used exactly
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
        // the best possible without estimates
        Contender::Knowing | Contender::Fixed => begin(&sim.true_values(&names, 0.0))?,
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
        let t_ns = nanoseconds(t_s);
        if contender == Contender::Adaptive {
            let sample = Sample::new(1, seq, t_ns, joints, signals, &joint_sample);
            node.on_sample(&sample, &mut |estimate| {
                feed_forward.on_estimate(estimate);
            });
        }
        tracking.take(t_s, change_s, joints, &joint_sample);
    }
    Ok(tracking.closed())
}

/// The figure's panel of a machine, for the judged time.
fn panel(of: &Compared) -> TrackingPanel {
    let line = |runs: &Vec<Tracking>| {
        let parts = runs.first().map_or(&[][..], |run| &run.parts);
        let middle = |part: usize| (part as f64 + 0.5) * PART_S;
        parts
            .iter()
            .enumerate()
            .filter(|(part, _)| middle(*part) > SETTLED_S)
            .map(|(part, (sum, count))| (middle(part), (sum / count).sqrt()))
            .collect()
    };
    TrackingPanel {
        name: of.config.model.name().to_owned(),
        unit: of.config.model.definition().position_unit.clone(),
        change: (of.change_s, format!("{} s", of.change_s)),
        lines: Contender::ALL
            .iter()
            .zip(&of.runs)
            .map(|((_, name), runs)| ((*name).to_owned(), line(runs)))
            .collect(),
    }
}

fn section(of: &Compared) -> Section {
    let joints = of.config.plant.sim.joints();
    let mut columns = vec!["controller".to_owned()];
    for part in ["before", "after"] {
        columns.extend((1..=joints).map(|joint| format!("{part}, joint {joint}")));
    }
    let last = [
        "before / exact",
        "worst seed",
        "after / fixed",
        "worst seed",
        "largest input",
    ];
    columns.extend(last.map(str::to_owned));
    let names: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = Table::new(&names);
    let unit = &of.config.model.definition().position_unit;
    for (index, (_, name)) in Contender::ALL.iter().enumerate() {
        let runs = &of.runs[index];
        let mean = |value: &dyn Fn(&Tracking) -> f64| {
            (runs.iter().map(|run| value(run).powi(2)).sum::<f64>() / runs.len() as f64).sqrt()
        };
        let mut row = vec![(*name).to_owned()];
        for phase in [0, 1] {
            for joint in 0..joints {
                let value = mean(&|run| run.phases[phase][joint]);
                row.push(format!("{} m{unit}", two_digits(1e3 * value)));
            }
        }
        for (other, phase) in [(3, 0), (1, 1)] {
            let others = &of.runs[other];
            let square = |runs: &[Tracking]| runs.iter().map(|run| run.together(phase).powi(2)).sum::<f64>();
            let worst = runs
                .iter()
                .zip(others)
                .map(|(own, other)| own.together(phase) / other.together(phase))
                .fold(0.0, f64::max);
            row.push(format!("{:.1} %", 100.0 * (square(runs) / square(others)).sqrt()));
            row.push(format!("{:.1} %", 100.0 * worst));
        }
        row.push(format!(
            "{:.0}",
            runs.iter().map(|run| run.largest_input).fold(0.0, f64::max)
        ));
        table.push(row);
    }
    let (change_s, seeds) = (of.change_s, of.runs[0].len());
    Section {
        heading: of.name.clone(),
        text: vec![format!(
            "Root mean square of setpoint minus measured position, from {SETTLED_S} s to the change at {change_s} s, and from {FOUND_S} s after it to the end; \
             root mean square over {seeds} seeds. The ratios are for all joints together, over all seeds and for the worst seed.\n\nThe machine's own loop is the same in all rows. \
             Fixed feed-forward uses the true values before the change. Adaptive feed-forward starts with `controller.theta` and continues with estimates that pass `use_ok` and `controller.max_std`. The \
             last row uses the true parameters."
        )],
        table,
    }
}

/// The command that generates the document.
fn command(args: &TrackArgs) -> String {
    let mut words = vec![output::command("track")];
    words.extend(args.files.iter().map(|file| file.display().to_string()));
    words.push(format!("--seeds {}", args.seeds));
    words.extend(args.common.set.iter().map(|set| format!("--set {set}")));
    words.extend(args.out.iter().map(|file| format!("--out {}", file.display())));
    words.extend(args.figure.iter().map(|file| format!("--figure {}", file.display())));
    words.join(" ")
}
