//! Commands from the page to the identifier, on a thread of their own: the page may wait for an
//! answer, the monitor may not.

use super::Failure;
use crate::bus::{Bus, ControlClient, Domain};
use crate::live::web::ControlRequest;
use crate::messages::{Command, Request, response_code};
use serde::Deserialize;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Duration;

/// Commands that wait.
const WAITING: usize = 8;
/// How long the identifier may take for an answer.
const PATIENCE: Duration = Duration::from_secs(3);

/// What a page may ask for.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ControlBody {
    command: String,
    name: Option<String>,
    value: Option<f64>,
}

/// Starts the thread; it ends with the last sender.
pub(super) fn start(domain: Domain, robot: String) -> Result<SyncSender<ControlRequest>, Failure> {
    let (send, receive) = sync_channel::<ControlRequest>(WAITING);
    let work = move || {
        while let Ok(request) = receive.recv() {
            // Who asked may have gone.
            let _ = request.answer.send(ask(&domain, &robot, &request.text));
        }
    };
    std::thread::Builder::new()
        .name("web-control".to_owned())
        .spawn(work)
        .map_err(|e| Failure::Failed(format!("cannot start a thread: {e}")))?;
    Ok(send)
}

/// Asks the identifier that runs now: ports belong to the thread that makes them, and identifiers
/// come and go.
fn ask(domain: &Domain, robot: &str, text: &str) -> Result<String, String> {
    let request = request(text)?;
    let answer =
        Bus::join(domain, robot, "monitor_web").and_then(|bus| ControlClient::new(&bus)?.ask(&request, PATIENCE));
    let response = answer.map_err(|e| e.to_string())?;
    match response.code {
        response_code::DONE => Ok(format!("{}, from block {} on", response.text(), response.block)),
        response_code::REFUSED => Err(format!("refused: {}", response.text())),
        _ => Err(response.text().to_owned()),
    }
}

fn request(text: &str) -> Result<Request, String> {
    let body: ControlBody = serde_json::from_str(text).map_err(|e| format!("expected {{\"command\": …}}: {e}"))?;
    let name = || body.name.as_deref().ok_or("expected the name of a parameter");
    Ok(match body.command.as_str() {
        "pause" => Request::new(Command::Pause),
        "resume" => Request::new(Command::Resume),
        "reset" => Request::new(Command::Reset),
        "free" => Request::new(Command::Free).named(name()?),
        "fix" => {
            let request = Request::new(Command::Fix).named(name()?);
            body.value.map_or(request, |value| request.with_value(value))
        }
        other => return Err(format!("expected pause, resume, reset, fix or free, got {other:?}")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_page_can_ask_for_five_things_and_no_more() {
        let fixed = request(r#"{"command": "fix", "name": "theta_1", "value": 1.5}"#).unwrap();
        assert_eq!(
            (fixed.command, fixed.name(), fixed.value()),
            (Command::Fix as u32, "theta_1", Some(1.5))
        );
        assert_eq!(
            request(r#"{"command":"pause"}"#).unwrap().command,
            Command::Pause as u32
        );
        for wrong in [
            "",
            "[]",
            r#"{"command":"restore"}"#,
            r#"{"command":"fix"}"#,
            r#"{"command":"free"}"#,
            r#"{"command":"pause","more":1}"#,
        ] {
            assert!(request(wrong).is_err(), "{wrong}");
        }
    }
}
