//! Panels with axes, lines and bands, drawn as SVG.
//!
//! Made for this project's figures and not for any figure: block numbers or seconds to the right, one or more panels above each other, a legend
//! above the panel so that it never covers data. Lines differ by dash and by lightness as well as by hue (Okabe and Ito's colours),
//! so a figure can be read on a grey print and by the colour-blind.

use super::hover::slots;
use std::fmt::Write as _;

/// Width of a figure \[px\].
const WIDTH: f64 = 860.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 24.0;
/// Room above a panel: title or legend, labels of marks.
const ABOVE: f64 = 34.0;
const MARK_LABELS: f64 = 18.0;
/// Room below the last panel: ticks and the axis' label.
const BELOW: f64 = 50.0;
const TITLE: f64 = 30.0;
/// The most dots of a line that have their numbers under the pointer.
const HOVER: usize = 400;
/// Families by preference; the first is embedded in the program and in the page.
pub(super) const FONT: &str = "Roboto, 'Helvetica Neue', Arial, sans-serif";

pub(super) const INK: &str = "#1b1b1b";
pub(super) const BLUE: &str = "#0072B2";
pub(super) const ORANGE: &str = "#E69F00";
pub(super) const GREY: &str = "#8a8a8a";
const VERMILION: &str = "#C04A00";
const GRID: &str = "#e4e4e4";

/// How a line is drawn.
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

/// What is drawn in a panel, from back to front.
#[derive(Debug, Clone)]
pub(super) enum Layer {
    /// Broken where a value is not finite.
    Line {
        points: Vec<(f64, f64)>,
        stroke: Stroke,
        legend: Option<String>,
    },
    /// x, lower, upper; broken where one is not finite.
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
    /// A vertical line with words above it.
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
    /// What it shows, in a line.
    pub title: String,
    /// What to look at, for the page.
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

/// Where a panel lies and what its coordinates mean.
struct Frame<'a> {
    id: String,
    x: (f64, f64),
    top: f64,
    height: f64,
    scale: &'a Scale,
}

