//! The figure of the measured input and the one predicted by the model.

use super::axes::{FIRST, SECOND, SMALL_PANEL, extent, padded};
use super::data::{Inputs, RunData};
use super::layers::Layer;
use super::plot::{Figure, Panel};
use super::words::pretty_unit;
use crate::node::monitor::seconds;
use std::fmt::Write as _;

/// Measured and predicted input of each joint over the last seconds of the run; `None` if nothing
/// was predicted.
pub(super) fn inputs(run: &RunData) -> Option<Figure> {
    let from = run.inputs.front().map(|first| seconds(first.t_ns))?;
    let to = run
        .inputs
        .back()
        .map(|last| seconds(last.t_ns))
        .filter(|&to| to > from)?;
    let mut panels = Vec::new();
    let mut fits = String::new();
    for joint in 0..run.info.joints {
        let line = |of: &dyn Fn(&Inputs) -> f64| -> Vec<(f64, f64)> {
            run.inputs.iter().map(|i| (seconds(i.t_ns), of(i))).collect()
        };
        let measured = line(&|i| i.measured[joint]);
        let predicted = line(&|i| i.predicted[joint]);
        if !predicted.iter().any(|p| p.1.is_finite()) {
            continue;
        }
        if let Some(share) = misfit(run, joint) {
            let between = if fits.is_empty() { "" } else { ", " };
            let _ = write!(fits, "{between}joint {}: {:.1} %", joint + 1, 100.0 * share);
        }
        // The measured input determines the scale, because a wrong model may predict anything.
        let known: Vec<f64> = measured.iter().map(|p| p.1).filter(|v| v.is_finite()).collect();
        let all: Vec<f64> = predicted.iter().map(|p| p.1).collect();
        let (low, high) = extent(if known.is_empty() { &all } else { &known });
        let legend = |text: &str| panels.is_empty().then(|| text.to_string());
        let layers = vec![
            Layer::Line {
                points: measured,
                stroke: FIRST,
                legend: legend("measured"),
            },
            Layer::Line {
                points: predicted,
                stroke: SECOND,
                legend: legend("predicted"),
            },
        ];
        panels.push(Panel {
            y_label: format!("joint {}", joint + 1),
            unit: pretty_unit(&run.info.input_unit),
            scale: padded(low, high, 0.15),
            height: SMALL_PANEL,
            layers,
        });
    }
    let mut caption = "The measured input, and the one that the model predicts from the motion with the estimate of the blocks before: \
                       nothing was learnt yet from what is predicted."
        .to_string();
    if let Some(length_s) = run.smoothed_s() {
        let length_ms = 1e3 * length_s;
        let _ = write!(
            caption,
            " Derivatives of the motion are taken from the positions over {length_ms:.0} ms, which rounds jumps and holds their noise."
        );
    }
    if !fits.is_empty() {
        let _ = write!(
            caption,
            " Difference, as a share of the measured input (root mean squares): {fits}."
        );
    }
    (!panels.is_empty()).then(|| Figure {
        name: "input".into(),
        title: format!("Measured and predicted input, last {:.0} s", (to - from).max(1.0)),
        caption,
        x_label: "time (s)".into(),
        x_range: (from, to),
        panels,
    })
}

/// Root mean square of the difference as a share of that of the measured input.
fn misfit(run: &RunData, joint: usize) -> Option<f64> {
    let pairs = run.inputs.iter().map(|i| (i.measured[joint], i.predicted[joint]));
    let (mut difference, mut size) = (0.0, 0.0);
    for (measured, predicted) in pairs.filter(|(measured, predicted)| measured.is_finite() && predicted.is_finite()) {
        difference += (measured - predicted).powi(2);
        size += measured * measured;
    }
    (size > 0.0).then(|| (difference / size).sqrt())
}
