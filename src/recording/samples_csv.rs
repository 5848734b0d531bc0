//! Samples as CSV, the unit in each column's name: `seq,t_ns,flags,signals,q_1_rad,…,input_2_v`.
//!
//! Numbers are written with enough digits to restore the same bits; an unmeasured signal is an
//! empty cell.

use super::info::RunInfo;
use super::layout::field_name;
use crate::messages::{SIGNALS, Sample};
use std::io::{self, Read, Write};

/// Writes samples as CSV.
pub struct SamplesCsv<W: Write> {
    writer: csv::Writer<W>,
    joints: usize,
    record: csv::ByteRecord,
}

/// Why samples cannot be read from CSV.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CsvSampleError {
    /// Not CSV, or the source fails.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// A different header.
    #[error("line 1: expected the columns {expected}, got {got}")]
    Header {
        /// The columns of this plant.
        expected: String,
        /// The columns of the file.
        got: String,
    },
    /// A cell that is not a number.
    #[error("line {line}, column {column}: expected a number, got {got:?}")]
    Cell {
        /// Line of the file, from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// Its content.
        got: String,
    },
}

fn header(joints: usize, position_unit: &str, input_unit: &str) -> Vec<String> {
    let mut header: Vec<String> = ["seq", "t_ns", "flags", "signals"].map(String::from).to_vec();
    for signal in SIGNALS {
        let unit = signal.unit.replace("{position}", position_unit);
        let unit = unit
            .replace("{input}", input_unit)
            .replace('/', "_per_")
            .replace('^', "");
        header.extend((1..=joints).map(|j| format!("{}_{j}_{}", signal.name, field_name(&unit))));
    }
    header
}

impl<W: Write> SamplesCsv<W> {
    /// Starts a file with its header.
    ///
    /// # Errors
    /// If the sink cannot be written.
    pub fn new(sink: W, info: &RunInfo) -> io::Result<Self> {
        let mut writer = csv::Writer::from_writer(sink);
        writer.write_record(header(info.joints, &info.position_unit, &info.input_unit))?;
        Ok(Self {
            writer,
            joints: info.joints,
            record: csv::ByteRecord::new(),
        })
    }

    /// Appends a sample.
    ///
    /// # Errors
    /// If the sink cannot be written.
    pub fn write(&mut self, sample: &Sample) -> io::Result<()> {
        self.record.clear();
        for value in [
            sample.seq,
            sample.t_ns,
            u64::from(sample.flags),
            u64::from(sample.signals),
        ] {
            self.record.push_field(value.to_string().as_bytes());
        }
        for (signal, values) in SIGNALS.iter().zip(sample.arrays()) {
            let known = sample.signals & signal.flag != 0;
            for value in &values[..self.joints] {
                let cell = if known { value.to_string() } else { String::new() };
                self.record.push_field(cell.as_bytes());
            }
        }
        Ok(self.writer.write_byte_record(&self.record)?)
    }

