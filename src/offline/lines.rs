//! Reads any text file line by line, in bounded memory.
//!
//! A row is a line: an unclosed quote spoils only its own row, not the rest of the file as in a
//! reader that permits fields over several lines.

use std::io::{self, BufRead, BufReader, Read};

/// Longest accepted line \[bytes\].
pub(super) const MAX_LINE_BYTES: usize = 1 << 16;

/// Why there is no next line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// The file cannot be read.
    #[error("line {line}: {source}")]
    Io {
        /// Line where reading stopped, from 1.
        line: u64,
        /// What the system says.
        source: io::Error,
    },
    /// A line that is too long.
    #[error(
        "line {line}: expected lines of at most {MAX_LINE_BYTES} bytes, got a longer one; is this a text file with one row per line?"
    )]
    TooLong {
        /// Its number, from 1.
        line: u64,
    },
}

/// The lines of a file.
pub(super) struct Lines<R> {
    input: BufReader<R>,
    line: Vec<u8>,
    number: u64,
}

impl<R: Read> Lines<R> {
    pub(super) fn new(input: R) -> Self {
        Self {
            input: BufReader::with_capacity(1 << 16, input),
            line: Vec::new(),
            number: 0,
        }
    }

    /// Number of the line read last, from 1.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// The line read last, without its end.
    pub(super) fn line(&self) -> &[u8] {
        &self.line
    }

    /// Advances to the next line that is neither empty nor a comment; false at the end of the file.
    ///
    /// # Errors
    /// If the file cannot be read, or a line is too long.
    pub(super) fn advance(&mut self) -> Result<bool, LineError> {
        loop {
            self.line.clear();
            self.number += 1;
            let limit = MAX_LINE_BYTES as u64 + 1;
            let read = (&mut self.input).take(limit).read_until(b'\n', &mut self.line);
            let line = self.number;
            if read.map_err(|source| LineError::Io { line, source })? == 0 {
                return Ok(false);
            }
            let ended = self.line.pop_if(|b| *b == b'\n').is_some();
            if !ended && self.line.len() > MAX_LINE_BYTES {
                return Err(LineError::TooLong { line });
            }
            // The byte-order mark that spreadsheets write before UTF-8.
            if line == 1 && self.line.starts_with(b"\xef\xbb\xbf") {
                self.line.drain(..3);
            }
            let text = self.line.trim_ascii();
            if !text.is_empty() && text[0] != b'#' {
                return Ok(true);
            }
        }
    }
}

/// Splits a line at commas outside quotes; ignores blanks around a field. False if a quote is not
/// closed.
pub(super) fn fields<'a>(line: &'a str, into: &mut Vec<&'a str>) -> bool {
    into.clear();
    let mut rest = line;
    loop {
        rest = rest.trim_start();
        let (field, behind) = match rest.strip_prefix('"') {
            Some(quoted) => {
                let Some(end) = closing_quote(quoted) else { return false };
                let behind = quoted[end + 1..].trim_start();
                (&quoted[..end], behind)
            }
            None => {
                let end = rest.find(',').unwrap_or(rest.len());
                (rest[..end].trim_end(), &rest[end..])
            }
        };
        into.push(field);
        if behind.is_empty() {
            return true;
        }
        match behind.strip_prefix(',') {
            Some(next) => rest = next,
            None => return false,
        }
    }
}

/// A quote inside quotes is doubled.
fn closing_quote(text: &str) -> Option<usize> {
    let bytes = text.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        match (bytes[at], bytes.get(at + 1)) {
            (b'"', Some(b'"')) => at += 2,
            (b'"', _) => return Some(at),
            _ => at += 1,
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_fields_are_cut_at_commas_outside_quotes() {
        let cases: [(&str, Option<&[&str]>); 9] = [
            ("a,b", Some(&["a", "b"])),
            (" a , b ", Some(&["a", "b"])),
            ("a,", Some(&["a", ""])),
            (",,", Some(&["", "", ""])),
            ("\"x [mm], raw\", u", Some(&["x [mm], raw", "u"])),
            ("\"a\"\"b\",c", Some(&["a\"\"b", "c"])),
            ("1\"2,3", Some(&["1\"2", "3"])),
            ("\"a,b", None),
            ("\"a\" b,c", None),
        ];
        for (line, expected) in cases {
            let mut got = Vec::new();
            let whole = fields(line, &mut got);
            assert_eq!(whole.then_some(got.as_slice()), expected, "{line:?}");
        }
    }

    #[test]
    fn fault_a_line_without_end_is_refused_in_bounded_memory() {
        // An endless source of zeros.
        let mut lines = Lines::new(io::repeat(0));
        let error = lines.advance().unwrap_err().to_string();
        assert!(error.contains("line 1") && error.contains("65536"), "{error}");
        let text = format!("# comment\n\n  \na,b\r\n{}\nlast", "x".repeat(MAX_LINE_BYTES));
        let mut lines = Lines::new(text.as_bytes());
        let mut found = Vec::new();
        while lines.advance().unwrap() {
            found.push((lines.number(), lines.line().len()));
        }
        assert_eq!(found, [(4, 4), (5, MAX_LINE_BYTES), (6, 4)]);
    }
}
