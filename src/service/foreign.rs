//! Data of one model under the names of another: found by `model_hash`, refused in words that name
//! both.

use super::Failure;
use crate::bus::{Bus, ControlClient};
use crate::config::{Catalog, Config};
use crate::messages::{Command, DerivedInfo, Description, Request, item_kind, response_code, text_of};
use crate::node::monitor::Label;
use crate::recording::RunInfo;
use std::time::Duration;

/// How long a monitor waits for the identifier to name its parameters, before it refuses without
/// these names.
const PATIENCE: Duration = Duration::from_secs(1);

/// Parameters that a message lists; a robot has 90.
const LISTED: usize = 8;

/// A model with its first parameters in one line: `servo_axis (mass [kg], offset [N])`.
fn described(model: &str, parameters: impl IntoIterator<Item = (String, String)>) -> String {
    let mut parameters = parameters.into_iter();
    let mut list: Vec<String> = parameters
        .by_ref()
        .take(LISTED)
        .map(|(name, unit)| format!("{name} [{unit}]"))
        .collect();
    let more = parameters.count();
    if more > 0 {
        list.push(format!("and {more} more"));
    }
    format!("{model} ({})", list.join(", "))
}

/// The model of a configuration.
fn of_config(config: &Config) -> String {
    let parameters = config.model.parameters().iter();
    described(
        config.model.name(),
        parameters.map(|p| (p.name.to_string(), p.unit.to_string())),
    )
}

/// The model of a recording, in its own words.
fn of_recording(info: &RunInfo) -> String {
    let own = |label: &Label| (label.name.clone(), label.unit.clone());
    described(&info.model, info.parameters.iter().map(own))
}

/// Name and parameters of the identifier that runs, by its own answer; `None` if it does not answer
/// in time.
pub(super) fn running_model(bus: &Bus) -> Option<(String, Vec<(String, String)>)> {
    let answer = ControlClient::new(bus).and_then(|client| client.ask(&Request::new(Command::Describe), PATIENCE));
    let answer = answer.ok().filter(|answer| answer.code == response_code::DONE)?;
    let parameters = answer
        .items()
        .iter()
        .filter(|item| item.kind == item_kind::PARAMETER)
        .map(|item| (text_of(&item.name).to_owned(), text_of(&item.unit).to_owned()));
    Some((answer.text().to_owned(), parameters.collect()))
}

/// Why a monitor does not show estimates that its configuration has no names for.
pub(super) fn estimates(bus: &Bus, config: &Config) -> Failure {
    let theirs = running_model(bus).map_or_else(
        || "another model".to_owned(),
        |(model, parameters)| described(&model, parameters),
    );
    Failure::Usage(format!(
        "the identifier of robot {} identifies {theirs}, but this monitor's configuration names the parameters of {}, and a recording needs the right one: give it the identifier's \
         configuration (--config FILE), or start the monitor of the program that has that plant",
        config.bus.robot,
        of_config(config)
    ))
}

/// Says that a monitor takes names and units from the identifier, because its own configuration has
/// others.
pub(super) fn warn_of_description(description: &Description, config: &Config) {
    let theirs = description.parameters().iter();
    let theirs = theirs.map(|p| (p.name().to_owned(), p.unit().to_owned()));
    let derived: Vec<&str> = description.derived().iter().map(DerivedInfo::name).collect();
    tracing::warn!(
        derived = derived.join(", "),
        "the identifier of robot {} identifies {}, but this monitor's configuration names the parameters of {}: names and units are taken from the \
         identifier, and nothing is known of true values",
        config.bus.robot,
        described(description.model(), theirs),
        of_config(config)
    );
}

/// Refuses to identify a recording of a plant whose equations this program does not have. Whoever
/// names another model on the command line may identify the same samples with it: then the model of
/// `config` is not the one of `as_recorded`.
///
/// # Errors
/// The recording is of another model than its own configuration gives in this program, and nobody
/// chose one.
pub(super) fn check_recording(info: &RunInfo, as_recorded: Option<&Config>, config: &Config) -> Result<(), Failure> {
    let own = config.model.definition().hash();
    let recorded = as_recorded.map(|config| config.model.definition().hash());
    // Another form of the same model is a question of its terms, which a recording leaves open.
    let of_same_name = recorded == Some(info.model_hash) && config.model.definition().name == info.model;
    if own == info.model_hash || of_same_name {
        return Ok(());
    }
    if recorded != Some(own) {
        tracing::warn!(
            "the recording is of {}; it is identified as {}, as the command line says",
            of_recording(info),
            of_config(config)
        );
        return Ok(());
    }
    Err(Failure::Usage(format!(
        "{}; this would be {}",
        lacking(info),
        of_config(config)
    )))
}

/// Why a recording cannot be identified with its own configuration: its model is none of this
/// program's. `None` if it is one.
pub(super) fn unknown_model(info: &RunInfo, catalog: &Catalog) -> Option<Failure> {
    if catalog.names().any(|name| name == info.model) {
        return None;
    }
    let names = catalog.names().collect::<Vec<_>>().join(", ");
    Some(Failure::Usage(format!("{}; this program has {names}", lacking(info))))
}

fn lacking(info: &RunInfo) -> String {
    format!(
        "the recording is of {}, whose equations this program does not have: identify it with the program that has them, or name the \
         model that is to be identified instead, --set model.kind=... or --config FILE",
        of_recording(info)
    )
}

/// Why a recording has no report: its estimates are not of the model that it describes.
pub(super) fn report(info: &RunInfo) -> Failure {
    Failure::Usage(format!(
        "the recording describes {}, but holds estimates of another model, so that their names and units are not known: its monitor had another \
         configuration than the identifier; identify its samples anew, thetabus identify RECORDING --config FILE",
        of_recording(info)
    ))
}

/// Says that the identifier which a replay feeds has another model than the recording had. It may
/// be meant: samples are the machine's.
pub(super) fn warn_of_replay(info: &RunInfo, bus: &Bus) {
    let Some((model, parameters)) = running_model(bus) else {
        return;
    };
    let recorded = info.parameters.iter().map(|own| (&own.name, &own.unit));
    if model != info.model || !recorded.eq(parameters.iter().map(|(name, unit)| (name, unit))) {
        tracing::warn!(
            "the recording is of {}, but the identifier identifies {}: its estimates are those of its own model",
            of_recording(info),
            described(&model, parameters)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_model_of_many_parameters_is_described_in_one_line() {
        let of = |count: usize| described("arm", (1..=count).map(|i| (format!("x_{i}"), "kg".to_owned())));
        assert_eq!(of(2), "arm (x_1 [kg], x_2 [kg])");
        assert!(!of(8).contains("more"));
        let many = of(90);
        assert!(many.ends_with("x_8 [kg], and 82 more)"), "{many}");
    }
}
