//! Tracking error over time, for several controllers.

use super::layers::{BLUE, GREY, INK, Layer, ORANGE, Scale, Stroke};
use super::plot::{Figure, Panel};

const HEIGHT: f64 = 200.0;
/// Styles of the lines of a panel, in drawing order; a panel has no more lines.
const STROKES: [Stroke; 4] = [
    Stroke::solid(GREY, 1.4),
    Stroke::dashed(ORANGE, 1.8, "5 3"),
    Stroke::solid(BLUE, 1.8),
    Stroke::dashed(INK, 1.4, "2 3"),
];

/// One machine's panel.
#[derive(Debug, Clone)]
pub struct TrackingPanel {
    /// Name of the machine.
    pub name: String,
    /// Unit of the error.
    pub unit: String,
    /// When the machine changed \[s\], and a word for the change.
    pub change: (f64, String),
    /// Up to four controllers: name, and error over time \[s\].
    pub lines: Vec<(String, Vec<(f64, f64)>)>,
}

/// The errors on logarithmic axes, one panel per machine over a common time axis.
pub fn tracking_figure(panels: &[TrackingPanel]) -> Figure {
    let points = || panels.iter().flat_map(|panel| &panel.lines).flat_map(|line| &line.1);
    let times = || points().map(|point| point.0);
    Figure {
        name: "tracking".into(),
        title: "Tracking error".into(),
        caption: "Root mean square of setpoint minus position of all joints, before and after the machine changes."
            .into(),
        x_label: "time (s)".into(),
        x_range: (
            times().fold(f64::INFINITY, f64::min),
            times().fold(f64::NEG_INFINITY, f64::max),
        ),
        panels: panels
            .iter()
            .enumerate()
            .map(|(index, panel)| drawn(panel, index == 0))
            .collect(),
    }
}

fn drawn(panel: &TrackingPanel, has_legend: bool) -> Panel {
    let errors = || {
        panel
            .lines
            .iter()
            .flat_map(|line| &line.1)
            .map(|point| point.1)
            .filter(|x| *x > 0.0)
    };
    let (least, most) = (errors().fold(f64::INFINITY, f64::min), errors().fold(0.0, f64::max));
    let decade = |x: f64, round: fn(f64) -> f64| 10f64.powf(round(x.max(1e-12).log10()));
    let mut layers: Vec<Layer> = panel
        .lines
        .iter()
        .zip(STROKES)
        .map(|((name, points), stroke)| Layer::Line {
            points: points.clone(),
            stroke,
            legend: has_legend.then(|| name.clone()),
        })
        .collect();
    let (x, label) = panel.change.clone();
    layers.push(Layer::Mark { x, label });
    Panel {
        y_label: panel.name.clone(),
        unit: panel.unit.clone(),
        scale: Scale::Log {
            from: decade(least, f64::floor),
            to: decade(most, f64::ceil),
        },
        height: HEIGHT,
        layers,
    }
}
