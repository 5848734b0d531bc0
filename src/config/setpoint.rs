//! Section `[plant.setpoint]` and its subsections: commanded positions, drawn, computed or read
//! from a file.

use super::check::Check;
use super::schema::{FileForm, SetpointKind};
use super::setpoint_csv;
use super::words::cut;
use crate::sim::{ARM_JOINTS, Moves, Setpoint, Tone};
use std::path::Path;

/// The setpoint of each joint; `None` after reporting a problem.
pub(super) fn setpoint(form: &FileForm, check: &mut Check<'_>) -> Option<[Setpoint; ARM_JOINTS]> {
    let each = |setpoint: &dyn Fn(usize) -> Setpoint| Some(std::array::from_fn(setpoint));
    match form.setpoint.kind {
        SetpointKind::Csv => from_csv(form, check),
        SetpointKind::Sines => sines(form, check),
        SetpointKind::Steps => each(&|j| Setpoint::Steps {
            levels_rad: form.steps.levels_rad[j].clone(),
            dwell_s: form.steps.dwell_s[j],
            shift_s: form.steps.shift_s[j],
        }),
        SetpointKind::Square => each(&|j| Setpoint::Square {
            amplitude_rad: form.square.amplitude_rad[j],
            offset_rad: form.square.offset_rad[j],
            period_s: form.square.period_s[j],
            shift_s: form.square.shift_s[j],
        }),
        SetpointKind::RandomSines => each(&|j| Setpoint::RandomSines {
            count: form.random_sines.count as usize,
            min_frequency_hz: form.random_sines.min_frequency_hz[j],
            max_frequency_hz: form.random_sines.max_frequency_hz[j],
            amplitude_rad: form.random_sines.amplitude_rad[j],
        }),
        SetpointKind::Random => each(&|j| Setpoint::Random {
            min_rad: form.random.min_rad[j],
            max_rad: form.random.max_rad[j],
            min_dwell_s: form.random.min_dwell_s[j],
            max_dwell_s: form.random.max_dwell_s[j],
        }),
        SetpointKind::Moves => each(&|j| {
            Setpoint::Moves(Moves {
                profile: form.moves.profile,
                min_rad: form.moves.min_rad[j],
                max_rad: form.moves.max_rad[j],
                min_move_s: form.moves.min_move_s[j],
                max_move_s: form.moves.max_move_s[j],
                min_rest_s: form.moves.min_rest_s[j],
                max_rest_s: form.moves.max_rest_s[j],
            })
        }),
        SetpointKind::Chirp => each(&|j| Setpoint::Chirp {
            amplitude_rad: form.chirp.amplitude_rad[j],
            offset_rad: form.chirp.offset_rad[j],
            start_frequency_hz: form.chirp.start_frequency_hz[j],
            end_frequency_hz: form.chirp.end_frequency_hz[j],
            sweep_s: form.chirp.sweep_s[j],
        }),
    }
}

/// As many amplitudes and phases as frequencies.
fn sines(form: &FileForm, check: &mut Check<'_>) -> Option<[Setpoint; ARM_JOINTS]> {
    let sines = &form.sines;
    for (key, lists) in [("amplitude_rad", &sines.amplitude_rad), ("phase_rad", &sines.phase_rad)] {
        for (joint, (list, frequencies)) in lists.iter().zip(&sines.frequency_hz).enumerate() {
            if list.len() != frequencies.len() {
                let message = format!(
                    "expected as many values as frequency_hz has for joint {}, {}, got {}",
                    joint + 1,
                    frequencies.len(),
                    list.len()
                );
                check.wrong(&format!("plant.setpoint.sines.{key}"), message);
                return None;
            }
        }
    }
    Some(std::array::from_fn(|j| {
        let tones = sines.frequency_hz[j]
            .iter()
            .zip(&sines.amplitude_rad[j])
            .zip(&sines.phase_rad[j]);
        Setpoint::Sines {
            offset_rad: sines.offset_rad[j],
            tones: tones
                .map(|((&frequency_hz, &amplitude_rad), &phase_rad)| Tone {
                    frequency_hz,
                    amplitude_rad,
                    phase_rad,
                })
                .collect(),
        }
    }))
}

/// Replaces the path of a setpoint file by its rows, so that a configuration written to a recording
/// or for the processes of a run needs no other file.
pub(super) fn inline_setpoints(form: &mut FileForm, check: &mut Check<'_>) {
    const KEY: &str = "plant.setpoint.csv.path";
    let Some(path) = form.csv.path.take_if(|_| form.setpoint.kind == SetpointKind::Csv) else {
        return;
    };
    if check.recorded(KEY) {
        let message = format!(
            "a recording's configuration opens no file, and it names \"{}\"; name the file on the command line, --set {KEY}=FILE",
            cut(&path, 60)
        );
        check.wrong(KEY, message);
        return;
    }
    match setpoint_csv::read(Path::new(&path)) {
        Ok(columns) => form.csv.rows = Some(columns.to_rows()),
        Err(message) => check.wrong(KEY, message),
    }
}

fn from_csv(form: &FileForm, check: &mut Check<'_>) -> Option<[Setpoint; ARM_JOINTS]> {
    const KEY: &str = "plant.setpoint.csv.rows";
    let Some(rows) = &form.csv.rows else {
        // A path that could not be read has been reported.
        if !check.stated("plant.setpoint.csv.path") {
            check.wrong(
                "plant.setpoint.kind",
                "\"csv\" needs plant.setpoint.csv.path, which is not set",
            );
        }
        return None;
    };
    match setpoint_csv::Columns::from_rows(rows) {
        Ok(columns) => {
            let interpolation = form.csv.between;
            Some(columns.q_rad.map(|values_rad| Setpoint::Table {
                t_s: columns.t_s.clone(),
                values_rad,
                interpolation,
            }))
        }
        Err(message) => {
            check.wrong(KEY, message);
            None
        }
    }
}
