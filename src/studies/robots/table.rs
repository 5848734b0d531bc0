//! The tables of docs/robot-trials.md.

use super::{
    BLOCK_S, EMPTY_S, EXCITED, EmptyRun, LOAD_KG, LOADED_FROM_S, LoadedRun, Outcome, RobotTrial, UNDECLARED_KG,
};
use crate::robot::ChangeCause;
use crate::studies::{Document, Section, Table};

/// Standard deviations that contain 95 % of a normal distribution.
const WITHIN_95: f64 = 1.96;

/// The trials as tables.
pub fn robots_document(trials: &[RobotTrial]) -> Document {
    Document {
        title: "Trials of robots".to_owned(),
        purpose: "This page shows how accurately a seven-axis robot and its payload are identified, over many seeds."
            .to_owned(),
        sections: vec![
            settings(trials.len()),
            known(trials),
            alarms(trials),
            payload(
                "friction does not depend on it",
                "The configuration has `payload_friction = 0`, `friction_walk = 0`, `zero_rad = 0`, `delay_s = 0`, `friction_shape = 0` and \
                 `spring_share = 0`: friction is as its terms describe it, and neither depends on the load nor drifts; the zeros of the encoders \
                 are known exactly, and the torques are of the same instants.",
                trials.iter().map(|trial| &trial.loaded),
            ),
            payload(
                "friction might depend on it",
                "The same runs with the default `payload_friction = 0.05` (the others as before): gears have more friction under load, so each friction \
                 parameter may change by 5 % of its size at the pick-up. Here it does not, and the mass is less certain at first.",
                trials.iter().map(|trial| &trial.guarded),
            ),
        ],
    }
}

fn settings(seeds: usize) -> Section {
    Section {
        heading: "What is tried".to_owned(),
        text: vec![
            format!(
                "The simulated seven-axis arm of config/robots/seven_axis.urdf, {seeds} seeds. Each seed is another machine, whose bodies differ from the URDF by 15 %, on another motion: \
                 Fourier series of 5 harmonics within the limits of the URDF, computed torque, Dahl friction, 1 kHz. Encoders have 16 bits, torques noise of 0.5 % of the joint's \
                 range, velocities are formed from positions over 20 ms to either side. Windows have 0.1 s, blocks {BLOCK_S} s; the detection of payloads and of changes \
                 of friction is on.",
            ),
            "Every run counts, also if something in it fails.".to_owned(),
        ],
        table: Table::default(),
    }
}

/// Quantile of sorted values; NaN for none.
fn quantile(sorted: &[f64], part: f64) -> f64 {
    let last = sorted.len().saturating_sub(1) as f64;
    sorted.get((part * last).round() as usize).copied().unwrap_or(f64::NAN)
}

