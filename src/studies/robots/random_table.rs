//! The table of docs/random-robots.md.

use super::random_case::RandomRobotCase;
use super::random_machine::LENGTH_S;
use crate::messages::State;
use crate::studies::trials::{Danger, TrialResult};
use crate::studies::{Document, Section, Table};

const COLUMNS: [&str; 10] = [
    "what is tried",
    "",
    "dangerous of usable blocks",
    "robots with such blocks",
    "usable blocks",
    "usable values",
    "95 % intervals hold",
    "misfit",
    "false alarms per 1000",
    "worst value",
];

/// The results of each case of [`RandomRobotCase::ALL`], one per seed, as a page.
pub fn random_robots_document(results: &[Vec<TrialResult>]) -> Document {
    let seeds = results.first().map_or(0, Vec::len);
    let mut table = Table::new(&COLUMNS);
    for ((_, name, what), runs) in RandomRobotCase::ALL.iter().zip(results) {
        table.push(row(name, what, runs));
    }
    let all: Vec<TrialResult> = results.iter().flatten().cloned().collect();
    table.push(row("**all**", "", &all));
    let found: Vec<&TrialResult> = results.iter().flatten().filter(|run| run.changes > 0).collect();
    let told = found.iter().filter(|run| run.detected > 0).count();
    Document {
        title: "Robots drawn at random".to_owned(),
        purpose: "This page counts how often a usable estimate of a robot is wrong, on machines that nobody chose.".to_owned(),
        sections: vec![Section {
            heading: "Results".to_owned(),
            text: vec![
                format!(
                    "A seed draws a robot of 1 to 7 joints, a seventh of them prismatic, with axes and frames square to each other or of any direction, and bodies of 0.3 to 60 kg that are up \
                     to 40 % off the URDF. It draws friction (0.2 to 3 × 4 % of the largest torque), rotors, Fourier series or moves with rests of 0 to 3 s within the limits of the URDF, \
                     computed torque or a servo for each joint, 100 Hz to 1 kHz, encoders of 14 to 20 bits, and torque noise of 0.1 to 2 % of the largest torque. Each row has \
                     {seeds} robots of its own, which run for {LENGTH_S:.0} s through the identifier node of the service with its default options."
                ),
                "Half the models of the other rows have the terms of the first row, half those of the second. A **dangerous block** has `use_ok = 1` and a usable parameter, or a mass of the \
                 payload, that is more than 5 σ and more than 0.5 % off. Usable values are counted of all parameters in all blocks, and their 95 % intervals from block 6 on, outside the block of \
                 a change. While no payload has been found, its mass is 0 without a σ and does not count. An alarm is false if \
                 nothing changed in its block or in the one before; a sensor that changes or drifts does not count as a change. Without a payload every announced \
                 change is thus false."
                    .to_owned(),
                format!(
                    "The payload was found in {told} of {} robots. The motion of some robots does not show it, above all that of one or two joints which move no weight.",
                    found.len()
                ),
            ],
            table,
        }],
    }
}

fn row(name: &str, what: &str, runs: &[TrialResult]) -> Vec<String> {
    let sum = |of: &dyn Fn(&TrialResult) -> u64| -> u64 { runs.iter().map(of).sum() };
    let misfit = |run: &TrialResult| {
        let of_state = run.states.iter().find(|(name, _)| *name == State::Misfit.name());
        of_state.map_or(0, |(_, count)| *count)
    };
    let blocks = sum(&|run| run.blocks);
    let usable = sum(&|run| run.usable_intervals);
    let values = sum(&|run| run.blocks * run.parameters.len() as u64);
    let worst = runs.iter().filter_map(|run| run.worst.as_ref());
    let worst = worst.max_by(|a, b| a.sigmas.total_cmp(&b.sigmas));
    let told = |danger: &Danger| format!("{}, {:.1} σ", danger.name, danger.sigmas);
    vec![
        name.to_owned(),
        what.to_owned(),
        format!("{} of {}", sum(&|run| run.dangerous), sum(&|run| run.use_ok)),
        runs.iter().filter(|run| run.dangerous > 0).count().to_string(),
        share(sum(&|run| run.use_ok), blocks),
        share(usable, values),
        share(sum(&|run| run.usable_covered), usable),
        share(sum(&misfit), blocks),
        format!(
            "{:.1}",
            1000.0 * sum(&|run| run.false_alarms) as f64 / sum(&|run| run.quiet).max(1) as f64
        ),
        worst.map_or("–".to_owned(), told),
    ]
}

fn share(part: u64, whole: u64) -> String {
    match whole {
        0 => "–".to_owned(),
        _ => format!("{:.1} %", 100.0 * part as f64 / whole as f64),
    }
}
