//! Detects data of one model under the names of another by `model_hash`, and refuses them with a
//! message that names both.

use super::Failure;
use crate::bus::{Bus, ControlClient};
use crate::config::{Catalog, Config};
use crate::messages::{Command, DerivedInfo, Description, Request, item_kind, response_code, text_of};
use crate::node::monitor::Label;
use crate::recording::RunInfo;
use std::time::Duration;

/// How long a monitor waits for the identifier's parameter names before it refuses without them.
const PATIENCE: Duration = Duration::from_secs(1);

/// Largest number of parameters listed in a message; a robot has 90.
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

/// The model of a recording, as described there.
fn of_recording(info: &RunInfo) -> String {
    let own = |label: &Label| (label.name.clone(), label.unit.clone());
    described(&info.model, info.parameters.iter().map(own))
}

/// Name and parameters of the running identifier, from its answer; `None` if it does not answer in
/// time.
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

/// Why a monitor does not show estimates for which its configuration has no names.
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

/// Warns that a monitor uses the identifier's names and units, because its own configuration
/// differs.
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

/// Refuses to identify a recording of a plant whose equations this program does not have. If the
/// command line names another model, the same samples may be identified with that: then the model
/// of `config` differs from that of `as_recorded`.
///
/// # Errors
/// If the recording's model differs from that of its own configuration in this program, and the
/// user has not chosen one.
pub(super) fn check_recording(info: &RunInfo, as_recorded: Option<&Config>, config: &Config) -> Result<(), Failure> {
    let own = config.model.definition().hash();
    let recorded = as_recorded.map(|config| config.model.definition().hash());
    // A recording may be identified with another form of the same model, which only differs in
    // terms.
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

/// Why a recording cannot be identified with its own configuration: this program does not have its
/// model. `None` if it does.
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

/// Warns that the identifier of a replay has another model than the recording. This may be
/// intended, because samples do not depend on the model.
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
