//! Reads text from files named by the user; refuses named pipes.

use std::io;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

/// Refuses a named pipe, because opening one waits for a writer and no signal ends that wait. A
/// shell's `<(…)` is a pipe below /dev or /proc that already has its writer, and is accepted.
///
/// # Errors
/// For a named pipe elsewhere. A path that cannot be examined is left to the caller, who opens it
/// next.
pub(crate) fn refuse_named_pipe(path: &Path) -> io::Result<()> {
    let is_pipe = std::fs::metadata(path).is_ok_and(|found| found.file_type().is_fifo());
    match is_pipe && !path.starts_with("/dev") && !path.starts_with("/proc") {
        true => Err(io::Error::other("expected a file, got a named pipe")),
        false => Ok(()),
    }
}

/// Largest file of settings \[bytes\]: a recording named by mistake must not be read completely,
/// and a parser uses up to a hundred bytes for each byte of garbage.
#[cfg(feature = "config")]
pub(crate) const MAX_SETTINGS_BYTES: u64 = 4 << 20;
/// Largest table of a motion, or of results \[bytes\].
#[cfg(feature = "config")]
pub(crate) const MAX_TABLE_BYTES: u64 = 64 << 20;

/// The text of a file of at most `max_bytes` \[bytes\], without the byte-order mark that some
/// spreadsheets write first.
///
/// # Errors
/// For a named pipe, a file that cannot be read or is too large, or invalid UTF-8, with its line.
/// The caller adds the file name.
#[cfg(feature = "config")]
pub(crate) fn read_text(path: &Path, max_bytes: u64) -> io::Result<String> {
    let text = String::from_utf8(read_bytes(path, max_bytes)?).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let line = 1 + e.as_bytes()[..at].iter().filter(|b| **b == b'\n').count();
        let problem = format!("expected UTF-8 text, got other bytes in line {line}");
        io::Error::new(io::ErrorKind::InvalidData, problem)
    })?;
    Ok(unmarked(text))
}

/// The same for a file of which single lines may be damaged, or in an older encoding: other bytes
/// than UTF-8 become U+FFFD.
///
/// # Errors
/// For a named pipe, UTF-16, or a file that cannot be read or is too large.
#[cfg(feature = "service")]
pub(crate) fn read_text_or_other_bytes(path: &Path, max_bytes: u64) -> io::Result<String> {
    let bytes = read_bytes(path, max_bytes)?;
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        let problem = "expected UTF-8 text, got UTF-16, as some spreadsheets save it; save it as CSV in UTF-8";
        return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
    }
    let text = String::from_utf8(bytes).unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned());
    Ok(unmarked(text))
}

#[cfg(feature = "config")]
fn unmarked(mut text: String) -> String {
    if text.starts_with('\u{feff}') {
        text.drain(..'\u{feff}'.len_utf8());
    }
    text
}

#[cfg(feature = "config")]
fn read_bytes(path: &Path, max_bytes: u64) -> io::Result<Vec<u8>> {
    use std::io::Read as _;
    refuse_named_pipe(path)?;
    let failed = |what: &str, e: &io::Error| io::Error::new(e.kind(), format!("cannot be {what}: {e}"));
    let file = std::fs::File::open(path).map_err(|e| failed("opened", &e))?;
    let mut bytes = Vec::new();
    // The stated length is not used, because a device has none and may never end.
    file.take(max_bytes.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(|e| failed("read", &e))?;
    if bytes.len() as u64 > max_bytes {
        let problem = format!("expected a file of at most {max_bytes} bytes, got a larger one");
        return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
    }
    Ok(bytes)
}

#[cfg(all(test, feature = "config"))]
mod tests {
    use super::*;

    #[test]
    fn fault_text_is_read_up_to_a_size_in_utf_8_without_a_byte_order_mark() {
        let path = std::env::temp_dir().join(format!("thetabus-text-{}", std::process::id()));
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("written");
            read_text(&path, 8).map_err(|e| e.to_string())
        };
        assert_eq!(read(b"\xef\xbb\xbft_s,q").as_deref(), Ok("t_s,q"));
        assert_eq!(read(b"12345678").as_deref(), Ok("12345678"));
        let large = read(b"123456789").expect_err("too large");
        assert_eq!(large, "expected a file of at most 8 bytes, got a larger one");
        let latin = read(b"1\n\xe9\n").expect_err("no UTF-8");
        assert_eq!(latin, "expected UTF-8 text, got other bytes in line 2");
        #[cfg(feature = "service")]
        assert_eq!(
            read_text_or_other_bytes(&path, 8).ok().as_deref(),
            Some("1\n\u{fffd}\n")
        );
        std::fs::remove_file(&path).expect("removed");
        let missing = read_text(&path, 8).expect_err("no file").to_string();
        assert!(missing.contains("cannot be opened: No such file"), "{missing}");
        // A device without an end.
        assert!(read_text(Path::new("/dev/zero"), 8).is_err());
    }
}
