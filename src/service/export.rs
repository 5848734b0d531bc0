//! `thetabus export`: a recording's samples as a table.

use super::new_file::{not_written, or_remove, whole};
use super::record::recording_at;
use super::{Exit, ExportArgs, Failure, report};
use crate::messages::Sample;
use crate::recording::{Entry, RecordingReader, SamplesCsv};
use std::fs::File;
use std::io::{self, BufWriter, Write};

/// Writes the samples of a recording as CSV.
///
/// # Errors
/// If there is no recording or it cannot be read, or the file exists or cannot be written.
pub fn run(args: &ExportArgs) -> Result<Exit, Failure> {
    let mut reader = report::open(&recording_at(&args.input), args.span.span()?)?;
    let mut next_sample = next_of(&mut reader)?;
    if next_sample.is_none() && reader.loss().is_none() {
        return Err(args.span.nothing(&args.input));
    }
    let name = args
        .out
        .as_ref()
        .map_or("standard output".to_owned(), |out| whole(out).display().to_string());
    let unwritable = |e: io::Error| not_written(&name, &e);
    let sink: Box<dyn Write> = match &args.out {
        Some(out) => Box::new(BufWriter::new(File::create_new(out).map_err(unwritable)?)),
        None => Box::new(BufWriter::new(io::stdout().lock())),
    };
    let or_removed = |written: io::Result<()>| match &args.out {
        Some(out) => or_remove(out, written),
        None => written,
    };
    let mut csv = SamplesCsv::new(sink, reader.info()).map_err(unwritable)?;
    while let Some(sample) = &next_sample {
        match csv.write(sample) {
            // The reader of standard output has closed it.
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe && args.out.is_none() => return Ok(Exit::Done),
            written => or_removed(written).map_err(unwritable)?,
        }
        next_sample = next_of(&mut reader)?;
    }
    or_removed(csv.finish()).map_err(unwritable)?;
    Ok(report::tell_loss(&reader.loss()))
}

fn next_of(reader: &mut RecordingReader) -> Result<Option<Sample>, Failure> {
    while let Some(entry) = reader.next_entry().map_err(report::unreadable)? {
        if let Entry::Sample { sample, .. } = entry {
            return Ok(Some(*sample));
        }
    }
    Ok(None)
}
