//! Panels with axes, lines and bands, drawn as SVG.
//!
//! Designed only for this project's figures: block numbers or seconds on the horizontal axis, one
//! or more panels above each other, a legend above the panel so that it never covers data. Lines
//! differ by dash and by lightness as well as by hue (Okabe and Ito's colours), so a figure can be
//! read in greyscale and by colour-blind readers.

use super::fonts::FONT;
use super::labels::{escape, numbers, power_of_ten, ticks};
use super::layers::{
    Frame, GRID, INK, LEFT, Layer, RIGHT, Scale, Stroke, VERMILION, WIDTH, attributes, cell_colour, draw_layer,
    draw_slots,
};
use std::fmt::Write as _;

/// Room above a panel: title or legend, labels of marks.
const ABOVE: f64 = 34.0;
const MARK_LABELS: f64 = 18.0;
/// Room below the last panel: ticks and the axis' label.
const BELOW: f64 = 50.0;
const TITLE: f64 = 30.0;
/// One pair of axes.
#[derive(Debug, Clone)]
pub(super) struct Panel {
    pub(super) y_label: String,
    pub(super) unit: String,
    pub(super) scale: Scale,
    pub(super) height: f64,
    pub(super) layers: Vec<Layer>,
}

/// A figure: panels above each other over one horizontal axis.
#[derive(Debug, Clone)]
pub struct Figure {
    /// File name without ending: `theta_1`.
    pub name: String,
    /// Its title, in one line.
    pub title: String,
    /// Caption on the page.
    pub caption: String,
    pub(super) x_label: String,
    pub(super) x_range: (f64, f64),
    pub(super) panels: Vec<Panel>,
}

impl Figure {
    /// The figure as an SVG document.
    pub fn svg(&self) -> String {
        let marks = |panel: &Panel| panel.layers.iter().any(|l| matches!(l, Layer::Mark { .. }));
        let above: Vec<f64> = self
            .panels
            .iter()
            .map(|panel| {
                let legend = if panel.legend().is_empty() { 12.0 } else { ABOVE };
                legend + if marks(panel) { MARK_LABELS } else { 0.0 }
            })
            .collect();
        let heights: f64 = self.panels.iter().map(|panel| panel.height).sum();
        let height = TITLE + above.iter().sum::<f64>() + heights + BELOW;
        let mut svg = String::new();
        let _ = write!(
            svg,
            r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" font-family="{FONT}" font-size="13" fill="{INK}" role="img"><title>{title}</title><rect width="100%" height="100%" fill="#fff"/><text x="{LEFT}" y="22" font-size="16" font-weight="500">{title}</text>"##,
            title = escape(&self.title),
        );
        let mut top = TITLE;
        for (index, (panel, above)) in self.panels.iter().zip(&above).enumerate() {
            top += above;
            let last = index + 1 == self.panels.len();
            let frame = Frame {
                id: format!("{}-{index}", self.name),
                x: self.x_range,
                top,
                height: panel.height,
                scale: &panel.scale,
            };
            panel.draw(&mut svg, &frame, top - above, last);
            top += panel.height;
        }
        let _ = write!(
            svg,
            r#"<text x="{}" y="{}" font-size="14" text-anchor="middle">{}</text></svg>"#,
            (LEFT + WIDTH - RIGHT) / 2.0,
            height - 10.0,
            escape(&self.x_label)
        );
        svg.push('\n');
        svg
    }
}

