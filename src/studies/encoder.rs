//! Identification from positions and voltages alone: the tables of docs/encoder-results.md.
//!
//! Every run has its own seed for setpoints and noise. Errors are relative to the truth at the end
//! of a block.

use super::common::Effort;
use super::document::{Document, Section, Table, percent, two_digits};
pub use super::encoder_runs::{Answer, Judged, Skew, identify, judge, run_projected, run_smoothed, skew_run};
use super::encoder_runs::{blocks, error, number, pair, within};
use super::encoder_setup::{EncoderSetup, Signals};
use super::metrics::median;
use super::paper::ALL;
use super::speed::projected_speed_section;
use super::{CompareError, for_each_index};
use crate::rows::{SmoothedOptions, Smoothing};
use crate::sim::{ControllerKind, MassSchedule};

/// Noise levels of the figures: bits, volts.
const LEVELS: [(u32, f64); 2] = [(16, 0.05), (20, 0.0)];
const CONTROLLERS: [(ControllerKind, &str); 2] =
    [(ControllerKind::Sampled, "sampled"), (ControllerKind::Analog, "analog")];

fn level(bits: u32, noise_v: f64) -> String {
    if noise_v > 0.0 {
        format!("{bits} bit, {noise_v} V")
    } else {
        format!("{bits} bit")
    }
}

/// All tables.
///
/// # Errors
/// If the options are invalid.
pub fn encoder_document(setup: &EncoderSetup, effort: Effort) -> Result<Document, CompareError> {
    let [end, course] = accuracy_sections(setup, effort.seeds)?;
    Ok(Document {
        title: "Results from positions and voltages".to_owned(),
        purpose: "This page shows the accuracy from encoder positions and voltages alone.".to_owned(),
        sections: vec![
            end,
            course,
            calibration_section(setup, effort.calibration_runs)?,
            false_alarms_section(setup, effort.seeds)?,
            skew_section(setup, effort.seeds)?,
            alternatives_section(setup, effort.seeds)?,
            projected_speed_section(setup, effort.seeds.min(2))?,
        ],
    })
}

fn accuracy_sections(setup: &EncoderSetup, seeds: u64) -> Result<[Section; 2], CompareError> {
    let mut columns = vec!["sensors", "controller", "reference"];
    columns.extend(["θ1", "θ2", "θ3", "θ4", "θ5", "θ6", "θ7", "θ8", "θ9"]);
    let mut end = Table::new(&columns);
    let mut course = Table::new(&[
        "sensors",
        "controller",
        "reference",
        "θ6,7,9 to 1 %",
        "all nine",
        "all nine, from the start",
        "usable, worst",
        "time off by",
        "within 50 ms",
        "other alarms",
        "95 % intervals hold",
    ]);
    let jump_s = 45.0;
    for (bits, noise_v) in LEVELS {
        for (kind, name) in CONTROLLERS {
            for signals in Signals::ALL {
                let mut setup = setup.with(bits, noise_v, kind);
                setup.sim.mass_2 = MassSchedule::jump(150.0, jump_s, 170.0);
                let runs = for_each_index(seeds as usize, |seed| {
                    let answers = run_projected(&setup, Some(signals), seed as u64)?;
                    Ok(judge(&setup, &answers, jump_s))
                });
                let runs = runs.into_iter().collect::<Result<Vec<_>, CompareError>>()?;
                let head = [level(bits, noise_v), name.to_owned(), signals.name().to_owned()];
                let mut row = head.to_vec();
                row.extend(ALL.map(|p| pair(runs.iter().map(|r| 100.0 * r.end[p]), &two_digits)));
                end.push(row);
                let off: Vec<f64> = runs.iter().map(|r| r.off_s.unwrap_or(f64::INFINITY)).collect();
                let (held, all) = runs.iter().fold((0, 0), |sum, r| (sum.0 + r.held.0, sum.1 + r.held.1));
                let mut row = head.to_vec();
                row.extend([
                    pair(runs.iter().map(|r| number(r.payload_to_1)), &blocks),
                    pair(runs.iter().map(|r| number(r.all_to_1)), &blocks),
                    pair(runs.iter().map(|r| number(r.start_to_1)), &blocks),
                    percent(runs.iter().map(|r| r.usable_error).fold(0.0, f64::max)),
                    pair(off.iter().copied(), &|s| format!("{:.0} ms", 1e3 * s)),
                    format!("{} of {}", off.iter().filter(|s| **s <= 0.05).count(), off.len()),
                    runs.iter().map(|r| r.other_alarms).sum::<usize>().to_string(),
                    format!("{:.1} %", 100.0 * held as f64 / all as f64),
                ]);
                course.push(row);
            }
        }
    }
    let about = format!(
        "{seeds} seeds each, every one with its own reference and noise: 170 s, N = {}, start values off by a factor of 2.5 up or down in turn, 150 kg, and \
         170 kg from 45 s on. Only the encoders' positions and the measured voltages are used.",
        setup.block_len
    );
    Ok([
        Section {
            heading: "Errors at the end".to_owned(),
            text: vec![
                about,
                "Errors after the last block in per cent, median / worst of all runs. θ1 and θ3 belong to link 1, a twentieth of the inertia that moves with joint 1. \
                 Through 16 bits, sines determine them only to some per cent, and their standard deviations show it. Sines of equal speed hardly contain information on an \
                 inductance; the errors of θ6, θ9 and θ4 are then as large as their standard deviations (θ6: 0.06 %), and no larger."
                    .to_owned(),
            ],
            table: end,
        },
        Section {
            heading: "On the way".to_owned(),
            text: vec![
                "Columns, from left to right; pairs are median / worst:\n\n- blocks from the one of the jump (0) until θ6, θ7 and θ9 stay within 1 %, and until all nine do; – if they do \
                 not;\n- blocks from the start until all nine do, up to the jump;\n- worst error of a θ2 or θ4 to θ9 that is marked usable, in any block;\n- error of the announced time \
                 of the change, and in how many runs it is within 50 ms;\n- changes announced in any other block than that of the jump and the next;\n- share of 95 % intervals that contain the truth, all parameters, from block \
                 6 on, without the two blocks of the jump."
                    .to_owned(),
            ],
            table: course,
        },
    ])
}

