//! Setpoints from a CSV file: columns `t_s`, `q1_rad`, `q2_rad`, times rising.

use super::kind::Len;
use std::path::Path;

/// Times \[s\] and for each joint the commanded positions \[rad\].
pub(super) struct Columns {
    pub t_s: Vec<f64>,
    pub q_rad: [Vec<f64>; Len::ARM_JOINTS],
}

const HEADER: [&str; 1 + Len::ARM_JOINTS] = ["t_s", "q1_rad", "q2_rad"];

/// Reads the file; further columns are ignored, `#` begins a comment line.
///
/// The error is a sentence that names the line.
pub(super) fn read(path: &Path) -> Result<Columns, String> {
    let name = path.display();
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_path(path)
        .map_err(|e| format!("{name} cannot be read: {e}"))?;
    let headers = reader.headers().map_err(|e| format!("{name}: {e}"))?.clone();
    let mut index = [0; HEADER.len()];
    for (index, wanted) in index.iter_mut().zip(HEADER) {
        *index = headers.iter().position(|h| h == wanted).ok_or_else(|| {
            format!(
                "{name}:1: expected the columns {}, got {}",
                HEADER.join(", "),
                headers.iter().collect::<Vec<_>>().join(", ")
            )
        })?;
    }
    let mut columns = Columns {
        t_s: Vec::new(),
        q_rad: Default::default(),
    };
    for record in reader.records() {
        let record = record.map_err(|e| format!("{name}: {e}"))?;
        let line = record.position().map_or(0, csv::Position::line);
        let mut row = [0.0; HEADER.len()];
        for ((value, index), column) in row.iter_mut().zip(index).zip(HEADER) {
            let text = record.get(index).unwrap_or("");
            *value = text
                .parse()
                .ok()
                .filter(|x: &f64| x.is_finite())
                .ok_or_else(|| format!("{name}:{line}: {column}: expected a finite number, got \"{text}\""))?;
        }
        if let Some(last) = columns.t_s.last().filter(|last| row[0] <= **last) {
            return Err(format!(
                "{name}:{line}: t_s: expected a time after {last}, got {}",
                row[0]
            ));
        }
        columns.t_s.push(row[0]);
        columns
            .q_rad
            .iter_mut()
            .zip(&row[1..])
            .for_each(|(column, value)| column.push(*value));
    }
    if columns.t_s.is_empty() {
        return Err(format!("{name}: expected at least one row, got none"));
    }
    Ok(columns)
}
