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
    /// The source fails.
    #[error("{0}")]
    Csv(csv::Error),
    /// A different header.
    #[error("line 1: {}", other_columns(.expected, .got))]
    Header {
        /// The columns of this plant.
        expected: Vec<String>,
        /// The columns of the file.
        got: Vec<String>,
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
    /// A row with another number of cells.
    #[error("line {line}: expected {expected} cells, got {got}")]
    Cells {
        /// Line of the file, from 1.
        line: u64,
        /// Cells of the header.
        expected: usize,
        /// Cells of the row.
        got: u64,
    },
    /// A row that is not text.
    #[error("line {line}: expected UTF-8 text, got other bytes")]
    Text {
        /// Line of the file, from 1.
        line: u64,
    },
    /// Too many rows cannot be used.
    #[error("{first}; {refused} of {rows} rows cannot be used, more than 1 %: is this the file that was exported?")]
    Unusable {
        /// The first one.
        first: Box<Self>,
        /// Number of such rows.
        refused: u64,
        /// Number of all rows.
        rows: u64,
    },
}

/// The first column that differs, and how many there are.
fn other_columns(expected: &[String], got: &[String]) -> String {
    let alike = expected.iter().zip(got).take_while(|(a, b)| a == b).count();
    let name = |list: &[String]| {
        list.get(alike)
            .map_or("none".to_owned(), |name| format!("\"{}\"", cut(name)))
    };
    format!(
        "expected the {} columns of an export of this model, with {} as column {}, got {} columns with {}; is the configuration of the \
         exported robot named by --config?",
        expected.len(),
        name(expected),
        alike + 1,
        got.len(),
        name(got)
    )
}

impl CsvSampleError {
    /// Line of an error that concerns one row, behind which others can be read.
    pub fn line(&self) -> Option<u64> {
        match self {
            Self::Cell { line, .. } | Self::Cells { line, .. } | Self::Text { line } => Some(*line),
            Self::Csv(_) | Self::Header { .. } | Self::Unusable { .. } => None,
        }
    }

    /// The same error without its line, for a message that names it otherwise.
    pub fn without_line(&self) -> String {
        let text = self.to_string();
        match self.line() {
            Some(line) => text
                .strip_prefix(&format!("line {line}"))
                .map_or(text.as_str(), |rest| rest.trim_start_matches([':', ',', ' ']))
                .to_owned(),
            None => text,
        }
    }
}

impl From<csv::Error> for CsvSampleError {
    fn from(error: csv::Error) -> Self {
        let at = |pos: &Option<csv::Position>| pos.as_ref().map_or(0, csv::Position::line);
        match error.kind() {
            csv::ErrorKind::UnequalLengths { pos, expected_len, len } => Self::Cells {
                line: at(pos),
                expected: usize::try_from(*expected_len).unwrap_or(usize::MAX),
                got: *len,
            },
            csv::ErrorKind::Utf8 { pos, .. } => Self::Text { line: at(pos) },
            _ => Self::Csv(error),
        }
    }
}

