//! The figures of a run: setpoints (the paper's Fig. 3), each parameter over time (Figs. 4 to 12),
//! residuals, excitation, accuracy and timing. Inputs are in `inputs.rs`.

use super::axes::{FIRST, SECOND, SMALL_PANEL, bound_lines, decades, extent, padded, positive, value_scale};
use super::data::RunData;
use super::inputs::inputs;
use super::layers::{BLUE, GREY, INK, Layer, Scale, Stroke};
use super::plot::{Figure, Panel};
use super::words::{pretty_unit, symbol};
use crate::messages::Estimate;
use crate::node::monitor::{Label, relative_error, seconds};

/// Standard deviations that contain 95 % of a normal distribution.
const TWO_SIDED_95: f64 = 1.96;
const PANEL: f64 = 250.0;

const ESTIMATE: Stroke = Stroke::solid(BLUE, 1.6);
const TRUTH: Stroke = Stroke::dashed(INK, 1.8, "6 4");
const THIN: Stroke = Stroke::solid(GREY, 1.0);

/// All figures for which the run has data.
pub fn figures(run: &RunData) -> Vec<Figure> {
    let mut all = Vec::new();
    all.extend(setpoints(run));
    if run.estimates.is_empty() {
        return all;
    }
    let parameters = run.monitor.parameters();
    for (index, label) in parameters.iter().enumerate() {
        all.push(value(run, label, index, Kind::Parameter));
    }
    for (index, label) in run.monitor.derived().iter().enumerate() {
        all.push(value(run, label, index, Kind::Derived));
    }
    all.extend(accuracy(run));
    all.extend(inputs(run));
    all.push(residuals(run));
    all.push(excitation(run));
    all.extend(timing(run));
    all
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Parameter,
    Derived,
}

/// Stream time: an estimate is drawn at the end of its block.
fn time_axis(run: &RunData) -> (String, (f64, f64)) {
    let label = match run.block_s() {
        Some(length) => format!("time (s), one estimate every {} s", trim(length)),
        None => "time (s)".to_string(),
    };
    let first = run.estimates.first().map_or(0.0, time_of);
    let last = run.estimates.last().map_or(1.0, time_of);
    let block_s = run.block_s().unwrap_or(1.0);
    // From the beginning if the run was recorded from its beginning.
    let is_whole = run.estimates.first().is_none_or(|e| e.block <= 3) && first <= 4.0 * block_s;
    let from = if is_whole { 0.0 } else { first - block_s };
    (label, (from, last + ((last - from) * 0.015).max(0.5 * block_s)))
}

fn time_of(estimate: &Estimate) -> f64 {
    seconds(estimate.t_last_ns)
}

