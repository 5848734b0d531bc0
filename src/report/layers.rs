//! The layers of a panel: lines, bands, dots, marks and cells, and the axes.

use super::hover::slots;
use super::labels::{escape, short};
use std::fmt::Write as _;

/// Width of a figure \[px\].
pub(super) const WIDTH: f64 = 860.0;
pub(super) const LEFT: f64 = 84.0;
pub(super) const RIGHT: f64 = 24.0;
/// Largest number of dots of a line with numbers under the pointer.
const HOVER: usize = 400;

pub(super) const INK: &str = "#1b1b1b";
pub(super) const BLUE: &str = "#0072B2";
pub(super) const ORANGE: &str = "#E69F00";
pub(super) const GREY: &str = "#8a8a8a";
pub(super) const VERMILION: &str = "#C04A00";
pub(super) const GRID: &str = "#e4e4e4";

/// Style of a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stroke {
    pub(super) colour: &'static str,
    pub(super) width: f64,
    /// SVG dash pattern; empty for a solid line.
    pub(super) dash: &'static str,
}

impl Stroke {
    pub(super) const fn solid(colour: &'static str, width: f64) -> Self {
        let dash = "";
        Self { colour, width, dash }
    }

    pub(super) const fn dashed(colour: &'static str, width: f64, dash: &'static str) -> Self {
        Self { colour, width, dash }
    }
}

/// The layers of a panel, from back to front.
#[derive(Debug, Clone)]
pub(super) enum Layer {
    /// Broken where a value is not finite.
    Line {
        points: Vec<(f64, f64)>,
        stroke: Stroke,
        legend: Option<String>,
    },
    /// x, lower, upper; broken if one is not finite.
    Band {
        points: Vec<(f64, f64, f64)>,
        colour: &'static str,
        legend: Option<String>,
    },
    /// x, y, filled.
    Dots {
        points: Vec<(f64, f64, bool)>,
        colour: &'static str,
        legend: Option<(String, String)>,
    },
    /// A vertical line with text above it.
    Mark { x: f64, label: String },
    /// Rows of cells that end at x: x and row from above, 0 blank, 1 light, 2 dark.
    Cells { cells: Vec<(f64, usize, u8)>, width: f64 },
}

/// The vertical axis.
#[derive(Debug, Clone)]
pub(super) enum Scale {
    Linear {
        from: f64,
        to: f64,
    },
    Log {
        from: f64,
        to: f64,
    },
    /// Named rows instead of numbers.
    Rows(Vec<String>),
}

/// Position and coordinates of a panel.
pub(super) struct Frame<'a> {
    pub(super) id: String,
    pub(super) x: (f64, f64),
    pub(super) top: f64,
    pub(super) height: f64,
    pub(super) scale: &'a Scale,
}

impl Frame<'_> {
    pub(super) fn x(&self, x: f64) -> f64 {
        let (from, to) = self.x;
        LEFT + (x - from) / (to - from) * (WIDTH - LEFT - RIGHT)
    }

    pub(super) fn y(&self, y: f64) -> f64 {
        let part = match *self.scale {
            Scale::Linear { from, to } => (y - from) / (to - from),
            Scale::Log { from, to } => (y.log10() - from.log10()) / (to.log10() - from.log10()),
            Scale::Rows(ref rows) => 1.0 - y / rows.len() as f64,
        };
        // Clamp values far outside, which are invisible anyway, to keep the SVG short.
        self.top + self.height * (1.0 - part.clamp(-2.0, 3.0))
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }
}

/// Numbers under the pointer for lines; dots have their own text.
pub(super) fn draw_slots(svg: &mut String, frame: &Frame, layers: &[Layer]) {
    if layers.iter().any(|layer| matches!(layer, Layer::Dots { .. })) {
        return;
    }
    let lines = layers.iter().filter_map(|layer| match layer {
        // Two points are a constant level, which the legend names.
        Layer::Line { points, legend, .. } if points.len() > 2 => Some((&points[..], legend.as_deref())),
        _ => None,
    });
    for slot in slots(&lines.collect::<Vec<_>>(), frame.x, short) {
        let (left, right) = (frame.x(slot.from), frame.x(slot.to));
        let _ = write!(
            svg,
            r#"<rect x="{left:.1}" y="{:.1}" width="{:.1}" height="{}" fill="none" pointer-events="all"><title>{}</title></rect>"#,
            frame.top,
            right - left,
            frame.height,
            escape(&slot.text)
        );
    }
}

