//! One line of text: per block in a log, or in place on a terminal.

use super::view::View;
use std::fmt::Write as _;

/// Column after which a line shows no more values.
const COLUMNS: usize = 150;

/// A line of a log: block, time, state, number of usable parameters, values, problems. Values that
/// are not usable come last, with a question mark.
pub fn block_line(view: &View, changed_t_s: Option<f64>) -> String {
    let mut line = format!(
        "block {:>4}  {:>9.3} s  {:<13} {}/{} usable",
        view.block, view.t_s, view.state, view.usable, view.parameters
    );
    if let Some(t_s) = changed_t_s {
        let _ = write!(line, "  changed at {t_s:.3} s");
    }
    // Derived values first, because users know them by name.
    let of = |derived: bool, usable: bool| {
        let rows = view.rows.iter();
        rows.filter(move |row| row.derived == derived && (row.usable || row.fixed) == usable)
    };
    let usable = of(true, true).chain(of(false, true));
    let others = of(false, false).chain(of(true, false));
    let mut left = 0;
    for row in usable.chain(others).filter(|row| row.value.is_finite()) {
        let mut value = format!("  {}={}", row.name, row.value_text);
        if !row.std_text.is_empty() {
            let _ = write!(value, "±{}", row.std_text);
        }
        if !row.unit.is_empty() {
            let _ = write!(value, " {}", row.unit);
        }
        if !row.usable && !row.fixed {
            value.push('?');
        }
        match left == 0 && line.chars().count() + value.chars().count() <= COLUMNS {
            true => line.push_str(&value),
            false => left += 1,
        }
    }
    if left > 0 {
        let _ = write!(line, "  and {left} more");
    }
    if view.state == "misfit" {
        let _ = write!(line, "  [{}]", view.words);
    }
    if !view.lacks.is_empty() {
        let _ = write!(line, "  [{}]", view.lacks);
    }
    if view.missing.saturating_add(view.rejected) > 0 {
        let _ = write!(line, "  [missing {}, rejected {}]", view.missing, view.rejected);
    }
    line
}

/// State and headline in at most `columns` columns.
pub fn progress_line(view: &View, columns: usize) -> String {
    let text = format!("{}  {}", view.state, view.headline);
    cut(&text, columns)
}

/// The beginning of a text that fits.
pub(super) fn cut(text: &str, columns: usize) -> String {
    if text.chars().count() <= columns {
        return text.to_owned();
    }
    let mut short: String = text.chars().take(columns.saturating_sub(1)).collect();
    if columns > 0 {
        short.push('…');
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::state::tests::{known, state};

    #[test]
    fn regress_a_block_is_one_readable_line() {
        let mut state = state();
        state.on_estimate(&known(45, 170.0412, 0.0387), None, 1);
        let line = block_line(&state.view(1), Some(44.99));
        assert_eq!(
            line,
            "block   45     44.999 s  converged     1/1 usable  changed at 44.990 s  inertia=340.08±0.08 kg·m²  mass=170.04±0.04 kg"
        );
    }

    #[test]
    fn regress_the_longest_state_does_not_touch_what_follows() {
        let mut state = state();
        let mut message = known(1, 170.0, 0.04);
        message.state = crate::messages::State::PoorlyExcited as u32;
        state.on_estimate(&message, None, 1);
        let line = block_line(&state.view(1), None);
        assert!(line.contains(" poorly_excited 1/1 usable"), "{line}");
    }

    #[test]
    fn regress_what_may_not_be_used_has_a_question_mark() {
        let mut state = state();
        let mut message = known(1, 170.0412, 0.0387);
        message.use_ok = 0;
        state.on_estimate(&message, None, 1);
        let line = block_line(&state.view(1), None);
        assert!(
            line.ends_with("0/1 usable  mass=170.04±0.04 kg?  inertia=340.08±0.08 kg·m²?"),
            "{line}"
        );
    }

    #[test]
    fn prop_a_line_in_place_fits_whatever_the_width() {
        let mut state = state();
        state.on_estimate(&known(1, 170.0, 0.04), None, 1);
        let view = state.view(1);
        for columns in 0..100 {
            assert!(progress_line(&view, columns).chars().count() <= columns);
        }
        assert_eq!(progress_line(&view, 200), "converged  inertia: 340.00 ± 0.08 kg·m²");
    }
}