/// A value with its unit; "–" if there is none.
fn cell(value: f64, decimals: usize, unit: &str) -> String {
    match value.is_finite() {
        true => format!("{value:.decimals$} {unit}"),
        false => "–".to_owned(),
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

fn share(count: usize, of: usize) -> String {
    match of {
        0 => "–".to_owned(),
        _ => format!("{:.1} %", 100.0 * count as f64 / of as f64),
    }
}

fn known(trials: &[RobotTrial]) -> Section {
    let outcomes = || trials.iter().flat_map(|trial| &trial.empty.parameters);
    let mut table = Table::new(&[
        "parameters",
        "number",
        "median error",
        "95 % of errors below",
        "largest error",
        "within 0.5 %",
        "95 % intervals hold",
        "least of a seed",
        "most",
    ]);
    let is_excited = |o: &Outcome| o.relative_std < EXCITED;
    let rows: [(&str, &dyn Fn(&Outcome) -> bool); 4] = [
        ("base, excited", &|o| o.is_base && is_excited(o)),
        ("friction, excited", &|o| !o.is_base && is_excited(o)),
        ("base, all", &|o| o.is_base),
        ("all", &|_| true),
    ];
    for (name, wanted) in rows {
        let errors = sorted(outcomes().filter(|o| wanted(o)).map(|o| o.relative));
        let holds = |o: &&Outcome| o.sigmas.abs() < WITHIN_95;
        let inside = outcomes().filter(|o| wanted(o)).filter(holds).count();
        let of_seeds = sorted(trials.iter().map(|trial| {
            let own: Vec<&Outcome> = trial.empty.parameters.iter().filter(|o| wanted(o)).collect();
            own.iter().copied().filter(holds).count() as f64 / own.len().max(1) as f64
        }));
        let error = |part: f64| match name.ends_with("excited") {
            true => cell(100.0 * quantile(&errors, part), 3, "%"),
            // The relative error of a value near 0 is meaningless.
            false => "–".to_owned(),
        };
        table.push(vec![
            name.to_owned(),
            errors.len().to_string(),
            error(0.5),
            error(0.95),
            error(1.0),
            match name.ends_with("excited") {
                true => share(errors.iter().filter(|e| **e <= 0.005).count(), errors.len()),
                false => "–".to_owned(),
            },
            share(inside, errors.len()),
            cell(100.0 * quantile(&of_seeds, 0.0), 0, "%"),
            cell(100.0 * quantile(&of_seeds, 1.0), 0, "%"),
        ]);
    }
    Section {
        heading: format!("What is known after {EMPTY_S:.0} s without a load"),
        text: vec![format!(
            "A parameter is excited if its own standard deviation is below {} % of it. The error is the difference from the truth. The goals are an error of at most 0.5 % for excited parameters, \
             and 95 % intervals that contain the truth in 90 to 98 % of cases.",
            100.0 * EXCITED
        )],
        table,
    }
}

fn alarms(trials: &[RobotTrial]) -> Section {
    let mut table = Table::new(&["run", "blocks", "payload", "friction", "unexplained", "per 1000 blocks"]);
    let mut row = |name: String, runs: &mut dyn Iterator<Item = &EmptyRun>| {
        let (mut blocks, mut counts) = (0, [0; 3]);
        for run in runs {
            blocks += run.blocks;
            for alarm in &run.alarms {
                counts[match alarm.cause {
                    ChangeCause::Payload => 0,
                    ChangeCause::Friction => 1,
                    ChangeCause::Unexplained => 2,
                }] += 1;
            }
        }
        let all: usize = counts.iter().sum();
        let mut cells = vec![name, blocks.to_string()];
        cells.extend(counts.map(|count| count.to_string()));
        cells.push(format!("{:.2}", 1000.0 * all as f64 / blocks.max(1) as f64));
        table.push(cells);
    };
    row("no load".to_owned(), &mut trials.iter().map(|trial| &trial.empty));
    row(
        format!("{UNDECLARED_KG:.0} kg from the start, not declared"),
        &mut trials.iter().map(|trial| &trial.undeclared),
    );
    Section {
        heading: "False alarms".to_owned(),
        text: vec![
            "The table counts changes that were found although nothing changed. The goal is at most one in 1000 blocks. A load that is carried from the start is learnt \
             as a part of the arm."
                .to_owned(),
        ],
        table,
    }
}

fn payload<'a>(friction: &str, told: &str, runs: impl Iterator<Item = &'a LoadedRun>) -> Section {
    let runs: Vec<&LoadedRun> = runs.collect();
    let mut table = Table::new(&["figure", "median", "95 % below", "largest", "goal", "reached"]);
    let located = sorted(runs.iter().filter_map(|run| run.located_s()).map(f64::abs));
    let delays = sorted(runs.iter().filter_map(|run| run.delay_s()));
    let mut row = |name: &str, values: &[f64], unit: &str, scale: f64, goal: Option<(f64, &str)>| {
        let part = |part: f64| cell(scale * quantile(values, part), 2, unit);
        let reached = goal.map_or("–".to_owned(), |(limit, _)| {
            share(values.iter().filter(|value| **value <= limit).count(), runs.len())
        });
        table.push(vec![
            name.to_owned(),
            part(0.5),
            part(0.95),
            part(1.0),
            goal.map_or("–", |(_, words)| words).to_owned(),
            reached,
        ]);
    };
    row("located, off by", &located, "ms", 1e3, Some((0.05, "50 ms")));
    row("found after", &delays, "s", 1.0, None);
    for (k, (name, goal)) in [
        ("mass after 2 s, off by", Some((0.01, "1 %"))),
        ("mass after 5 s, off by", None),
    ]
    .into_iter()
    .enumerate()
    {
        let errors = sorted(
            runs.iter()
                .filter_map(|run| Some((run.mass[k]?[0] / LOAD_KG - 1.0).abs())),
        );
        row(name, &errors, "%", 100.0, goal);
    }
    let holds = |k: usize| {
        let inside =
            |run: &&&LoadedRun| run.mass[k].is_some_and(|[mass, std]| (mass - LOAD_KG).abs() < WITHIN_95 * std);
        share(runs.iter().filter(inside).count(), runs.len())
    };
    let found = runs.iter().filter(|run| run.located_s().is_some()).count();
    let (early, late) = runs
        .iter()
        .fold((0, 0), |(early, late), run| (early + run.early, late + run.late));
    Section {
        heading: format!(
            "A load of {LOAD_KG:.0} kg, picked up in motion after {LOADED_FROM_S:.0} to {:.0} s; {friction}",
            LOADED_FROM_S + 1.0
        ),
        text: vec![
            told.to_owned(),
            format!(
                "Found as a payload in {found} of {} runs; {early} changes before it and {late} further ones after it. 95 % intervals of the mass hold in {} after 2 s and in {} after 5 s.",
                runs.len(),
                holds(0),
                holds(1)
            ),
            format!(
                "The pick-up is at a different point of a block for each seed. The mass is the last one published within 2 s and 5 s after it. With an estimate every {BLOCK_S} s, \
                 the first of these was learnt from {} to 2 s of motion with the load.",
                2.0 - BLOCK_S
            ),
        ],
        table,
    }
}