pub(super) fn draw_layer(svg: &mut String, frame: &Frame, layer: &Layer) {
    match layer {
        Layer::Line { points, stroke, .. } => {
            let mut path = String::new();
            let mut drawing = false;
            for &(x, y) in points {
                if y.is_finite() {
                    let letter = if drawing { 'L' } else { 'M' };
                    let _ = write!(path, "{letter}{:.1} {:.1}", frame.x(x), frame.y(y));
                }
                drawing = y.is_finite();
            }
            let _ = write!(
                svg,
                r#"<path d="{path}" {} fill="none" stroke-linejoin="round"/>"#,
                attributes(stroke)
            );
        }
        Layer::Band { points, colour, .. } => {
            for run in points.split(|p| !(p.1.is_finite() && p.2.is_finite())) {
                let upper = run.iter().map(|p| (p.0, p.2));
                let lower = run.iter().rev().map(|p| (p.0, p.1));
                let mut path = String::new();
                for (x, y) in upper.chain(lower) {
                    let letter = if path.is_empty() { 'M' } else { 'L' };
                    let _ = write!(path, "{letter}{:.1} {:.1}", frame.x(x), frame.y(y));
                }
                if !path.is_empty() {
                    let _ = write!(svg, r#"<path d="{path}Z" fill="{colour}" fill-opacity=".2"/>"#);
                }
            }
        }
        Layer::Dots { points, colour, .. } => {
            let radius = if points.len() > 150 { 1.6 } else { 2.6 };
            // Text under the pointer takes as much space as the dot itself.
            let hover = points.len() <= HOVER;
            for &(x, y, filled) in points.iter().filter(|p| p.1.is_finite()) {
                let title = match hover {
                    true => format!("><title>{} s: {}</title></circle>", short(x), short(y)),
                    false => "/>".to_owned(),
                };
                let fill = if filled { colour } else { "#fff" };
                let _ = write!(
                    svg,
                    r#"<circle cx="{:.1}" cy="{:.1}" r="{radius}" fill="{fill}" stroke="{colour}" stroke-width="1.3"{title}"#,
                    frame.x(x),
                    frame.y(y)
                );
            }
        }
        Layer::Mark { x, .. } => {
            let _ = write!(
                svg,
                r#"<path d="M{:.1} {:.1}V{:.1}" stroke="{VERMILION}" stroke-width="1.6" stroke-dasharray="7 3 1.5 3"/>"#,
                frame.x(*x),
                frame.top,
                frame.bottom()
            );
        }
        Layer::Cells { cells, width } => {
            for &(x, row, shade) in cells {
                let (left, right) = (frame.x(x - width), frame.x(x));
                let (top, bottom) = (frame.y(row as f64), frame.y(row as f64 + 1.0));
                // A thin white gap between the cells, if they are wide enough.
                let gap = if right - left > 4.0 { 0.8 } else { 0.0 };
                let _ = write!(
                    svg,
                    r#"<rect x="{left:.2}" y="{:.1}" width="{:.2}" height="{:.1}" fill="{}"/>"#,
                    top + 2.0,
                    right - left - gap,
                    bottom - top - 4.0,
                    cell_colour(shade)
                );
            }
        }
    }
}

pub(super) fn cell_colour(shade: u8) -> &'static str {
    match shade {
        0 => "#ffffff",
        1 => "#cfe0ec",
        _ => "#1f4e79",
    }
}

pub(super) fn attributes(stroke: &Stroke) -> String {
    let mut text = format!(r#"stroke="{}" stroke-width="{}""#, stroke.colour, stroke.width);
    if !stroke.dash.is_empty() {
        let _ = write!(text, r#" stroke-dasharray="{}""#, stroke.dash);
    }
    text
}