/// A sample of the line beside each word of the legend.
enum Sign {
    Line(Stroke),
    Band(&'static str),
    Dot(&'static str, bool),
    Cell(u8),
}

impl Panel {
    fn legend(&self) -> Vec<(Sign, &str)> {
        let mut entries = Vec::new();
        for layer in &self.layers {
            match layer {
                Layer::Line {
                    stroke,
                    legend: Some(text),
                    ..
                } => entries.push((Sign::Line(*stroke), text.as_str())),
                Layer::Band {
                    colour,
                    legend: Some(text),
                    ..
                } => entries.push((Sign::Band(colour), text)),
                Layer::Dots {
                    colour,
                    legend: Some((filled, hollow)),
                    ..
                } => {
                    entries.push((Sign::Dot(colour, true), filled));
                    entries.push((Sign::Dot(colour, false), hollow));
                }
                Layer::Cells { .. } => {
                    entries.push((Sign::Cell(2), "excited"));
                    entries.push((Sign::Cell(1), "not excited"));
                    entries.push((Sign::Cell(0), "no estimate, or held fixed"));
                }
                _ => {}
            }
        }
        entries
    }

    fn draw(&self, svg: &mut String, frame: &Frame, legend_top: f64, last: bool) {
        self.draw_legend(svg, legend_top);
        let (top, bottom, right) = (frame.top, frame.bottom(), WIDTH - RIGHT);
        let _ = write!(
            svg,
            r#"<clipPath id="{id}"><rect x="{LEFT}" y="{top}" width="{w}" height="{h}"/></clipPath>"#,
            id = frame.id,
            w = right - LEFT,
            h = frame.height
        );
        let factor = self.draw_y_axis(svg, frame);
        let at = ticks(frame.x.0, frame.x.1, 12);
        for (&tick, text) in at.iter().zip(numbers(&at, 1.0)) {
            let x = frame.x(tick);
            let _ = write!(
                svg,
                r#"<path d="M{x:.1} {top:.1}V{bottom:.1}" stroke="{GRID}"/><path d="M{x:.1} {bottom:.1}v5" stroke="{INK}"/>"#
            );
            if last {
                let y = bottom + 19.0;
                let _ = write!(svg, r#"<text x="{x:.1}" y="{y:.1}" text-anchor="middle">{text}</text>"#);
            }
        }
        let _ = write!(svg, r#"<g clip-path="url(#{})">"#, frame.id);
        for layer in &self.layers {
            draw_layer(svg, frame, layer);
        }
        let _ = write!(
            svg,
            r#"</g><rect x="{LEFT}" y="{top:.1}" width="{}" height="{}" fill="none" stroke="{INK}"/>"#,
            right - LEFT,
            frame.height
        );
        self.draw_marks(svg, frame);
        self.draw_outside(svg, frame);
        if !matches!(self.scale, Scale::Rows(_)) {
            draw_slots(svg, frame, &self.layers);
        }
        let label = match (self.unit.as_str(), factor) {
            ("1" | "", None) => escape(&self.y_label),
            ("1" | "", Some(factor)) => format!("{} ({factor})", escape(&self.y_label)),
            (unit, None) => format!("{} ({})", escape(&self.y_label), escape(unit)),
            (unit, Some(factor)) => format!("{} ({factor} {})", escape(&self.y_label), escape(unit)),
        };
        let middle = top + frame.height / 2.0;
        let _ = write!(
            svg,
            r#"<text transform="translate(20 {middle:.1}) rotate(-90)" font-size="14" text-anchor="middle">{label}</text>"#
        );
    }

    /// Grid, ticks and numbers; returns the power of ten that is factored out of the numbers.
    fn draw_y_axis(&self, svg: &mut String, frame: &Frame) -> Option<String> {
        let mut tick = |y: f64, text: &str, grid: bool| {
            if grid {
                let right = WIDTH - RIGHT;
                let _ = write!(svg, r#"<path d="M{LEFT} {y:.1}H{right}" stroke="{GRID}"/>"#);
                let _ = write!(svg, r#"<path d="M{LEFT} {y:.1}h-5" stroke="{INK}"/>"#);
            }
            let (x, y) = (LEFT - 9.0, y + 4.5);
            // A long name is drawn narrower instead of being cut at the edge; a letter is about 7
            // units wide.
            let room = x - 4.0;
            let narrow = if 7.0 * text.chars().count() as f64 > room && !text.contains('<') {
                format!(r#" textLength="{room}" lengthAdjust="spacingAndGlyphs""#)
            } else {
                String::new()
            };
            let _ = write!(
                svg,
                r#"<text x="{x}" y="{y:.1}" text-anchor="end"{narrow}>{text}</text>"#
            );
        };
        match *frame.scale {
            Scale::Linear { from, to } => {
                let largest = from.abs().max(to.abs());
                let exponent = if (0.01..1e5).contains(&largest) || largest == 0.0 {
                    0
                } else {
                    (largest.log10() / 3.0).floor().clamp(-110.0, 110.0) as i32 * 3
                };
                let unit = 10f64.powi(exponent);
                let values = ticks(from, to, (frame.height / 34.0) as usize);
                for (value, text) in values.iter().zip(numbers(&values, unit)) {
                    tick(frame.y(*value), &text, true);
                }
                (exponent != 0).then(|| power_of_ten(exponent))
            }
            Scale::Log { from, to } => {
                // Ends of 0 or infinity, from a recording with such values, have no decade; no
                // double is beyond these limits.
                let decade = |end: f64| end.log10().clamp(-330.0, 330.0);
                let decades = decade(from).ceil() as i32..=decade(to).floor() as i32;
                let step = (decades.clone().count() as f64 / (frame.height / 34.0)).ceil().max(1.0) as i32;
                for decade in decades.filter(|d| d % step == 0) {
                    tick(frame.y(10f64.powi(decade)), &power_of_ten(decade), true);
                }
                None
            }
            Scale::Rows(ref rows) => {
                for (index, row) in rows.iter().enumerate() {
                    tick(frame.y(index as f64 + 0.5), &escape(row), false);
                }
                None
            }
        }
    }

    fn draw_legend(&self, svg: &mut String, top: f64) {
        let entries = self.legend();
        // A letter of sans-serif text is about 0.52 em wide; a little more separates the entries.
        let width = |text: &str| 34.0 + 6.9 * text.chars().count() as f64 + 14.0;
        let mut x = LEFT;
        let y = top + 18.0;
        for (sign, text) in entries {
            let _ = match sign {
                Sign::Line(stroke) => write!(svg, r#"<path d="M{x:.1} {y:.1}h28" {}/>"#, attributes(&stroke)),
                Sign::Band(colour) => write!(
                    svg,
                    r#"<rect x="{x:.1}" y="{:.1}" width="28" height="12" fill="{colour}" fill-opacity=".2"/>"#,
                    y - 6.0
                ),
                Sign::Dot(colour, filled) => {
                    let fill = if filled { colour } else { "#fff" };
                    let x = x + 14.0;
                    write!(
                        svg,
                        r#"<circle cx="{x:.1}" cy="{y:.1}" r="3" fill="{fill}" stroke="{colour}" stroke-width="1.4"/>"#
                    )
                }
                Sign::Cell(shade) => write!(
                    svg,
                    r##"<rect x="{:.1}" y="{:.1}" width="14" height="12" fill="{}" stroke="#bbb"/>"##,
                    x + 12.0,
                    y - 6.0,
                    cell_colour(shade)
                ),
            };
            let _ = write!(
                svg,
                r#"<text x="{:.1}" y="{:.1}">{}</text>"#,
                x + 34.0,
                y + 4.5,
                escape(text)
            );
            x += width(text);
        }
    }

    /// Text above the vertical lines, left out if it would overlap.
    fn draw_marks(&self, svg: &mut String, frame: &Frame) {
        let mut free_from = LEFT - 40.0;
        for layer in &self.layers {
            let Layer::Mark { x, label } = layer else { continue };
            let x = frame.x(*x);
            let half = 3.4 * label.chars().count() as f64;
            let centre = x.clamp(LEFT - 40.0 + half, WIDTH - 6.0 - half);
            if centre - half < free_from {
                continue;
            }
            free_from = centre + half + 8.0;
            let _ = write!(
                svg,
                r#"<text x="{centre:.1}" y="{:.1}" fill="{VERMILION}" font-size="12" text-anchor="middle">{}</text>"#,
                frame.top - 6.0,
                escape(label)
            );
        }
    }

    /// Small arrows at the border where dots lie outside.
    fn draw_outside(&self, svg: &mut String, frame: &Frame) {
        for layer in &self.layers {
            let Layer::Dots { points, colour, .. } = layer else {
                continue;
            };
            for &(x, y, _) in points.iter().filter(|p| p.1.is_finite()) {
                let (x, y) = (frame.x(x), frame.y(y));
                let (tip, base) = if y < frame.top - 0.5 {
                    (frame.top + 2.0, frame.top + 10.0)
                } else if y > frame.bottom() + 0.5 {
                    (frame.bottom() - 2.0, frame.bottom() - 10.0)
                } else {
                    continue;
                };
                let _ = write!(
                    svg,
                    r#"<path d="M{x:.1} {tip:.1}L{:.1} {base:.1}H{:.1}Z" fill="{colour}"/>"#,
                    x - 4.0,
                    x + 4.0
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::layers::BLUE;
    use super::*;

    #[test]
    fn prop_values_that_are_not_finite_break_a_line_and_never_reach_the_file() {
        let nan = f64::NAN;
        let panel = Panel {
            y_label: "<a & b>".into(),
            unit: "m".into(),
            scale: Scale::Linear { from: 0.0, to: 1.0 },
            height: 100.0,
            layers: vec![
                Layer::Line {
                    points: vec![(0.0, 0.0), (1.0, nan), (2.0, f64::INFINITY), (3.0, 1.0), (4.0, 1e300)],
                    stroke: Stroke::solid(BLUE, 1.0),
                    legend: None,
                },
                Layer::Band {
                    points: vec![(0.0, nan, 1.0), (1.0, 0.0, nan)],
                    colour: BLUE,
                    legend: None,
                },
                Layer::Dots {
                    points: vec![(0.0, nan, true), (1.0, 5.0, false)],
                    colour: BLUE,
                    legend: None,
                },
            ],
        };
        let figure = Figure {
            name: "x".into(),
            title: "\"t\"".into(),
            caption: String::new(),
            x_label: "x".into(),
            x_range: (0.0, 4.0),
            panels: vec![panel],
        };
        let svg = figure.svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(svg.contains("&lt;a &amp; b&gt; (m)"), "{svg}");
    }
}
