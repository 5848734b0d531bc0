//! `thetabus ctl`: one request to a running identifier, one answer.

use super::args::{CommonArgs, TableFormat};
use super::{CtlArgs, CtlCommand, Exit, Failure, logging};
use crate::bus::{Bus, ControlClient};
use crate::config::Short;
use crate::messages::{Command, Item, Request, Response, item_kind, response_code, text_of};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::time::Duration;

/// Sends the command on the command line to the identifier and shows the answer.
///
/// # Errors
/// If the request is refused, there is no identifier, no answer arrives in time, or the bus fails.
pub fn run(args: &CtlArgs, common: &CommonArgs) -> Result<Exit, Failure> {
    let request = request(&args.command)?;
    let limit = Duration::try_from_secs_f64(args.timeout)
        .ok()
        .filter(|limit| !limit.is_zero())
        .ok_or_else(|| Failure::Usage(format!("--timeout: expected seconds above 0, got {}", args.timeout)))?;
    let common = CommonArgs {
        config: args.config.clone(),
        robot: args.robot.clone(),
        domain: args.domain.clone(),
        ..common.clone()
    };
    let config = common.load(Vec::new(), &[])?;
    let bus = Bus::join(&super::args::domain(&config)?, &config.bus.robot, "ctl")?;
    let response = ControlClient::new(&bus)?.ask(&request, limit)?;
    let described = matches!(args.command, CtlCommand::Describe);
    match response.code {
        response_code::DONE => {}
        response_code::REFUSED => return Err(Failure::Usage(format!("refused: {}", response.text()))),
        _ => return Err(Failure::Failed(response.text().to_owned())),
    }
    let text = match (args.format, described) {
        (TableFormat::Json, _) => format!("{:#}", as_json(&response, described)),
        (TableFormat::Text, true) => table(&response),
        (TableFormat::Text, false) if matches!(args.command, CtlCommand::Save) => format!("saved {}", response.text()),
        (TableFormat::Text, false) => format!(
            "{}, from block {} on (sample {})",
            response.text(),
            response.block,
            response.from_seq
        ),
    };
    logging::result(text.trim_end())?;
    Ok(Exit::Done)
}

fn request(command: &CtlCommand) -> Result<Request, Failure> {
    let with = |request: Request, value: Option<f64>| value.map_or(request, |value| request.with_value(value));
    Ok(match command {
        CtlCommand::Pause => Request::new(Command::Pause),
        CtlCommand::Resume => Request::new(Command::Resume),
        CtlCommand::Reset => Request::new(Command::Reset),
        CtlCommand::Save => Request::new(Command::Save),
        CtlCommand::Describe => Request::new(Command::Describe),
        CtlCommand::Payload { none: Some(_), .. } => Request::payload(None),
        CtlCommand::Payload { mass, com, inertia, .. } => {
            let body = super::calibrate::load_of(*mass, com.as_deref(), inertia.as_deref())?;
            Request::payload(Some(&body.0))
        }
        CtlCommand::Free { parameter } => Request::new(Command::Free).named(parameter),
        // as for a tunable
        CtlCommand::Fix { parameter, value: None } if parameter.contains('=') => assigned(Command::Fix, parameter)?,
        CtlCommand::Fix { parameter, value } => with(Request::new(Command::Fix).named(parameter), *value),
        CtlCommand::Set { assignment } => assigned(Command::Set, assignment)?,
    })
}

/// `NAME=NUMBER`.
fn assigned(command: Command, text: &str) -> Result<Request, Failure> {
    let wrong = || Failure::Usage(format!("expected KEY=NUMBER, got {text:?}"));
    let (key, value) = text.split_once('=').ok_or_else(wrong)?;
    let value = value.trim().parse().map_err(|_| wrong())?;
    Ok(Request::new(command).named(key.trim()).with_value(value))
}

const KINDS: [(u32, &str); 5] = [
    (item_kind::PARAMETER, "parameters"),
    (item_kind::TUNABLE, "tunables"),
    (item_kind::FIGURE, "figures"),
    (item_kind::POSITION, "positions"),
    (item_kind::INPUT, "inputs"),
];

fn table(response: &Response) -> String {
    let mut text = format!("model {}\n", response.text());
    for (kind, title) in KINDS {
        let _ = writeln!(text, "{}", heading(kind, title));
        for item in response.items().iter().filter(|item| item.kind == kind) {
            let (name, unit) = (text_of(&item.name), text_of(&item.unit));
            let _ = match kind {
                item_kind::POSITION | item_kind::INPUT => writeln!(text, "  {name:<20} [{unit}]"),
                item_kind::FIGURE => writeln!(text, "  {name:<20} {:<12} [{unit}]", shown(item.value).to_string()),
                _ => writeln!(
                    text,
                    "  {name:<20} {:<12} [{}]  {} to {}",
                    shown(item.value).to_string(),
                    if unit.is_empty() { "1" } else { unit },
                    shown(item.lower),
                    shown(item.upper)
                ),
            };
        }
    }
    text
}

/// A number for people, in six significant digits; JSON has all of them.
fn shown(value: f64) -> Short {
    Short(format!("{value:.5e}").parse().unwrap_or(value))
}

/// The heading of the numbers after the names.
fn heading(kind: u32, title: &str) -> String {
    match kind {
        item_kind::PARAMETER => format!("{title}: start value, unit, bounds"),
        item_kind::TUNABLE => format!("{title}: value in force, unit, range"),
        item_kind::FIGURE => format!("{title}: value in force, unit"),
        _ => title.to_owned(),
    }
}

fn as_json(response: &Response, described: bool) -> Value {
    if !described {
        return json!({ "done": response.text(), "block": response.block, "from_seq": response.from_seq });
    }
    // JSON has no infinity: no bound is null
    let number = |value: f64| if value.is_finite() { json!(value) } else { Value::Null };
    let item = |item: &Item| {
        let (name, unit) = (text_of(&item.name), text_of(&item.unit));
        match item.kind {
            item_kind::POSITION | item_kind::INPUT => json!({ "name": name, "unit": unit }),
            item_kind::FIGURE => json!({ "name": name, "unit": unit, "value": number(item.value) }),
            _ => json!({
                "name": name, "unit": unit, "value": number(item.value),
                "lower": number(item.lower), "upper": number(item.upper),
            }),
        }
    };
    let mut all = json!({ "model": response.text() });
    for (kind, title) in KINDS {
        all[title] = response.items().iter().filter(|i| i.kind == kind).map(item).collect();
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Command as Line, FromArgMatches, Subcommand};

    #[test]
    fn fault_a_payload_of_neither_kind_is_told_which_there_are() {
        let line = CtlCommand::augment_subcommands(Line::new("ctl"));
        let typed = line.try_get_matches_from(["ctl", "payload"]).expect("taken");
        let command = CtlCommand::from_arg_matches(&typed).expect("a command");
        let error = request(&command).map(|_| ()).expect_err("neither").to_string();
        assert_eq!(error, "payload: expected `none` or --mass KG, got neither");
    }

    #[test]
    fn regress_a_table_has_six_digits_of_a_number_and_no_rounding_errors() {
        for (value, text) in [
            (0.454_237_899_999_999_9, "0.454238"),
            (1900.0, "1900"),
            (1e9, "1e9"),
            (-1.0 / 3.0, "-0.333333"),
            (0.0, "0"),
            (f64::INFINITY, "inf"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(shown(value).to_string(), text);
        }
    }
}