/// True if so many rows of an export are unusable that it is another file, or badly damaged: more
/// than one, and more than 1 %.
pub fn is_beyond_repair(refused: u64, rows: u64) -> bool {
    refused > 1 && refused.saturating_mul(100) > rows
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
const SHOWN: usize = 100;

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
    /// Rows read so far.
    rows: u64,
    /// Rows left out by [`next_usable`](Self::next_usable), and the first one.
    refused: u64,
    first: Option<Box<CsvSampleError>>,
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
        // An export has no quotes. With them, one that is not closed would swallow the rows behind
        // it.
        let mut reader = csv::ReaderBuilder::new()
            .quoting(false)
            .from_reader(Bounded { source, since_row: 0 });
        let columns = header(joints, position_unit, input_unit);
        let got: Vec<String> = reader.headers()?.iter().map(String::from).collect();
        if got != columns {
            let expected = columns;
            return Err(CsvSampleError::Header { expected, got });
        }
        Ok(Self {
            reader,
            columns,
            joints,
            record: csv::StringRecord::new(),
            rows: 0,
            refused: 0,
            first: None,
        })
    }

    /// The next sample of a row that can be used; `None` at the end. The others are left out and
    /// [counted](Self::refused).
    ///
    /// # Errors
    /// If the source fails; at the end, if more than 1 % of the rows were left out.
    pub fn next_usable(&mut self) -> Result<Option<Sample>, CsvSampleError> {
        loop {
            match self.next_sample() {
                Err(error) if error.line().is_some() => {
                    self.refused += 1;
                    self.first.get_or_insert_with(|| Box::new(error));
                }
                Ok(None) if is_beyond_repair(self.refused, self.rows) => match self.first.take() {
                    Some(first) => {
                        let (refused, rows) = (self.refused, self.rows);
                        return Err(CsvSampleError::Unusable { first, refused, rows });
                    }
                    None => return Ok(None),
                },
                done => return done,
            }
        }
    }

    /// What was left out, in words; `None` if nothing was.
    pub fn refused(&self) -> Option<String> {
        let first = self.first.as_ref()?;
        let what = if self.refused == 1 { "is" } else { "are" };
        Some(format!(
            "{} of {} rows {what} left out; the first is {first}",
            self.refused, self.rows
        ))
    }

    /// Line of the row read last, from 1.
    pub fn line(&self) -> u64 {
        self.record.position().map_or(0, csv::Position::line)
    }

    /// The next sample; `None` at the end. After an error with a [line](CsvSampleError::line) the
    /// next row can be read.
    ///
    /// # Errors
    /// If a row has a wrong number of cells, or a cell is not a number; with line and column.
    pub fn next_sample(&mut self) -> Result<Option<Sample>, CsvSampleError> {
        self.reader.get_mut().since_row = 0;
        let read = self.reader.read_record(&mut self.record);
        self.rows += u64::from(!matches!(read, Ok(false)));
        if !read? {
            return Ok(None);
        }
        let record = &self.record;
        // Some spreadsheets put every cell in quotes.
        let cell = |column: usize| record.get(column).unwrap_or_default().trim().trim_matches('"');
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

/// Why a file with this beginning, which was an export, is no longer one: a spreadsheet has put
/// other separators between its cells. As a log of columns it would be misread. `None` for other
/// files.
pub fn separators_of_a_spreadsheet(beginning: &[u8]) -> Option<String> {
    let beginning = beginning.strip_prefix(b"\xef\xbb\xbf").unwrap_or(beginning);
    let separator = *beginning.strip_prefix(b"seq")?.first()?;
    let head = ["seq", "t_ns", "flags", "signals"].join(&char::from(separator).to_string());
    let is_other = b";\t|".contains(&separator) && beginning.starts_with(head.as_bytes());
    is_other.then(|| {
        format!(
            "line 1: expected commas between the cells of an export, got {:?}, as a spreadsheet saves it: export the recording again, or save with \
             commas and decimal points",
            char::from(separator)
        )
    })
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

        let semicolons = text.replace(',', ";");
        let said = separators_of_a_spreadsheet(semicolons.as_bytes()).unwrap_or_default();
        assert!(said.contains("expected commas") && said.contains("';'"), "{said}");
        for other in [text.as_str(), "seq", "seq;q_1", ""] {
            assert_eq!(separators_of_a_spreadsheet(other.as_bytes()), None);
        }

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
        assert!(
            error.contains("with \"seq\" as column 1, got 2 columns with \"a\""),
            "{error}"
        );
    }

    #[test]
    fn fault_a_bad_row_costs_only_itself_and_many_cost_the_file() {
        let head = header(arm().joints, &arm().position_unit, &arm().input_unit).join(",");
        let good = |i: u32| format!("{i},{i}000,0,1,0,{i},,,,,,,,,,\n").into_bytes();
        let usable = |spoilt: &[(usize, &[u8])]| {
            let mut rows: Vec<Vec<u8>> = (0..200).map(good).collect();
            for (at, bytes) in spoilt {
                rows[*at] = bytes.to_vec();
            }
            let text = [head.as_bytes(), b"\n", &rows.concat()].concat();
            let mut reader = SamplesCsvReader::new(&text[..], &arm()).unwrap();
            let mut count = 0;
            while let Some(sample) = reader.next_usable().map_err(|e| e.to_string())? {
                assert_eq!(sample.q[1], sample.seq as f64);
                count += 1;
            }
            Ok::<_, String>((count, reader.refused()))
        };
        let told = |what: &str| Some(format!("1 of 200 rows is left out; the first is line 5{what}"));
        let open_quote: &[u8] = b"\"3,3000,0,1,0,x,,,,,,,,,,\n";
        let cases: [(&[u8], &str); 4] = [
            (b"3,30\n", ": expected 16 cells, got 2"),
            (
                b"\xff,3000,0,1,0,3,,,,,,,,,,\n",
                ": expected UTF-8 text, got other bytes",
            ),
            (
                b"3,3000,0,1,0,drive fault,,,,,,,,,,\n",
                ", column q_2_rad: expected a number, got \"drive fault\"",
            ),
            (open_quote, ", column q_2_rad: expected a number, got \"x\""),
        ];
        for (row, what) in cases {
            assert_eq!(usable(&[(3, row)]), Ok((199, told(what))));
        }
        assert_eq!(usable(&[]), Ok((200, None)));
        assert_eq!(usable(&[(3, open_quote), (199, b"7,")]).unwrap().0, 198);
        let error = usable(&[(3, b"x\n"), (4, b"x\n"), (9, b"x\n")]).unwrap_err();
        assert!(
            error.contains("line 5: expected 16 cells, got 1; 3 of 200 rows"),
            "{error}"
        );
    }
}