fn trim(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

/// Vertical lines at the changes found.
fn changes(run: &RunData, labelled: bool) -> Vec<Layer> {
    let found = run.monitor.changes();
    let mark = |c: &crate::node::monitor::Change| {
        let label = match labelled {
            true => format!("change found at {} s", trim(c.t_s)),
            false => String::new(),
        };
        Layer::Mark { x: c.t_s, label }
    };
    found.iter().map(mark).collect()
}

fn setpoints(run: &RunData) -> Option<Figure> {
    let mut panels = Vec::new();
    let mut end = 0.0_f64;
    for (joint, (setpoint, position)) in run.setpoint.iter().zip(&run.position).enumerate() {
        let (setpoint, position) = (setpoint.points(), position.points());
        let all: Vec<f64> = setpoint.iter().chain(&position).map(|p| p.1).collect();
        end = setpoint.iter().chain(&position).map(|p| p.0).fold(end, f64::max);
        if all.is_empty() {
            continue;
        }
        let (from, to) = extent(&all);
        let legend = |text: &str| (joint == 0).then(|| text.to_string());
        panels.push(Panel {
            y_label: format!("joint {}", joint + 1),
            unit: pretty_unit(&run.info.position_unit),
            scale: padded(from, to, 0.06),
            height: SMALL_PANEL,
            layers: vec![
                Layer::Line {
                    points: position,
                    stroke: THIN,
                    legend: legend("position"),
                },
                Layer::Line {
                    points: setpoint,
                    stroke: ESTIMATE,
                    legend: legend("setpoint"),
                },
            ],
        });
    }
    (!panels.is_empty() && end > 0.0).then(|| Figure {
        name: "setpoint".into(),
        title: "Setpoints and positions".into(),
        caption: "Commanded and measured joint positions: the excitation on which everything else rests (the paper's Fig. 3)."
            .into(),
        x_label: "time (s)".into(),
        x_range: (0.0, end),
        panels,
    })
}

fn value(run: &RunData, label: &Label, index: usize, kind: Kind) -> Figure {
    let of = |e: &Estimate| match kind {
        Kind::Parameter => (e.theta[index], e.theta_std[index]),
        Kind::Derived => (e.derived[index], e.derived_std[index]),
    };
    let times = || run.estimates.iter().map(|e| (time_of(e), e));
    let line: Vec<(f64, f64)> = times().map(|(t_s, e)| (t_s, of(e).0)).collect();
    let band: Vec<(f64, f64, f64)> = times()
        .map(|(t_s, e)| {
            let (value, std) = of(e);
            (t_s, value - TWO_SIDED_95 * std, value + TWO_SIDED_95 * std)
        })
        .collect();
    // Filled if the estimate is marked usable; all of them if none is ever marked.
    let marks_usable = kind == Kind::Parameter && run.estimates.iter().any(|e| !e.usable.is_empty());
    let dots: Vec<(f64, f64, bool)> = times()
        .map(|(t_s, e)| (t_s, of(e).0, !marks_usable || e.usable.contains(index)))
        .collect();
    let (x_label, x_range) = time_axis(run);
    let truth = truth_line(run, x_range, |theta, derived| match kind {
        Kind::Parameter => theta.get(index).copied(),
        Kind::Derived => derived.get(index).copied(),
    });

    let estimates: Vec<f64> = line.iter().map(|p| p.1).filter(|v| v.is_finite()).collect();
    let truths: Vec<f64> = truth.iter().map(|p| p.1).collect();
    let mut layers = Vec::new();
    if band.iter().any(|b| b.1.is_finite()) {
        layers.push(Layer::Band {
            points: band,
            colour: BLUE,
            legend: Some("95 % band".into()),
        });
    }
    layers.extend(changes(run, true));
    let mut scale = value_scale(&estimates, &truths);
    if kind == Kind::Parameter
        && let Some(&bounds) = run.notes.bounds.get(index)
    {
        layers.extend(bound_lines(bounds, &mut scale, x_range));
    }
    if !truth.is_empty() {
        layers.push(Layer::Line {
            points: truth,
            stroke: TRUTH,
            legend: Some("truth".into()),
        });
    }
    layers.push(Layer::Line {
        points: line,
        stroke: ESTIMATE,
        legend: (!marks_usable).then(|| "estimate".to_string()),
    });
    layers.push(Layer::Dots {
        points: dots,
        colour: BLUE,
        legend: marks_usable.then(|| ("estimate, usable".to_string(), "not usable".to_string())),
    });
    let shown = symbol(&label.name);
    Figure {
        name: label.name.clone(),
        title: match kind {
            Kind::Parameter => format!("Identification of the parameter {shown}"),
            Kind::Derived => format!("Derived value: {shown}"),
        },
        caption: caption(run, &shown, kind),
        x_label,
        x_range,
        panels: vec![Panel {
            y_label: shown,
            unit: pretty_unit(&label.unit),
            scale,
            height: PANEL,
            layers,
        }],
    }
}

fn caption(run: &RunData, shown: &str, kind: Kind) -> String {
    let mut text = match kind {
        Kind::Parameter => format!(
            "{shown} over time, with the band that holds the true value in 95 of 100 cases where the estimator's assumptions hold."
        ),
        Kind::Derived => {
            format!("{shown}, computed from the parameters by the constants that the configuration knows.")
        }
    };
    if run.monitor.truth().is_some() {
        text.push_str(" The dashed line is what the simulator really had.");
    }
    text.push_str(" Arrows at the border point to estimates outside the axis.");
    text
}

/// The truth at a fine grid over the time axis; empty if unknown.
fn truth_line(run: &RunData, x: (f64, f64), pick: impl Fn(&[f64], &[f64]) -> Option<f64>) -> Vec<(f64, f64)> {
    let Some(truth) = run.monitor.truth() else {
        return Vec::new();
    };
    let mut points: Vec<(f64, f64)> = Vec::new();
    let steps = 2000;
    for i in 0..=steps {
        let t_s = x.0 + (x.1 - x.0) * f64::from(i) / f64::from(steps);
        if t_s < 0.0 {
            continue;
        }
        let Some(value) = pick(&truth.theta(t_s), &truth.derived(t_s)).filter(|v| v.is_finite()) else {
            continue;
        };
        // The middle of a constant level is redundant.
        let held = points.len() >= 2 && points[points.len() - 2].1 == value && points[points.len() - 1].1 == value;
        if held {
            points.pop();
        }
        points.push((t_s, value));
    }
    points
}

fn accuracy(run: &RunData) -> Option<Figure> {
    let truth = run.monitor.truth()?;
    let mut worst = Vec::new();
    let mut median = Vec::new();
    for e in &run.estimates {
        let values = truth.theta(seconds(e.t_last_ns));
        let errors = values
            .iter()
            .zip(&e.theta)
            .filter_map(|(&truth, &value)| relative_error(value, truth))
            .map(f64::abs);
        let mut errors: Vec<f64> = errors.filter(|v| v.is_finite()).collect();
        errors.sort_by(f64::total_cmp);
        if let (Some(&largest), Some(&middle)) = (errors.last(), errors.get(errors.len() / 2)) {
            // Zero cannot be shown on a logarithmic axis; it is drawn at the rounding of a double.
            worst.push((time_of(e), largest.max(f64::EPSILON)));
            median.push((time_of(e), middle.max(f64::EPSILON)));
        }
    }
    let all: Vec<f64> = worst.iter().chain(&median).map(|p| p.1).collect();
    let (x_label, x_range) = time_axis(run);
    let mut layers = vec![Layer::Line {
        points: vec![(x_range.0, 0.01), (x_range.1, 0.01)],
        stroke: Stroke::dashed(GREY, 1.2, "2 3"),
        legend: Some("1 %".into()),
    }];
    layers.extend(changes(run, true));
    layers.push(Layer::Line {
        points: worst,
        stroke: FIRST,
        legend: Some("worst parameter".into()),
    });
    layers.push(Layer::Line {
        points: median,
        stroke: SECOND,
        legend: Some("median parameter".into()),
    });
    Some(Figure {
        name: "accuracy".into(),
        title: "Relative error of the parameters".into(),
        caption:
            "Distance from the simulator's true values; a parameter on which the data do not inform keeps its error."
                .into(),
        x_label,
        x_range,
        panels: vec![Panel {
            y_label: "relative error".into(),
            unit: "1".into(),
            scale: decades(&all),
            height: PANEL,
            layers,
        }],
    })
}

fn residuals(run: &RunData) -> Figure {
    let equations = run.estimates.last().map_or(0, |e| e.equations as usize);
    let mut panels = Vec::new();
    for equation in 0..equations.min(crate::model::MAX_JOINTS) {
        let series = |of: &dyn Fn(&Estimate) -> f64| -> Vec<(f64, f64)> {
            run.estimates.iter().map(|e| (time_of(e), positive(of(e)))).collect()
        };
        let before = series(&|e| e.innovation_rms[equation]);
        let after = series(&|e| e.residual_rms[equation]);
        let all: Vec<f64> = before.iter().chain(&after).map(|p| p.1).collect();
        let legend = |text: &str| (equation == 0).then(|| text.to_string());
        let mut layers = changes(run, equation == 0);
        layers.push(Layer::Line {
            points: before,
            stroke: SECOND,
            legend: legend("innovation, before the update"),
        });
        layers.push(Layer::Line {
            points: after,
            stroke: FIRST,
            legend: legend("residual, after the update"),
        });
        let name = run
            .info
            .equations
            .get(equation)
            .map_or_else(|| format!("equation {}", equation + 1), |n| symbol(n));
        panels.push(Panel {
            y_label: format!("rms, {name}"),
            // Rows are divided by their standard deviation if it is known; otherwise they have the
            // input's unit.
            unit: if run.notes.whitened {
                "1".into()
            } else {
                pretty_unit(&run.info.input_unit)
            },
            scale: decades(&all),
            height: SMALL_PANEL,
            layers,
        });
    }
    let (x_label, x_range) = time_axis(run);
    Figure {
        name: "residuals".into(),
        title: "What the model leaves unexplained".into(),
        caption: "Root mean square of the equations' errors in each block. Where the innovation rises above the residual, the data say something new: the start, or a change of the machine.".into(),
        x_label,
        x_range,
        panels,
    }
}

fn excitation(run: &RunData) -> Figure {
    let parameters = run.monitor.parameters();
    let mut cells = Vec::new();
    for e in &run.estimates {
        for row in 0..parameters.len() {
            let shade = match (e.fixed.contains(row), e.excited.contains(row)) {
                (true, _) => 0,
                (_, false) => 1,
                (_, true) => 2,
            };
            cells.push((time_of(e), row, shade));
        }
    }
    let names: Vec<String> = parameters.iter().map(|p| symbol(&p.name)).collect();
    let condition: Vec<(f64, f64)> = run
        .estimates
        .iter()
        .map(|e| (time_of(e), positive(e.condition)))
        .collect();
    let values: Vec<f64> = condition.iter().map(|p| p.1).collect();
    let (x_label, x_range) = time_axis(run);
    let mut panels = vec![Panel {
        y_label: String::new(),
        unit: String::new(),
        height: 22.0 * names.len() as f64,
        layers: vec![Layer::Cells {
            cells,
            width: run.block_s().unwrap_or(1.0),
        }],
        scale: Scale::Rows(names),
    }];
    if values.iter().any(|v| v.is_finite()) {
        let mut layers = changes(run, false);
        layers.push(Layer::Line {
            points: condition,
            stroke: ESTIMATE,
            legend: Some("condition number of the information, columns scaled".into()),
        });
        panels.push(Panel {
            y_label: "condition".into(),
            unit: "1".into(),
            scale: decades(&values),
            height: 130.0,
            layers,
        });
    }
    Figure {
        name: "excitation".into(),
        title: "Parameters about which the data were informative".into(),
        caption: "Dark: the data of the block were informative about the parameter. Light: they were not, and it kept its value.".into(),
        x_label,
        x_range,
        panels,
    }
}

fn timing(run: &RunData) -> Option<Figure> {
    if run.timing.len() < 2 {
        return None;
    }
    let latency: Vec<(f64, f64)> = run.timing.iter().map(|t| (t.t_s, t.latency_s * 1e3)).collect();
    let speed: Vec<(f64, f64)> = run
        .timing
        .windows(2)
        .map(|pair| {
            let wall = pair[1].sample_sent_ns.saturating_sub(pair[0].sample_sent_ns) as f64 * 1e-9;
            (pair[1].t_s, (pair[1].t_s - pair[0].t_s) / wall)
        })
        .collect();
    let panel = |y_label: &str, unit: &str, points: Vec<(f64, f64)>, legend: &str| {
        let values: Vec<f64> = points.iter().map(|p| p.1).filter(|v| v.is_finite()).collect();
        let to = values.iter().copied().fold(0.0, f64::max);
        Panel {
            y_label: y_label.into(),
            unit: unit.into(),
            scale: Scale::Linear {
                from: 0.0,
                to: if to > 0.0 { to * 1.08 } else { 1.0 },
            },
            height: 140.0,
            layers: vec![Layer::Line {
                points,
                stroke: ESTIMATE,
                legend: Some(legend.into()),
            }],
        }
    };
    let (x_label, x_range) = time_axis(run);
    Some(Figure {
        name: "timing".into(),
        title: "Time from sample to estimate, and pace of the stream".into(),
        caption: "Above, the wait for an estimate after its block's last sample was sent; below, how much faster than real time the samples came.".into(),
        x_label,
        x_range,
        panels: vec![
            panel("latency", "ms", latency, "from the block's last sample to its estimate"),
            panel("pace", "s/s", speed, "stream time per clock time"),
        ],
    })
}