/// Share of runs whose 95 % interval contains the truth after ten blocks, per parameter, and the
/// alarms and blocks of these runs.
///
/// # Errors
/// If the options are invalid.
pub fn calibration(
    setup: &EncoderSetup,
    signals: Signals,
    runs: u64,
) -> Result<([f64; 9], usize, usize), CompareError> {
    const BLOCKS: usize = 10;
    let setup = setup.lasting(BLOCKS);
    let runs = for_each_index(runs as usize, |run| {
        run_projected(&setup, Some(signals), 1000 + run as u64)
    });
    let runs = runs.into_iter().collect::<Result<Vec<_>, CompareError>>()?;
    let alarms = runs.iter().flatten().filter(|a| a.change.is_some()).count();
    let share = |p: usize| {
        let held = runs.iter().filter(|run| run.last().is_some_and(|a| within(a, p)));
        held.count() as f64 / runs.len() as f64
    };
    Ok((ALL.map(share), alarms, runs.len() * BLOCKS))
}

fn calibration_section(setup: &EncoderSetup, runs: u64) -> Result<Section, CompareError> {
    let mut columns = vec!["sensors", "controller", "noise levels"];
    columns.extend(["θ1", "θ2", "θ3", "θ4", "θ5", "θ6", "θ7", "θ8", "θ9", "alarms"]);
    let mut table = Table::new(&columns);
    for (bits, noise_v) in LEVELS {
        for (kind, name) in CONTROLLERS {
            let known = setup.with(bits, noise_v, kind);
            for (setup, how) in [(known.clone(), "known"), (known.learning(), "learnt")] {
                let (shares, alarms, blocks) = calibration(&setup, Signals::Steps, runs)?;
                let mut row = vec![level(bits, noise_v), name.to_owned(), how.to_owned()];
                row.extend(shares.map(|share| format!("{:.1} %", 100.0 * share)));
                row.push(format!("{alarms} of {blocks}"));
                table.push(row);
            }
        }
    }
    Ok(Section {
        heading: "Calibration".to_owned(),
        text: vec![format!(
            "Share of {runs} runs of steps, 10 blocks each, whose last 95 % interval (θ̂ ± 1.96 standard deviations) contains the truth, with the sensors' noise \
             as configured and as learnt from the signals. One standard deviation of the counting itself is {:.1} points.",
            100.0 * (0.95 * 0.05 / runs as f64).sqrt()
        )],
        table,
    })
}

fn false_alarms_section(setup: &EncoderSetup, seeds: u64) -> Result<Section, CompareError> {
    let mut table = Table::new(&["sensors", "noise levels", "reference", "blocks", "alarms", "per 1000"]);
    for (bits, noise_v) in LEVELS {
        for learning in [false, true] {
            for signals in Signals::MAIN {
                let (mut all, mut alarms) = (0, 0);
                for (kind, _) in CONTROLLERS {
                    let known = setup.with(bits, noise_v, kind);
                    let setup = if learning { known.learning() } else { known }.lasting(89);
                    let runs = for_each_index(seeds.div_ceil(2) as usize, |seed| {
                        run_projected(&setup, Some(signals), 3000 + seed as u64)
                    });
                    for run in runs {
                        let run = run?;
                        all += run.len();
                        alarms += run.iter().filter(|a| a.change.is_some()).count();
                    }
                }
                table.push(vec![
                    level(bits, noise_v),
                    if learning { "learnt" } else { "known" }.to_owned(),
                    signals.name().to_owned(),
                    all.to_string(),
                    alarms.to_string(),
                    two_digits(1000.0 * alarms as f64 / all as f64),
                ]);
            }
        }
    }
    Ok(Section {
        heading: "False alarms".to_owned(),
        text: vec![
            "The payload does not change. Half of the runs have a sampled and half an analog controller; no other study uses \
             these seeds.".to_owned(),
        ],
        table,
    })
}

