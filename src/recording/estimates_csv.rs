//! `estimates.csv`: one line per estimate, for any spreadsheet or script.
//!
//! Columns: `block,t_s,state,changed,use_ok,accepted,missing,rejected`, then each parameter by
//! name, then each `<name>_std`; then the evidence: `residual_<e>` and `fit_<e>` per equation,
//! counted from 1, `fit_probability`, each `<name>_excited` and `<name>_usable` (0 or 1); then each
//! derived value and its `_std`. `<name>_usable` is the parameter's own bit: it may be used if
//! `use_ok` is also 1. Numbers are written with enough digits to restore the same bits. A missing
//! standard deviation is an empty cell.

use crate::messages::{Estimate, State, estimate_flags};
use crate::node::monitor::{Label, seconds};
use std::io::{self, Write};

/// Writes `estimates.csv`.
pub struct EstimatesCsv<W: Write> {
    writer: csv::Writer<W>,
    parameters: usize,
    equations: usize,
    derived: usize,
    /// The last line of a continued file.
    before: Option<String>,
}

impl<W: Write> EstimatesCsv<W> {
    /// Starts a file with its header.
    ///
    /// # Errors
    /// If the sink cannot be written.
    pub fn new(sink: W, parameters: &[Label], equations: usize, derived: &[Label]) -> io::Result<Self> {
        let mut writer = csv::Writer::from_writer(sink);
        let fixed = [
            "block", "t_s", "state", "changed", "use_ok", "accepted", "missing", "rejected",
        ];
        let mut header: Vec<String> = fixed.map(String::from).to_vec();
        let named = |labels: &[Label], suffix: &str| -> Vec<String> {
            labels.iter().map(|label| format!("{}{suffix}", label.name)).collect()
        };
        let numbered = |name: &str| -> Vec<String> { (1..=equations).map(|e| format!("{name}_{e}")).collect() };
        header.extend(named(parameters, ""));
        header.extend(named(parameters, "_std"));
        header.extend(numbered("residual"));
        header.extend(numbered("fit"));
        header.push("fit_probability".to_string());
        header.extend(named(parameters, "_excited"));
        header.extend(named(parameters, "_usable"));
        header.extend(named(derived, ""));
        header.extend(named(derived, "_std"));
        writer.write_record(&header)?;
        writer.flush()?;
        Ok(Self {
            writer,
            parameters: parameters.len(),
            equations,
            derived: derived.len(),
            before: None,
        })
    }

    /// Continues a file that already has its header and ends with the line `before`. The bus gives
    /// a late joiner the last estimate again; if that is this line, it is not written twice.
    pub fn resume(sink: W, parameters: &[Label], equations: usize, derived: &[Label], before: &str) -> Self {
        Self {
            writer: csv::Writer::from_writer(sink),
            parameters: parameters.len(),
            equations,
            derived: derived.len(),
            before: Some(before.to_owned()),
        }
    }

    /// Appends one estimate and passes it to the operating system, so that a killed process leaves
    /// complete lines.
    ///
    /// # Errors
    /// If the sink cannot be written.
    pub fn write(&mut self, estimate: &Estimate) -> io::Result<()> {
        let state = State::from_wire(estimate.state).map_or("unknown", State::name);
        let flag = |set: bool| if set { "1" } else { "0" }.to_string();
        let mut record = vec![
            estimate.block.to_string(),
            seconds(estimate.t_last_ns).to_string(),
            state.to_string(),
            flag(estimate.flags & estimate_flags::CHANGED != 0),
            flag(estimate.use_ok != 0),
            estimate.accepted.to_string(),
            estimate.missing.to_string(),
            estimate.rejected.to_string(),
        ];
        let known = |value: &f64| {
            if value.is_finite() {
                value.to_string()
            } else {
                String::new()
            }
        };
        record.extend(estimate.theta[..self.parameters].iter().map(known));
        record.extend(estimate.theta_std[..self.parameters].iter().map(known));
        record.extend(estimate.residual_rms[..self.equations].iter().map(known));
        record.extend(estimate.fit[..self.equations].iter().map(known));
        record.push(known(&estimate.fit_probability));
        for mask in [estimate.excited, estimate.usable] {
            record.extend((0..self.parameters).map(|i| flag(mask.contains(i))));
        }
        record.extend(estimate.derived[..self.derived].iter().map(known));
        record.extend(estimate.derived_std[..self.derived].iter().map(known));
        if self.before.take().is_some_and(|line| line == record.join(",")) {
            return Ok(());
        }
        self.writer.write_record(&record)?;
        self.writer.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::monitor::tests::{estimate, monitor};

    #[test]
    fn prop_a_table_gone_on_with_repeats_neither_header_nor_last_line() {
        let monitor = monitor();
        let mut sink = Vec::new();
        let mut csv = EstimatesCsv::new(&mut sink, monitor.parameters(), 1, monitor.derived()).unwrap();
        csv.write(&estimate(7, 1.0)).unwrap();
        drop(csv);
        let before = String::from_utf8(sink.clone()).unwrap();
        let last = before.lines().last().unwrap();
        let mut csv = EstimatesCsv::resume(&mut sink, monitor.parameters(), 1, monitor.derived(), last);
        for block in [7, 8, 8] {
            csv.write(&estimate(block, 1.0)).unwrap();
        }
        drop(csv);
        let text = String::from_utf8(sink).unwrap();
        let blocks: Vec<&str> = text.lines().filter_map(|line| line.split(',').next()).collect();
        // Only the last line of the earlier writer is a repetition.
        assert_eq!(blocks, ["block", "7", "8", "8"]);
    }

    #[test]
    fn regress_the_columns_are_the_contract_and_numbers_come_back_to_the_bit() {
        let monitor = monitor();
        let mut sink = Vec::new();
        let theta = 0.1 + 0.2;
        let mut csv = EstimatesCsv::new(&mut sink, monitor.parameters(), 1, monitor.derived()).unwrap();
        csv.write(&estimate(24, theta)).unwrap();
        drop(csv);
        let text = String::from_utf8(sink).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "block,t_s,state,changed,use_ok,accepted,missing,rejected,mass,mass_std,\
             residual_1,fit_1,fit_probability,mass_excited,mass_usable"
        );
        let cells: Vec<&str> = lines[1].split(',').collect();
        assert_eq!(cells[0], "24");
        assert_eq!(cells[2], "converging");
        assert_eq!(cells[8].parse::<f64>().unwrap().to_bits(), theta.to_bits());
        assert_eq!(cells[9], "", "a deviation that is not known is an empty cell");
        assert_eq!(cells[10..], ["0", "1", "1", "1", "0"]);
    }
}
