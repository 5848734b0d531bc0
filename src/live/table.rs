//! The table in a terminal: 80 columns by 24 lines or more, redrawn in place.

use super::line::cut;
use super::quantity::{About, Quantity};
use super::view::{Health, Row, View};
use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Cell, Paragraph, Row as TableRow, Table};

/// Lines above the table: title, headline, state, empty line.
const ABOVE: u16 = 4;
/// Lines below it: empty line, samples, identifier, keys.
const BELOW: u16 = 4;
/// Width from which there is room for meanings.
const WIDE: u16 = 100;

/// Context of a table besides the view.
#[derive(Debug, Clone, Copy)]
pub struct TableContext<'a> {
    /// The machine and model.
    pub about: &'a About,
    /// Meanings, in the order of the rows.
    pub quantities: &'a [Quantity],
    /// Number of rows above the visible part, if not all fit.
    pub scroll: usize,
    /// Whether colours may be used; `NO_COLOR` disables them.
    pub colours: bool,
    /// The answer to the last key; empty if there was none.
    pub answer: &'a str,
}

/// Draws a view; returns the largest useful number of rows to scroll by.
pub fn draw(frame: &mut Frame<'_>, view: &View, about: &TableContext<'_>) -> usize {
    let area = frame.area();
    let paint = Paint(about.colours);
    let width = area.width as usize;
    let line = |y: u16| Rect::new(0, y, area.width, 1).intersection(area);

    let state = format!("{} {}", mark(view.health), view.state);
    let title = format!("{}, {}", about.about.robot, about.about.model);
    let title = cut(&title, width.saturating_sub(state.chars().count() + 2));
    let gap = width.saturating_sub(title.chars().count() + state.chars().count());
    let title = Line::from(vec![
        Span::styled(title, Style::new().add_modifier(Modifier::BOLD)),
        Span::raw(" ".repeat(gap)),
        Span::styled(state, paint.health(view.health)),
    ]);
    frame.render_widget(Paragraph::new(title), line(0));
    let bold = Style::new().add_modifier(Modifier::BOLD);
    frame.render_widget(Paragraph::new(cut(&view.headline, width)).style(bold), line(1));
    frame.render_widget(Paragraph::new(cut(&view.words, width)), line(2));

    let room = area.height.saturating_sub(ABOVE + BELOW);
    let body = Rect::new(0, ABOVE, area.width, room).intersection(area);
    // The header takes one line.
    let rows = room.saturating_sub(1) as usize;
    let most = view.rows.len().saturating_sub(rows);
    let scroll = about.scroll.min(most);
    frame.render_widget(table(view, about, scroll, rows, area.width, paint), body);

    let below = area.height.saturating_sub(BELOW);
    let hidden = match most {
        0 => String::new(),
        _ => format!(
            "rows {} to {} of {}, ↑ ↓ move",
            scroll + 1,
            (scroll + rows).min(view.rows.len()),
            view.rows.len()
        ),
    };
    let lines = [hidden, samples(view), identifier(view), keys(view, about.answer)];
    for (y, text) in (below..).zip(lines) {
        frame.render_widget(Paragraph::new(cut(&text, width)).style(paint.soft()), line(y));
    }
    most
}

fn table<'a>(
    view: &'a View,
    about: &TableContext<'a>,
    scroll: usize,
    rows: usize,
    width: u16,
    paint: Paint,
) -> Table<'a> {
    let wide = width >= WIDE;
    let shown = view.rows.iter().enumerate().skip(scroll).take(rows);
    let lines = shown.map(|(index, row)| {
        let mut cells = vec![
            Cell::from(row.name.as_str()),
            Cell::from(Line::from(row.value_text.as_str()).right_aligned()),
            Cell::from(standard_deviation(row)),
            Cell::from(row.unit.as_str()),
            Cell::from(row.trend.arrow()),
            Cell::from(row.note()).style(paint.note(row)),
        ];
        if wide {
            let meaning = about
                .quantities
                .get(index)
                .map_or("", |quantity| quantity.meaning.as_str());
            cells.push(Cell::from(meaning).style(paint.soft()));
        }
        TableRow::new(cells)
    });
    let mut header = vec!["value", "estimate", "± std", "unit", "", "may be used"];
    let mut widths = vec![
        Constraint::Min(16),
        Constraint::Length(14),
        Constraint::Length(12),
        Constraint::Length(12),
        Constraint::Length(1),
        Constraint::Length(12),
    ];
    if wide {
        header.push("meaning");
        widths[0] = Constraint::Length(20);
        widths.push(Constraint::Min(10));
    }
    let header = header.into_iter().enumerate().map(|(column, text)| match column {
        1 => Cell::from(Line::from(text).right_aligned()),
        _ => Cell::from(text),
    });
    Table::new(lines, widths)
        .header(TableRow::new(header).style(paint.soft().add_modifier(Modifier::UNDERLINED)))
        .column_spacing(1)
}

