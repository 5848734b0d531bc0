//! Converts a request to a change of the node: the only place that defines the meaning of a
//! command, for a running identifier and for a recording.

use super::Failure;
use super::wiring::{fresh_estimator, identifier_node, identity};
use crate::checkpoint::{self, Identity};
use crate::config::{Config, ConfigError, Kind, Short, keys};
use crate::estimator::{ParameterPrior, StateMachine};
use crate::messages::{Command, Item, MAX_ITEMS, Parts, Request, Response, item_kind, response_code};
use crate::node::command::{Change, NodeState};
use crate::robot::{BodyParameters, is_physical};

/// Tunables: the keys of section `[estimator]` that may be set at run time, with their present
/// value.
const TUNABLES: [(&str, fn(&Config) -> Option<f64>); 11] = [
    ("block_len", |config| {
        Some(config.file_form().estimator.block_len as f64)
    }),
    ("forgetting_factor", |config| {
        Some(config.estimator.options.forgetting_factor)
    }),
    ("time_constant_s", |config| config.file_form().estimator.time_constant_s),
    ("information_floor", |config| {
        Some(config.file_form().estimator.information_floor)
    }),
    ("max_iterations", |config| {
        Some(config.file_form().estimator.max_iterations as f64)
    }),
    ("step_factor", |config| Some(config.file_form().estimator.step_factor)),
    ("huber_limit", |config| Some(config.file_form().estimator.huber_limit)),
    ("gate_limit", |config| Some(config.file_form().estimator.gate_limit)),
    ("false_alarm_rate", |config| {
        Some(config.file_form().estimator.false_alarm_rate)
    }),
    ("change_margin_s", |config| {
        Some(config.file_form().estimator.change_margin_s)
    }),
    ("noise_floor_relative", |config| {
        Some(config.file_form().estimator.noise_floor_relative)
    }),
];

/// Samples of all blocks that a running identifier allocates at once: about 500 bytes each for the
/// arm with a window every 20 samples, more for more joints and windows.
const LIVE_SAMPLES: usize = 500_000;
/// Duration of the longest block that can be set at run time \[s\]. No command takes effect within
/// a block, so a longer one could not be undone for as long.
const LONGEST_LIVE_S: f64 = 60.0;
/// A block may become this many times as long as at the start, even if that is longer.
const LONGER: usize = 10;
/// Largest value at which a parameter without a bound can be fixed, in its SI unit, relative to its
/// start value if that is above 1: no machine has a larger one, and its products must stay finite.
const LARGEST: f64 = 1e9;

/// Converts requests to changes, and keeps the configuration up to date as tunables are set.
pub(super) struct Commands {
    config: Config,
    /// The configuration before the last tunable was set.
    before: Option<Config>,
    /// The stream for which tunables were set, and the configuration that applies after it.
    bound: Option<(u32, Config)>,
    /// The longest N that may be requested; at least the one at the start.
    longest_block: usize,
    /// Samples of all block lengths that wait together.
    room: usize,
    /// See [`LARGEST`].
    largest: f64,
    identity: Identity,
    parts: Parts,
}

/// The meaning of a request.
pub(super) enum Wanted {
    /// An order for the node, and its name.
    Order(Change, String),
    /// A checkpoint.
    Save,
    /// An answer at once.
    Answer(Box<Response>),
    /// Number of samples that a recorder lost.
    RecorderMissing(u64),
    /// The next part of a state.
    More,
}

impl Commands {
    /// For the initial configuration of the identifier.
    pub(super) fn new(config: &Config) -> Self {
        let own = config.estimator.block_len;
        let in_time = (LONGEST_LIVE_S / config.plant.sim.sample_period_s) as usize;
        Self {
            identity: identity(config),
            config: config.clone(),
            before: None,
            bound: None,
            longest_block: in_time.max(own.saturating_mul(LONGER)).min(LIVE_SAMPLES).max(own),
            room: LIVE_SAMPLES.max(own),
            largest: LARGEST,
            parts: Parts::default(),
        }
    }

    /// The same for the commands in a recording, which took effect when they were given and must do
    /// so again.
    pub(super) fn recorded(config: &Config) -> Self {
        let live = Self::new(config);
        Self {
            longest_block: live.room,
            largest: f64::INFINITY,
            ..live
        }
    }