    /// Flushes the output.
    ///
    /// # Errors
    /// If the sink cannot be written.
    pub fn finish(mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

/// Largest number of bytes read for one row, so that an endless line cannot fill the memory.
const MAX_ROW_BYTES: usize = 1 << 20;
/// Longest part of a file shown in an error \[characters\].
const SHOWN: usize = 300;

/// A source that fails if too much is read for one row.
struct Bounded<R> {
    source: R,
    since_row: usize,
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.since_row > MAX_ROW_BYTES {
            let message = format!("expected rows of at most {MAX_ROW_BYTES} bytes, got a longer one");
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        let read = self.source.read(buffer)?;
        self.since_row += read;
        Ok(read)
    }
}

fn cut(text: &str) -> String {
    crate::words::cut(text, SHOWN)
}

/// Reads what [`SamplesCsv`] wrote, sample by sample; `stream_id` is 0.
pub struct SamplesCsvReader<R> {
    reader: csv::Reader<Bounded<R>>,
    columns: Vec<String>,
    joints: usize,
    record: csv::StringRecord,
}

impl<R: Read> SamplesCsvReader<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// If the header is that of another plant.
    pub fn new(source: R, info: &RunInfo) -> Result<Self, CsvSampleError> {
        Self::of_units(source, info.joints, &info.position_unit, &info.input_unit)
    }

    /// The same for a plant with this number of joints and these units.
    ///
    /// # Errors
    /// See [`new`](Self::new).
    pub fn of_units(source: R, joints: usize, position_unit: &str, input_unit: &str) -> Result<Self, CsvSampleError> {
        let mut reader = csv::Reader::from_reader(Bounded { source, since_row: 0 });
        let columns = header(joints, position_unit, input_unit);
        let got: Vec<String> = reader.headers()?.iter().map(String::from).collect();
        if got != columns {
            return Err(CsvSampleError::Header {
                expected: columns.join(","),
                got: cut(&got.join(",")),
            });
        }
        Ok(Self {
            reader,
            columns,
            joints,
            record: csv::StringRecord::new(),
        })
    }

    /// The next sample; `None` at the end.
    ///
    /// # Errors
    /// If a row has a wrong number of cells, or a cell is not a number; with line and column.
    pub fn next_sample(&mut self) -> Result<Option<Sample>, CsvSampleError> {
        self.reader.get_mut().since_row = 0;
        if !self.reader.read_record(&mut self.record)? {
            return Ok(None);
        }
        let record = &self.record;
        let cell = |column: usize| record.get(column).unwrap_or_default();
        let bad = |column: usize| CsvSampleError::Cell {
            line: record.position().map_or(0, csv::Position::line),
            column: self.columns[column].clone(),
            got: cut(cell(column)),
        };
        let integer = |column: usize| cell(column).parse::<u64>().map_err(|_| bad(column));
        let small = |column: usize| u32::try_from(integer(column)?).map_err(|_| bad(column));
        let mut sample = Sample::EMPTY;
        (sample.seq, sample.t_ns) = (integer(0)?, integer(1)?);
        (sample.flags, sample.signals) = (small(2)?, small(3)?);
        sample.joints = self.joints as u32;
        let mut column = 4;
        let given = sample.signals;
        for (signal, values) in SIGNALS.iter().zip(sample.arrays_mut()) {
            let known = given & signal.flag != 0;
            for value in &mut values[..self.joints] {
                if known {
                    *value = cell(column).parse().map_err(|_| bad(column))?;
                }
                column += 1;
            }
        }
        Ok(Some(sample))
    }
}

/// True if a file with this beginning was written by [`SamplesCsv`].
pub fn is_samples_csv(beginning: &[u8]) -> bool {
    // A spreadsheet puts a mark in front when it saves; the reader skips it.
    let beginning = beginning.strip_prefix(b"\xef\xbb\xbf").unwrap_or(beginning);
    beginning.starts_with(b"seq,t_ns,flags,signals,")
}

#[cfg(test)]
mod tests {
    use super::super::info::tests::arm;
    use super::*;
    use crate::messages::signals;

    fn read(text: &str) -> Result<Vec<Sample>, CsvSampleError> {
        let mut reader = SamplesCsvReader::new(text.as_bytes(), &arm())?;
        std::iter::from_fn(|| reader.next_sample().transpose()).collect()
    }

    #[test]
    fn prop_samples_come_back_to_the_bit() {
        let mut sink = Vec::new();
        let mut csv = SamplesCsv::new(&mut sink, &arm()).unwrap();
        let mut sample = Sample::EMPTY;
        sample.joints = 2;
        sample.signals = signals::Q | signals::INPUT;
        (sample.seq, sample.t_ns) = (3, 3_000_000);
        sample.q[..2].copy_from_slice(&[0.1 + 0.2, f64::NAN]);
        sample.input[..2].copy_from_slice(&[-1e-300, f64::INFINITY]);
        csv.write(&sample).unwrap();
        csv.finish().unwrap();
        let text = String::from_utf8(sink).unwrap();
        assert!(
            text.starts_with("seq,t_ns,flags,signals,q_1_rad,q_2_rad,dq_1_rad_per_s,"),
            "{text}"
        );
        assert!(
            text.lines()
                .next()
                .unwrap()
                .ends_with(",setpoint_2_rad,input_1_v,input_2_v"),
            "{text}"
        );

        // As a spreadsheet saves it.
        let marked = format!("\u{feff}{text}");
        assert!(is_samples_csv(text.as_bytes()) && is_samples_csv(marked.as_bytes()));
        assert_eq!(read(&marked).unwrap().len(), 1);

        let back = read(&text).unwrap();
        assert_eq!(back.len(), 1);
        let bits = |s: &Sample| s.q.iter().chain(&s.input).map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back[0]), bits(&sample));
        assert_eq!(
            (back[0].seq, back[0].t_ns, back[0].signals),
            (3, 3_000_000, sample.signals)
        );
    }

    #[test]
    fn fault_a_cell_that_is_no_number_is_named_by_line_and_column() {
        let head = header(arm().joints, &arm().position_unit, &arm().input_unit).join(",");
        let text = format!("{head}\n0,0,0,1,0,0,,,,,,,,,,\n1,1000,0,1,0,x,,,,,,,,,,\n");
        let error = read(&text).unwrap_err().to_string();
        assert_eq!(error, "line 3, column q_2_rad: expected a number, got \"x\"");
        let error = read("a,b\n").unwrap_err().to_string();
        assert!(error.contains("expected the columns seq,t_ns"), "{error}");
    }
}