fn standard_deviation(row: &Row) -> String {
    match row.std_text.is_empty() {
        true => String::new(),
        false => format!("± {}", row.std_text),
    }
}

fn mark(health: Health) -> &'static str {
    match health {
        Health::Good => "●",
        Health::Wait => "○",
        Health::Warn => "▲",
        Health::Bad => "✖",
    }
}

fn samples(view: &View) -> String {
    let mut text = format!("{} samples", view.accepted);
    if view.samples_per_s.is_finite() {
        text.push_str(&format!(", {:.0}/s", view.samples_per_s));
    }
    text.push_str(&format!("; {} missing, {} rejected", view.missing, view.rejected));
    if view.block > 0 {
        text.push_str(&format!("; block {} at {:.3} s", view.block, view.t_s));
    }
    if let Some(t_s) = view.changes.last() {
        text.push_str(&format!("; last change at {t_s:.3} s"));
    }
    text
}

fn identifier(view: &View) -> String {
    if !view.heartbeat_s.is_finite() {
        return "no identifier heard yet".into();
    }
    let mut text = format!("heartbeat {:.1} s ago", view.heartbeat_s);
    if view.step.mean_us > 0.0 {
        text.push_str(&format!(
            "; sample {:.1} µs, at most {:.0}; block {:.0} µs, at most {:.0}",
            view.step.mean_us, view.step.max_us, view.block_step.mean_us, view.block_step.max_us
        ));
    }
    if !view.error.is_empty() {
        text.push_str(&format!("; last: {}", view.error));
    }
    text
}

fn keys(view: &View, answer: &str) -> String {
    let keys = if view.paused {
        "q quit   r resume"
    } else {
        "q quit   p pause"
    };
    match answer.is_empty() {
        true => keys.to_owned(),
        false => format!("{keys}   {answer}"),
    }
}

/// Styles; without colours only weight and underline remain.
#[derive(Debug, Clone, Copy)]
struct Paint(bool);

impl Paint {
    fn colour(self, colour: Color) -> Style {
        match self.0 {
            true => Style::new().fg(colour),
            false => Style::new(),
        }
    }

    fn soft(self) -> Style {
        self.colour(Color::DarkGray)
    }

    fn health(self, health: Health) -> Style {
        let colour = match health {
            Health::Good => Color::Green,
            Health::Wait => Color::Cyan,
            Health::Warn => Color::Yellow,
            Health::Bad => Color::Red,
        };
        self.colour(colour).add_modifier(Modifier::BOLD)
    }