    /// Identity of the checkpoints; tunables set later do not change it.
    pub(super) fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Samples of all block lengths that may wait together for their border.
    pub(super) fn room(&self) -> u64 {
        self.room as u64
    }

    /// Ends a stream: restores the tunables that were set only for it.
    pub(super) fn leave_stream(&mut self, tag: u32) {
        if let Some((_, config)) = self.bound.take_if(|(bound, _)| *bound == tag) {
            self.config = config;
        }
    }

    /// Notes a request for one stream only. If tunables were set for another stream, that one is
    /// over when the first sample of this one arrives.
    fn enter_stream(&mut self, tag: u32) {
        if let Some(other) = self
            .bound
            .as_ref()
            .map(|(bound, _)| *bound)
            .filter(|bound| tag != 0 && *bound != tag)
        {
            self.leave_stream(other);
        }
    }

    /// Reverts the last tunable, because its order did not reach the node.
    pub(super) fn undo(&mut self) {
        if let Some(before) = self.before.take() {
            self.config = before;
        }
    }

    /// The meaning of a request, or why it is refused.
    pub(super) fn prepare(&mut self, request: &Request) -> Result<Wanted, String> {
        self.before = None;
        self.enter_stream(request.stream);
        let Some(command) = Command::from_wire(request.command) else {
            return Err(format!("command {} is not known", request.command));
        };
        let name = request.name();
        let order = |change, what: String| Ok(Wanted::Order(change, what));
        match command {
            Command::Pause => order(Change::Pause, "paused".to_owned()),
            Command::Resume => order(Change::Resume, "goes on".to_owned()),
            Command::Reset if self.config.model.restarts_itself() => {
                order(Change::Restart { state: None }, "back to the start values".to_owned())
            }
            Command::Reset => {
                let estimator = fresh_estimator(&self.config).map_err(|e| e.to_string())?;
                let judge = Box::new(StateMachine::new(estimator.theta()));
                let change = Change::Replace {
                    estimator: Box::new(estimator),
                    judge,
                    warm: false,
                };
                order(change, "back to the start values".to_owned())
            }
            Command::Set => self.set(name, request.value(), request.stream),
            Command::Fix => {
                let index = self.parameter(name)?;
                let options = &self.config.estimator.options;
                let ParameterPrior { lower, upper, .. } = options.parameters[index];
                let what = match request.value() {
                    None => format!("{name} is held at its estimate"),
                    Some(value) => {
                        let parameter = &self.config.model.parameters()[index];
                        let largest = self.largest * options.parameters[index].start.abs().max(1.0);
                        fixable(value, [lower, upper], largest, &parameter.unit).map_err(|e| format!("{name}: {e}"))?;
                        format!("{name} is held at {value}")
                    }
                };
                let change = Change::Fix {
                    index,
                    value: request.value(),
                };
                order(change, what)
            }
            Command::Free => {
                let index = self.parameter(name)?;
                order(Change::Free { index }, format!("{name} is estimated"))
            }
            Command::Save => match self.config.checkpoint.dir {
                Some(_) => Ok(Wanted::Save),
                None => Err("checkpoint.dir is not set, so there is no place for a checkpoint".to_owned()),
            },
            Command::Describe => Ok(Wanted::Answer(Box::new(self.describe()))),
            Command::Restore => match self.parts.take(request).map_err(|e| e.to_string())? {
                None => Ok(Wanted::More),
                Some(bytes) => {
                    let state = checkpoint::decode(&bytes, &self.identity).map_err(|e| format!("the state: {e}"))?;
                    order(self.restore(&state)?, "goes on from a state".to_owned())
                }
            },
            Command::Payload => {
                if !self.config.model.takes_payload() {
                    return Err(
                        "payload: this model has none; a robot from a URDF has one, unless identify.payload is false"
                            .to_owned(),
                    );
                }
                let body = request.payload_body().map_err(|e| e.to_string())?;
                let what = match &body {
                    None => "nothing is carried".to_owned(),
                    Some(body) if is_physical(&BodyParameters(*body)) => format!("a load of {} kg is carried", body[0]),
                    Some(body) => return Err(format!("payload: expected a body that can exist, got {body:?}")),
                };
                order(
                    Change::Payload {
                        body: body.map(Box::new),
                    },
                    what,
                )
            }
            Command::Recorder => match request.value() {
                Some(missing) if (0.0..1e18).contains(&missing) => Ok(Wanted::RecorderMissing(missing as u64)),
                other => Err(format!("expected a count of samples, got {other:?}")),
            },
        }
    }

