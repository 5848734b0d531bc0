//! Logs on standard error. A reader that has gone away is no reason to fail.

use super::{Failure, LogFormat, TableFormat};
use crate::report::Summary;
use std::io::{ErrorKind, IsTerminal, Write};
use tracing_subscriber::EnvFilter;

/// Starts logging; `RUST_LOG` chooses what, and `default` without it: `warn` below a launcher that
/// shows progress itself, `error` beside a table on the terminal, else `info`.
pub(super) fn start(format: LogFormat, default: &str) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let builder = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .log_internal_errors(false);
    // A second start in one process, as in tests, keeps the first.
    let _ = match format {
        LogFormat::Text => builder.try_init(),
        LogFormat::Json => builder.json().try_init(),
    };
}

/// The name of a format on the command line.
pub(super) fn format_name(format: LogFormat) -> &'static str {
    match format {
        LogFormat::Text => "text",
        LogFormat::Json => "json",
    }
}

/// The last words of a program that failed: shown whatever `RUST_LOG` says.
pub(super) fn failure(format: LogFormat, message: &str) {
    let line = match format {
        LogFormat::Text => format!("error: {message}"),
        LogFormat::Json => serde_json::json!({ "level": "ERROR", "fields": { "message": message } }).to_string(),
    };
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// A line that must be seen, whatever `RUST_LOG` says.
pub(super) fn say(format: LogFormat, message: &str) {
    let line = match format {
        LogFormat::Text => message.to_owned(),
        LogFormat::Json => serde_json::json!({ "level": "INFO", "fields": { "message": message } }).to_string(),
    };
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// A line of results on standard output. A reader that has closed it, as `head` does, is no
/// failure.
///
/// # Errors
/// The result is lost: standard output is a file on a full disk, for instance.
pub(super) fn result(line: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{line}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::Failed(format!("standard output cannot be written: {e}")))
        }
        _ => Ok(()),
    }
}

/// A result table on standard output.
///
/// # Errors
/// As [`result`].
pub(super) fn table(summary: &Summary, format: TableFormat) -> Result<(), Failure> {
    match format {
        TableFormat::Text => result(summary.to_string().trim_end()),
        TableFormat::Json => {
            let text = serde_json::to_string_pretty(summary);
            result(&text.map_err(|e| Failure::Failed(format!("the table cannot be written: {e}")))?)
        }
    }
}

/// A last line for people; in JSON, standard output holds the table alone.
///
/// # Errors
/// As [`result`].
pub(super) fn note(format: TableFormat, text: &str) -> Result<(), Failure> {
    match format {
        TableFormat::Text => result(text)?,
        TableFormat::Json => tracing::info!("{text}"),
    }
    Ok(())
}
