//! Tables with their headings, as Markdown for `docs/` and as plain data for other programs.

use std::fmt::{self, Write as _};

/// A result with headings, explanations and tables.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Document {
    /// Title.
    pub title: String,
    /// What the page is for, in a sentence.
    pub purpose: String,
    /// Sections in order.
    pub sections: Vec<Section>,
}

/// A heading, paragraphs, and a table.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Section {
    /// Heading.
    pub heading: String,
    /// Paragraphs before the table.
    pub text: Vec<String>,
    /// The table; may be without rows.
    pub table: Table,
}

/// Cells as text.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct Table {
    /// Heads of the columns.
    pub columns: Vec<String>,
    /// Rows, each as long as `columns`.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows yet.
    pub fn new(columns: &[&str]) -> Self {
        Self {
            columns: columns.iter().map(|&column| column.to_owned()).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row; one cell per column.
    pub fn push(&mut self, row: Vec<String>) {
        debug_assert_eq!(row.len(), self.columns.len());
        self.rows.push(row);
    }
}

impl fmt::Display for Table {
    /// Markdown with aligned columns; numbers to the right.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let length = |text: &str| text.chars().count();
        let widths: Vec<usize> = (0..self.columns.len())
            .map(|c| {
                self.rows
                    .iter()
                    .map(|row| length(&row[c]))
                    .chain([length(&self.columns[c]), 3])
                    .max()
                    .unwrap_or(3)
            })
            .collect();
        let line = |f: &mut fmt::Formatter<'_>, cells: &[String]| -> fmt::Result {
            for (c, (cell, width)) in cells.iter().zip(&widths).enumerate() {
                let pad = " ".repeat(width - length(cell));
                if c == 0 {
                    write!(f, "| {cell}{pad} ")?
                } else {
                    write!(f, "| {pad}{cell} ")?
                }
            }
            writeln!(f, "|")
        };
        line(f, &self.columns)?;
        for (c, width) in widths.iter().enumerate() {
            let dashes = "-".repeat(width + 1);
            if c == 0 {
                write!(f, "|:{dashes}")?
            } else {
                write!(f, "|{dashes}:")?
            }
        }
        writeln!(f, "|")?;
        self.rows.iter().try_for_each(|row| line(f, row))
    }
}

impl fmt::Display for Section {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "## {}\n", self.heading)?;
        for paragraph in &self.text {
            writeln!(f, "{paragraph}\n")?;
        }
        if !self.table.rows.is_empty() {
            writeln!(f, "{}", self.table)?;
        }
        Ok(())
    }
}

impl Document {
    /// Markdown; `command` generates it.
    pub fn markdown(&self, command: &str) -> String {
        let (title, purpose) = (&self.title, &self.purpose);
        let mut text = format!("# {title}\n\n{purpose}\n\nMade by `{command}`; do not edit.\n\n");
        for section in &self.sections {
            let _ = write!(text, "{section}");
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
        text
    }
}

/// A share in per cent with two significant digits: `13 %`, `0.021 %`; below 1e-6 % it is called
/// rounding.
pub fn percent(share: f64) -> String {
    if share.is_infinite() {
        return "inf".to_owned();
    }
    if share > 0.0 && share < 1e-8 {
        return "< 1e-6 %".to_owned();
    }
    format!("{} %", two_digits(share * 100.0))
}

/// A number with two significant digits.
pub fn two_digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    // Rounded to two digits first, so that 9.96 counts as 10 and not as 9.96.
    let rounded: f64 = format!("{value:.1e}").parse().unwrap_or(value);
    let exponent = rounded.abs().log10().floor() as i32;
    match exponent {
        ..=-4 => format!("{value:.0e}"),
        -3..=0 => format!("{rounded:.*}", (1 - exponent) as usize),
        1..=4 => format!("{rounded:.0}"),
        5.. => format!("{value:.0e}"),
    }
}

/// A count, or a dash for none.
pub fn count(value: Option<usize>) -> String {
    value.map_or("–".to_owned(), |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_numbers_keep_two_digits() {
        let cases = [
            (0.0, "0"),
            (13.3, "13"),
            (9.96, "10"),
            (0.996, "1.0"),
            (1.0, "1.0"),
            (0.0214, "0.021"),
            (3.2e-9, "3e-9"),
            (123.4, "120"),
        ];
        for (value, text) in cases {
            assert_eq!(two_digits(value), text);
        }
        assert_eq!(percent(0.133), "13 %");
        assert_eq!(percent(3e-12), "< 1e-6 %");
        assert_eq!(percent(f64::INFINITY), "inf");
        assert_eq!(count(None), "–");
    }

    #[test]
    fn regress_a_document_renders_as_markdown() {
        let mut table = Table::new(&["name", "θ"]);
        table.push(vec!["a".to_owned(), "1.5".to_owned()]);
        let section = Section {
            heading: "Part".to_owned(),
            text: vec!["Words.".to_owned()],
            table,
        };
        let document = Document {
            title: "Title".to_owned(),
            purpose: "A page.".to_owned(),
            sections: vec![section],
        };
        let expected = "# Title\n\nA page.\n\nMade by `cmd`; do not edit.\n\n## Part\n\nWords.\n\n| name |   θ |\n|:-----|----:|\n| a    | 1.5 |\n";
        assert_eq!(document.markdown("cmd"), expected);
    }
}