    /// An estimator that continues from a state.
    fn restore(&self, state: &NodeState) -> Result<Change, String> {
        if self.config.model.restarts_itself() {
            // Report now if the state does not fit.
            let mut node = identifier_node(&self.config).map_err(|e: Failure| e.to_string())?;
            node.load(state).map_err(|e| format!("the state: {e}"))?;
            let state = Some(Box::new(state.clone()));
            return Ok(Change::Restart { state });
        }
        let mut estimator = fresh_estimator(&self.config).map_err(|e| e.to_string())?;
        let mut judge = StateMachine::new(estimator.theta());
        estimator
            .load(&mut judge, &state.estimator)
            .map_err(|e| format!("the state: {e}"))?;
        Ok(Change::Replace {
            estimator: Box::new(estimator),
            judge: Box::new(judge),
            warm: true,
        })
    }

    fn set(&mut self, name: &str, value: Option<f64>, stream: u32) -> Result<Wanted, String> {
        if self.config.model.restarts_itself() {
            return Err(
                "a robot from a URDF has no tunables; section [identify] of its configuration has its options"
                    .to_owned(),
            );
        }
        let own = name.strip_prefix("estimator.").unwrap_or(name);
        let tunables = TUNABLES.map(|(name, _)| name);
        if !tunables.contains(&own) {
            return Err(format!(
                "expected a tunable out of {}, got {name:?}",
                tunables.join(", ")
            ));
        }
        let Some(value) = value else {
            return Err(format!("{own}: expected a value"));
        };
        if !value.is_finite() {
            return Err(format!("estimator.{own}: expected a finite number, got {value}"));
        }
        if own == "block_len" && !(1.0..=self.longest_block as f64).contains(&value) {
            let advice = match value < 1.0 {
                true => "",
                false => {
                    "; until such a block ends no other command takes effect: start the identifier with blocks that long"
                }
            };
            return Err(format!(
                "block_len: expected a whole number from 1 to {} [samples] while the identifier runs, got {}{advice}",
                self.longest_block,
                Short(value)
            ));
        }
        // The client has no use for a path, because there is no file.
        let in_words = |e: ConfigError| -> String {
            let problems = e.problems.iter().map(|p| format!("{}: {}", p.key, p.message));
            problems.collect::<Vec<_>>().join("; ")
        };
        let config = self
            .config
            .with_number(&format!("estimator.{own}"), value)
            .map_err(in_words)?;
        let block_len = config.estimator.block_len;
        let rows = match block_len == self.config.estimator.block_len {
            true => None,
            false => {
                let node = identifier_node(&config).map_err(|e: Failure| e.to_string())?;
                Some(node.into_rows())
            }
        };
        let change = Change::Tune {
            options: Box::new(config.estimator.options.clone()),
            config_hash: config.config_hash(),
            block_len: block_len as u64,
            rows,
        };
        let before = std::mem::replace(&mut self.config, config);
        match stream {
            // A tunable set meanwhile by an operator stays, with the others at that time.
            0 => self.bound = None,
            tag => _ = self.bound.get_or_insert_with(|| (tag, before.clone())),
        }
        self.before = Some(before);
        Ok(Wanted::Order(change, format!("{own} is {value}")))
    }

    fn parameter(&self, name: &str) -> Result<usize, String> {
        let parameters = self.config.model.parameters();
        parameters.iter().position(|p| p.name == name).ok_or_else(|| {
            let names: Vec<&str> = parameters.iter().map(|p| &*p.name).collect();
            format!("expected a parameter out of {}, got {name:?}", names.join(", "))
        })
    }