fn skew_section(setup: &EncoderSetup, seeds: u64) -> Result<Section, CompareError> {
    let mut columns = vec!["reference", "delay", "is"];
    columns.extend(["θ1", "θ2", "θ3", "θ4", "θ5", "θ6", "θ7", "θ8", "θ9", "delay off by"]);
    let mut table = Table::new(&columns);
    let setup = setup.with(16, 0.05, ControllerKind::Sampled).lasting(10);
    for signals in Signals::MAIN {
        for (delay_s, skew, how) in [
            (0.5e-3, Skew::Ignored, "ignored"),
            (0.05e-3, Skew::Ignored, "ignored"),
            (0.5e-3, Skew::Configured, "configured"),
            (0.5e-3, Skew::Estimated, "estimated"),
        ] {
            let runs = for_each_index(seeds as usize, |seed| {
                skew_run(&setup, signals, seed as u64, delay_s, skew)
            });
            let runs = runs.into_iter().collect::<Result<Vec<_>, CompareError>>()?;
            let last: Vec<&Answer> = runs.iter().filter_map(|run| run.last()).collect();
            let mut row = vec![
                signals.name().to_owned(),
                format!("{} ms", 1e3 * delay_s),
                how.to_owned(),
            ];
            row.extend(ALL.map(|p| {
                let mut errors: Vec<f64> = last.iter().map(|a| 100.0 * (a.theta[p] / a.truth[p] - 1.0)).collect();
                let middle = median(&mut errors);
                format!("{}{}", if middle > 0.0 { "+" } else { "" }, two_digits(middle))
            }));
            row.push(if skew == Skew::Estimated {
                let off = last.iter().map(|a| 1e6 * (a.theta[9] - a.truth[9]).abs());
                pair(off, &|v| format!("{} µs", two_digits(v)))
            } else {
                "–".to_owned()
            });
            table.push(row);
        }
    }
    Ok(Section {
        heading: "An input that acts late".to_owned(),
        text: vec![format!(
            "16 bit, 0.05 V, sampled controller, {seeds} seeds each: signed error after 10 blocks in per cent, median of the runs. If it is estimated, the delay is \
             one more parameter (`estimate_input_delay`) with a prior standard deviation of 1 ms; its error is median / worst."
        )],
        table,
    })
}

/// Obvious alternatives to projected rows.
fn alternatives() -> [(&'static str, SmoothedOptions); 3] {
    let raw = SmoothedOptions {
        window_s: 0.0,
        stride_s: 1e-3,
        ..SmoothedOptions::recommended()
    };
    [
        (
            "causal derivatives, a row per sample",
            SmoothedOptions {
                smoothing: Smoothing::Causal,
                ..raw
            },
        ),
        ("zero-phase derivatives, a row per sample", raw),
        (
            "zero-phase derivatives, both sides averaged",
            SmoothedOptions::recommended(),
        ),
    ]
}

fn alternatives_section(setup: &EncoderSetup, seeds: u64) -> Result<Section, CompareError> {
    let mut columns = vec!["rows", "reference"];
    columns.extend(["θ1", "θ2", "θ3", "θ4", "θ5", "θ6", "θ7", "θ8", "θ9"]);
    let mut table = Table::new(&columns);
    let setup = setup.with(16, 0.05, ControllerKind::Sampled).lasting(10);
    let seeds = seeds.min(5) as usize;
    for signals in [Signals::Steps, Signals::Sines] {
        let mut push = |name: &str, runs: Vec<Result<Vec<Answer>, CompareError>>| -> Result<(), CompareError> {
            let runs = runs.into_iter().collect::<Result<Vec<_>, CompareError>>()?;
            let mut row = vec![name.to_owned(), signals.name().to_owned()];
            row.extend(ALL.map(|p| {
                let errors = runs.iter().filter_map(|run| run.last()).map(|a| 100.0 * error(a, &[p]));
                pair(errors, &two_digits)
            }));
            table.push(row);
            Ok(())
        };
        for (name, smoothed) in alternatives() {
            push(
                name,
                for_each_index(seeds, |seed| run_smoothed(&setup, smoothed, signals, seed as u64)),
            )?;
        }
        push(
            "projected",
            for_each_index(seeds, |seed| run_projected(&setup, Some(signals), seed as u64)),
        )?;
    }
    Ok(Section {
        heading: "Why projected rows".to_owned(),
        text: vec![format!(
            "16 bit, 0.05 V, sampled controller, {seeds} seeds each: errors after 10 blocks in per cent, median / worst. The same estimator takes rows made in the ways \
             that one would try first. Derivatives come from polynomials of order 5 over 21 samples, past ones alone or on both sides. There is one row per sample, or both \
             sides of the equation are averaged over windows of 100 ms, which is the fallback for residuals that cannot be integrated by parts."
        )],
        table,
    })
}