    fn note(self, row: &Row) -> Style {
        match (row.fixed, row.usable) {
            (true, _) => self.colour(Color::Cyan),
            (_, true) => self.colour(Color::Green),
            _ => self.soft(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::LiveState;
    use crate::live::state::tests::{known, state};
    use crate::messages::{MAX_DERIVED, Status};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    const S: u64 = 1_000_000_000;

    /// The text on a screen of this size.
    fn screen(
        state: &LiveState,
        (width, height): (u16, u16),
        scroll: usize,
        colours: bool,
    ) -> (Vec<String>, Terminal<TestBackend>) {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        let view = state.view(10 * S);
        let about = TableContext {
            about: state.about(),
            quantities: state.quantities(),
            scroll,
            colours,
            answer: "",
        };
        terminal.draw(|frame| _ = draw(frame, &view, &about)).unwrap();
        let buffer = terminal.backend().buffer();
        let line = |y: u16| {
            (0..width)
                .map(|x| buffer[(x, y)].symbol())
                .collect::<String>()
                .trim_end()
                .to_owned()
        };
        let lines = (0..height).map(line).collect();
        (lines, terminal)
    }

    /// The largest number of quantities of an estimate, with the longest names and units.
    fn crowd() -> LiveState {
        let quantity = |index: usize| {
            let meaning = "viscous friction of the joint's gear and motor, seen from the joint";
            Quantity::new(&format!("viscous_friction_{index}"), "kg m^2", meaning)
        };
        let parameters = (0..40).map(quantity).collect();
        let derived = (40..40 + MAX_DERIVED).map(quantity).collect();
        let mut state = LiveState::new(state().about().clone(), parameters, derived);
        let mut wild = known(4711, 0.0, 1.0);
        wild.params = 40;
        wild.derived_len = MAX_DERIVED as u32;
        for index in 0..40 {
            wild.theta[index] = -1.234_567e-7 * 10f64.powi(index as i32);
            wild.theta_std[index] = wild.theta[index].abs() * 1e-3;
        }
        state.on_estimate(&wild, None, 9 * S);
        let mut status = Status {
            stream_id: 1,
            accepted: u64::MAX,
            missing: u64::MAX,
            ..Status::default()
        };
        status.error =
            crate::messages::LastError::with_text(crate::messages::ErrorCode::Refused, 0, &"words ".repeat(18));
        state.on_status(&status, 9 * S);
        state
    }

    #[test]
    fn regress_the_table_at_80_by_24() {
        let mut state = state();
        for block in 1..=9 {
            state.on_estimate(&known(block, 170.0412, 0.0387), None, block * S);
        }
        let (lines, _) = screen(&state, (80, 24), 0, true);
        let expected = [
            "inertia: 340.08 ± 0.08 kg·m²",
            "waiting for an identifier",
            "",
            "value                          estimate ± std        unit           may be used",
            "mass                             170.04 ± 0.04       kg           → usable",
            "inertia                          340.08 ± 0.08       kg·m²        → usable",
        ];
        assert_eq!(lines[1..7], expected, "{lines:#?}");
        assert!(lines[0].starts_with("arm, test  ") && lines[0].ends_with("○ converged"));
        assert_eq!(lines[0].chars().count(), 80);
        assert!(lines[23].starts_with("q quit"));
    }

    #[test]
    fn prop_no_line_is_broken_whatever_the_size_and_the_numbers() {
        let state = crowd();
        for size in [(80, 24), (120, 40), (200, 60), (40, 10), (20, 5), (1, 1), (80, 3)] {
            let (lines, _) = screen(&state, size, 0, true);
            assert_eq!(lines.len(), size.1 as usize);
            if size.0 >= 80 && size.1 >= 24 {
                // Each row ends with its note, and no value runs into the next column.
                let rows: Vec<&String> = lines
                    .iter()
                    .skip(4)
                    .filter(|line| line.starts_with("viscous"))
                    .collect();
                assert_eq!(rows.len(), (size.1 as usize - 9).min(40 + MAX_DERIVED), "{lines:#?}");
                for row in rows.iter().take(8) {
                    assert!(row.contains("± ") && row.contains("kg·m²"), "{row}");
                }
            }
        }
        // Rows that do not fit are reached by scrolling, but no further.
        let (lines, _) = screen(&state, (80, 24), 1000, true);
        assert!(
            lines
                .iter()
                .any(|line| line.starts_with(&format!("viscous_friction_{}", 39 + MAX_DERIVED))),
            "{lines:#?}"
        );
        let all = 40 + MAX_DERIVED;
        let hidden = format!("rows {} to {all} of {all}", all - 14);
        assert!(lines[20].starts_with(&hidden), "{}", lines[20]);
    }

    #[test]
    fn prop_without_colours_there_are_none() {
        let (_, terminal) = screen(&crowd(), (80, 24), 0, false);
        let cells = terminal.backend().buffer().content();
        assert!(
            cells
                .iter()
                .all(|cell| cell.fg == Color::Reset && cell.bg == Color::Reset)
        );
        let (_, terminal) = screen(&crowd(), (80, 24), 0, true);
        let cells = terminal.backend().buffer().content();
        assert!(cells.iter().any(|cell| cell.fg == Color::Cyan));
    }
}