    fn describe(&self) -> Response {
        let plant = self.config.model.definition();
        let options = &self.config.estimator.options;
        let none = (f64::NEG_INFINITY, f64::INFINITY);
        let parameters = self.config.model.parameters().iter().zip(&options.parameters);
        let parameters = parameters.map(|(p, prior)| {
            let bounds = (prior.lower, prior.upper);
            Item::new(item_kind::PARAMETER, &p.name, &p.unit, prior.start, bounds)
        });
        let tunables = keys()
            .filter(|key| key.section == "estimator" && !self.config.model.restarts_itself())
            .filter_map(|key| {
                let (_, value) = TUNABLES.iter().find(|(name, _)| *name == key.name)?;
                let value = value(&self.config)?;
                let bounds = match key.kind {
                    Kind::Whole(low, _) if key.name == "block_len" => (low as f64, self.longest_block as f64),
                    Kind::Whole(low, high) => (low as f64, high as f64),
                    Kind::Real(interval) => (interval.low, interval.high),
                    _ => none,
                };
                Some(Item::new(item_kind::TUNABLE, key.name, key.unit, value, bounds))
            });
        let signals = (1..=plant.joints).flat_map(|joint| {
            [
                Item::new(
                    item_kind::POSITION,
                    &format!("q_{joint}"),
                    plant.joint_unit(joint - 1),
                    0.0,
                    none,
                ),
                Item::new(
                    item_kind::INPUT,
                    &format!("input_{joint}"),
                    &plant.input_unit,
                    0.0,
                    none,
                ),
            ]
        });
        let mut response = Response::new(response_code::DONE, self.config.model.name());
        let items = parameters.chain(tunables).chain(signals).take(MAX_ITEMS);
        for (slot, item) in response.items.iter_mut().zip(items) {
            *slot = item;
            response.items_len += 1;
        }
        response
    }
}

/// Refuses a value outside the parameter's bounds, or far beyond every machine.
fn fixable(value: f64, [lower, upper]: [f64; 2], largest: f64, unit: &str) -> Result<(), String> {
    let (low, high) = (lower.max(-largest), upper.min(largest));
    match value.is_finite() && (low..=high).contains(&value) {
        true => Ok(()),
        false => {
            let unit = if unit.is_empty() { "1" } else { unit };
            let is_within_bounds = (lower..=upper).contains(&value);
            let hint = match value.is_finite() && is_within_bounds {
                true => "; no machine has such a value: is it in this unit?",
                false => "",
            };
            Err(format!(
                "expected a number from {} to {} [{unit}], got {}{hint}",
                Short(low),
                Short(high),
                Short(value)
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_parameter_cannot_be_fixed_outside_its_bounds_or_far_beyond_every_machine() {
        let free = [f64::NEG_INFINITY, f64::INFINITY];
        let not_negative = [0.0, f64::INFINITY];
        for (value, bounds, said) in [
            (2.0, not_negative, None),
            (-2.0, free, None),
            (
                1e300,
                not_negative,
                Some("expected a number from 0 to 1e9 [kg], got 1e300; no machine has"),
            ),
            (
                -1e300,
                free,
                Some("expected a number from -1e9 to 1e9 [kg], got -1e300; no machine has"),
            ),
            (-1.0, not_negative, Some("expected a number from 0 to 1e9 [kg], got -1")),
            (
                f64::INFINITY,
                not_negative,
                Some("expected a number from 0 to 1e9 [kg], got inf"),
            ),
            (f64::NAN, free, Some("got NaN")),
            (3.0, [0.0, 2.5], Some("expected a number from 0 to 2.5 [kg], got 3")),
        ] {
            let error = fixable(value, bounds, LARGEST, "kg").err();
            assert_eq!(error.is_some(), said.is_some(), "{value} {error:?}");
            if let (Some(error), Some(said)) = (error, said) {
                assert!(error.contains(said), "{error}");
            }
        }
    }

    #[test]
    fn fault_a_block_that_could_not_be_undone_for_long_is_refused_with_the_range() {
        let config = Config::load(&[], &["estimator.block_len=1000".to_owned()]).expect("valid");
        let mut commands = Commands::new(&config);
        let mut set = |value| {
            let request = Request::new(Command::Set).named("block_len").with_value(value);
            commands.prepare(&request).map(|_| ())
        };
        let error = set(1e7).expect_err("too long");
        let range = format!(
            "a whole number from 1 to {} [samples]",
            (60.0 / config.plant.sim.sample_period_s) as u64
        );
        assert!(error.contains(&range) && error.contains("got 1e7"), "{error}");
        assert_eq!(set(2000.0), Ok(()));
    }
}
