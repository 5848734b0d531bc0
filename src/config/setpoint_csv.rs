//! Setpoints from a CSV file: columns `t_s`, `q1_rad`, `q2_rad`, with increasing times.

use super::kind::MAX_ROWS_BYTES;
use super::words::cut;
use crate::pipe::{MAX_TABLE_BYTES, read_text};
use crate::sim::ARM_JOINTS;
use std::fmt::Write as _;
use std::path::Path;

/// Times \[s\] and for each joint the commanded positions \[rad\].
#[derive(Default)]
pub(super) struct Columns {
    pub t_s: Vec<f64>,
    pub q_rad: [Vec<f64>; ARM_JOINTS],
}

const HEADER: [&str; 1 + ARM_JOINTS] = ["t_s", "q1_rad", "q2_rad"];

/// Longest part of a file shown in a message.
const SHOWN: usize = 60;

impl Columns {
    /// Converts to lines of numbers with all digits.
    pub(super) fn to_rows(&self) -> String {
        let mut text = String::new();
        for (row, t_s) in self.t_s.iter().enumerate() {
            let _ = write!(text, "{t_s:?}");
            for column in &self.q_rad {
                let _ = write!(text, " {:?}", column[row]);
            }
            text.push('\n');
        }
        text
    }

    /// Parses the output of [`to_rows`](Self::to_rows).
    ///
    /// The error is a sentence that names the row.
    pub(super) fn from_rows(text: &str) -> Result<Self, String> {
        let mut columns = Self::default();
        let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        for (index, line) in lines {
            let numbers: Vec<f64> = line
                .split_whitespace()
                .take(HEADER.len() + 1)
                .filter_map(|word| word.parse().ok().filter(|x: &f64| x.is_finite()))
                .collect();
            let row = <[f64; HEADER.len()]>::try_from(numbers).map_err(|_| {
                format!(
                    "row {}: expected the finite numbers {}, got \"{}\"",
                    index + 1,
                    HEADER.join(" "),
                    cut(line.trim(), SHOWN)
                )
            })?;
            columns.push(row).map_err(|e| format!("row {}: {e}", index + 1))?;
        }
        match columns.t_s.is_empty() {
            true => Err("expected at least one row, got none".to_owned()),
            false => Ok(columns),
        }
    }

    fn push(&mut self, row: [f64; HEADER.len()]) -> Result<(), String> {
        if let Some(last) = self.t_s.last().filter(|last| row[0] <= **last) {
            return Err(format!("t_s: expected a time after {last}, got {}", row[0]));
        }
        self.t_s.push(row[0]);
        self.q_rad
            .iter_mut()
            .zip(&row[1..])
            .for_each(|(column, value)| column.push(*value));
        Ok(())
    }
}

/// Reads the file; further columns are ignored, `#` begins a comment line.
///
/// The error is a sentence that names the line.
pub(super) fn read(path: &Path) -> Result<Columns, String> {
    let name = path.display();
    let unreadable = |e: &dyn std::fmt::Display| format!("{name} cannot be read: {e}");
    let found = std::fs::metadata(path).map_err(|e| unreadable(&e))?;
    // A pipe would wait for a writer, and a device never ends.
    if !found.is_file() {
        return Err(format!("{name}: expected a file, got a directory, pipe or device"));
    }
    let text = read_text(path, MAX_TABLE_BYTES).map_err(|e| format!("{name}: {e}"))?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let headers = reader.headers().map_err(|e| format!("{name}: {e}"))?.clone();
    let mut index = [0; HEADER.len()];
    for (index, wanted) in index.iter_mut().zip(HEADER) {
        *index = headers.iter().position(|h| h == wanted).ok_or_else(|| {
            let got: Vec<&str> = headers.iter().take(SHOWN).collect();
            format!(
                "{name}:1: expected the columns {}, got {}",
                HEADER.join(", "),
                cut(&got.join(", "), SHOWN)
            )
        })?;
    }
    let mut columns = Columns::default();
    for record in reader.records() {
        let record = record.map_err(|e| format!("{name}: {e}"))?;
        let line = record.position().map_or(0, csv::Position::line);
        let mut row = [0.0; HEADER.len()];
        for ((value, index), column) in row.iter_mut().zip(index).zip(HEADER) {
            let text = record.get(index).unwrap_or("");
            *value = text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| {
                let text = cut(text, SHOWN);
                format!("{name}:{line}: {column}: expected a finite number, got \"{text}\"")
            })?;
        }
        columns.push(row).map_err(|e| format!("{name}:{line}: {e}"))?;
    }
    if columns.t_s.is_empty() {
        return Err(format!("{name}: expected at least one row, got none"));
    }
    let bytes = columns.to_rows().len();
    if bytes > MAX_ROWS_BYTES {
        return Err(format!(
            "{name}: expected numbers of at most {MAX_ROWS_BYTES} bytes in all, since a recording keeps them, got {bytes}; thin the rows out or round their numbers"
        ));
    }
    Ok(columns)
}