impl Frame<'_> {
    fn x(&self, x: f64) -> f64 {
        let (from, to) = self.x;
        LEFT + (x - from) / (to - from) * (WIDTH - LEFT - RIGHT)
    }

    fn y(&self, y: f64) -> f64 {
        let part = match *self.scale {
            Scale::Linear { from, to } => (y - from) / (to - from),
            Scale::Log { from, to } => (y.log10() - from.log10()) / (to.log10() - from.log10()),
            Scale::Rows(ref rows) => 1.0 - y / rows.len() as f64,
        };
        // Far outside is as invisible as just outside, and short to write.
        self.top + self.height * (1.0 - part.clamp(-2.0, 3.0))
    }

    fn bottom(&self) -> f64 {
        self.top + self.height
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

    /// Grid, ticks and numbers; returns the power of ten that the numbers leave out.
    fn draw_y_axis(&self, svg: &mut String, frame: &Frame) -> Option<String> {
        let mut tick = |y: f64, text: &str, grid: bool| {
            if grid {
                let right = WIDTH - RIGHT;
                let _ = write!(svg, r#"<path d="M{LEFT} {y:.1}H{right}" stroke="{GRID}"/>"#);
                let _ = write!(svg, r#"<path d="M{LEFT} {y:.1}h-5" stroke="{INK}"/>"#);
            }
            let (x, y) = (LEFT - 9.0, y + 4.5);
            // A long name is drawn narrower instead of being cut at the border; a letter is some 7 units wide.
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
                    (largest.log10() / 3.0).floor() as i32 * 3
                };
                let unit = 10f64.powi(exponent);
                let values = ticks(from, to, (frame.height / 34.0) as usize);
                for (value, text) in values.iter().zip(numbers(&values, unit)) {
                    tick(frame.y(*value), &text, true);
                }
                (exponent != 0).then(|| power_of_ten(exponent))
            }
            Scale::Log { from, to } => {
                // Ends of 0 or infinity, from a recording that holds such values, have no decade; no number is beyond these.
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
        // Widths of a sans-serif text are near 0.52 em a letter; a little more keeps entries apart.
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

    /// Words above the vertical lines, left out where they would meet.
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

/// Numbers under the pointer for lines; dots have words of their own.
fn draw_slots(svg: &mut String, frame: &Frame, layers: &[Layer]) {
    if layers.iter().any(|layer| matches!(layer, Layer::Dots { .. })) {
        return;
    }
    let lines = layers.iter().filter_map(|layer| match layer {
        // Two points are a level, which its legend names.
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

fn draw_layer(svg: &mut String, frame: &Frame, layer: &Layer) {
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
            // Words under the pointer cost as much as the dot itself.
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
                // A hair of white between the cells, where they are wide enough to spare it.
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

/// Six significant digits without zeros at the end.
fn short(value: f64) -> String {
    let text = format!("{value:.5e}");
    text.parse::<f64>().map_or(text, |value| value.to_string())
}

fn cell_colour(shade: u8) -> &'static str {
    match shade {
        0 => "#ffffff",
        1 => "#cfe0ec",
        _ => "#1f4e79",
    }
}

fn attributes(stroke: &Stroke) -> String {
    let mut text = format!(r#"stroke="{}" stroke-width="{}""#, stroke.colour, stroke.width);
    if !stroke.dash.is_empty() {
        let _ = write!(text, r#" stroke-dasharray="{}""#, stroke.dash);
    }
    text
}

/// About `count` round numbers from `from` to `to`.
pub(super) fn ticks(from: f64, to: f64, count: usize) -> Vec<f64> {
    let span = to - from;
    if !(span.is_finite() && span > 0.0) {
        return Vec::new();
    }
    let rough = span / count.max(2) as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|&step| step >= rough * 0.999)
        .unwrap_or(10.0 * power);
    let first = (from / step - 1e-9).ceil() as i64;
    let last = (to / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// The numbers at ticks, in a unit: all with as many decimals as their distance needs, and with a real minus.
fn numbers(ticks: &[f64], unit: f64) -> Vec<String> {
    let step = match ticks {
        [first, second, ..] => (second - first) / unit,
        _ => 1.0,
    };
    let decimals = (-step.log10() - 1e-9).ceil().clamp(0.0, 12.0) as usize;
    let text = |tick: &f64| {
        // Not the dust of binary fractions, nor a zero with a sign.
        let value = (tick / step / unit).round() * step;
        format!("{:.decimals$}", if value == 0.0 { 0.0 } else { value }).replace('-', "\u{2212}")
    };
    ticks.iter().map(text).collect()
}

pub(super) fn power_of_ten(exponent: i32) -> String {
    let digits: String = exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '\u{207b}',
            '1' => '\u{b9}',
            '2' => '\u{b2}',
            '3' => '\u{b3}',
            digit => char::from_u32(0x2070 + digit as u32 - '0' as u32).unwrap_or(digit),
        })
        .collect();
    format!("10{digits}")
}

/// Text for SVG and HTML.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_ticks_are_round_and_within_the_axis() {
        assert_eq!(
            ticks(0.0, 89.0, 9),
            [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0]
        );
        assert_eq!(ticks(-0.25, 0.25, 5), [-0.2, -0.1, 0.0, 0.1, 0.2]);
        assert_eq!(ticks(1.0, 1.0, 5), Vec::<f64>::new());
        assert_eq!(ticks(0.0, f64::NAN, 5), Vec::<f64>::new());
    }

    #[test]
    fn regress_numbers_of_an_axis() {
        assert_eq!(numbers(&[0.1 + 0.2, 0.35, 0.4], 1.0), ["0.30", "0.35", "0.40"]);
        assert_eq!(numbers(&[-20.0, -0.0, 20.0], 1.0), ["\u{2212}20", "0", "20"]);
        assert_eq!(numbers(&[0.0, 0.002, 0.004], 1e-3), ["0", "2", "4"]);
        assert_eq!(numbers(&[2e5], 1e3), ["200"]);
        assert_eq!(power_of_ten(-12), "10⁻¹²");
    }

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
