//! Logs on standard error. A closed reader is not a failure.

use super::{Failure, LogFormat, TableFormat};
use crate::report::Summary;
use std::io::{ErrorKind, IsTerminal, Write};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;

/// Starts logging; `RUST_LOG` chooses what, and `default` without it: `warn` below a launcher that
/// shows progress itself, `error` with a table on the terminal, otherwise `info`.
pub(super) fn start(format: LogFormat, default: &str) {
    let layer = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .log_internal_errors(false);
    let layer = match format {
        LogFormat::Text => layer.boxed(),
        LogFormat::Json => layer.json().boxed(),
    };
    let (filter, unreadable) = filter(std::env::var("RUST_LOG").ok().as_deref(), default);
    // A second start in one process, as in tests, keeps the first.
    let _ = tracing_subscriber::registry()
        .with(layer.with_filter(filter))
        .try_init();
    if let Some(message) = unreadable {
        say(format, &message);
    }
}

/// The log filter, and a message if `wanted` cannot be parsed; `default` then applies.
fn filter(wanted: Option<&str>, default: &str) -> (Targets, Option<String>) {
    let parsed = |text: &str| text.parse::<Targets>();
    let fallback = || parsed(default).expect("the programs name levels that exist");
    match wanted
        .filter(|text| !text.trim().is_empty())
        .map(|text| (text, parsed(text)))
    {
        None => (fallback(), None),
        Some((_, Ok(filter))) => (filter, None),
        Some((text, Err(e))) => {
            let message = format!(
                "RUST_LOG = \"{text}\" cannot be read ({e}); \
                 expected levels such as info or warn,thetabus=debug. What is logged: {default}"
            );
            (fallback(), Some(message))
        }
    }
}

/// The name of a format on the command line.
pub(super) fn format_name(format: LogFormat) -> &'static str {
    match format {
        LogFormat::Text => "text",
        LogFormat::Json => "json",
    }
}

/// The final message of a failed program, shown regardless of `RUST_LOG`.
pub(super) fn failure(format: LogFormat, message: &str) {
    let line = match format {
        LogFormat::Text => format!("error: {message}"),
        LogFormat::Json => serde_json::json!({ "level": "ERROR", "fields": { "message": message } }).to_string(),
    };
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// A line that is shown regardless of `RUST_LOG`.
pub(super) fn say(format: LogFormat, message: &str) {
    let line = match format {
        LogFormat::Text => message.to_owned(),
        LogFormat::Json => serde_json::json!({ "level": "INFO", "fields": { "message": message } }).to_string(),
    };
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// A line of results on standard output. If the reader has closed it, as `head` does, that is not a
/// failure.
///
/// # Errors
/// If the result is lost, for example because standard output is a file on a full disk.
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

/// A last line for the user; with JSON, standard output contains only the table.
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

#[cfg(test)]
mod tests {
    use super::filter;
    use tracing::Level;

    #[test]
    fn fault_a_filter_that_cannot_be_read_is_named_and_the_default_logged() {
        let (targets, message) = filter(Some("thetabus=loud"), "warn");
        let message = message.expect("a message");
        assert!(
            message.contains("thetabus=loud") && message.contains("warn"),
            "{message}"
        );
        assert!(targets.would_enable("thetabus", &Level::WARN) && !targets.would_enable("thetabus", &Level::INFO));
    }

    #[test]
    fn prop_rust_log_chooses_by_target_and_an_empty_one_chooses_nothing() {
        let (targets, message) = filter(Some("warn,thetabus=debug"), "info");
        assert_eq!(message, None);
        assert!(
            targets.would_enable("thetabus::bus", &Level::DEBUG) && !targets.would_enable("iceoryx2", &Level::INFO)
        );
        let (targets, message) = filter(Some(""), "info");
        assert_eq!(message, None);
        assert!(targets.would_enable("iceoryx2", &Level::INFO));
    }
}
