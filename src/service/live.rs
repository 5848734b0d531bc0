//! Live output of a monitor: lines, and a page if requested.

use super::args::domain;
use super::wiring::input_prediction;
use super::{Failure, LogFormat, MonitorArgs, logging, web_control};
use crate::bus::monotonic_ns;
use crate::config::Config;
#[cfg(feature = "foxglove")]
use crate::live::FoxgloveServer;
use crate::live::web::{Feed, WebOptions, WebServer};
use crate::live::{About, LiveState, Quantity, block_line};
use crate::messages::{Description, Estimate, Sample, Status, estimate_flags};
use crate::node::monitor::{MonitorNode, seconds};
use std::io::ErrorKind;
#[cfg(feature = "foxglove")]
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Period of updates of the page.
const PERIOD: Duration = Duration::from_millis(200);

/// The live state with the names and settings of a configuration.
pub(super) fn live_state(config: &Config) -> LiveState {
    let plant = config.model.definition();
    let about = About {
        robot: config.bus.robot.clone(),
        domain: config.bus.domain.clone(),
        model: plant.name.clone(),
        joints: plant.joints,
        position_unit: plant.position_unit.clone(),
        input_unit: plant.input_unit.clone(),
    };
    let parameters = plant.parameters.iter().zip(&config.estimator.options.parameters);
    let parameters =
        parameters.map(|(p, prior)| Quantity::new(&p.name, &p.unit, &p.meaning).within(prior.lower, prior.upper));
    let derived = plant
        .derived
        .iter()
        .map(|d| Quantity::new(&d.name, &d.unit, &d.meaning));
    LiveState::new(about, parameters.collect(), derived.collect()).explaining(config.model.least_explained())
}

/// Adopts the names in an identifier's description.
pub(super) fn rename(state: &mut LiveState, description: &Description) {
    let joint = description.joint.first().filter(|_| description.joints > 0);
    let about = About {
        model: description.model().to_owned(),
        joints: description.joints as usize,
        position_unit: description.position_unit().to_owned(),
        input_unit: joint.map_or("", |joint| joint.input_unit()).to_owned(),
        ..state.about().clone()
    };
    let parameters = description.parameters().iter();
    let parameters = parameters.map(|p| Quantity::new(p.name(), p.unit(), p.meaning()).within(p.lower, p.upper));
    let derived = description.derived().iter();
    let derived = derived.map(|d| Quantity::new(d.name(), d.unit(), d.meaning()));
    state.rename(about, parameters.collect(), derived.collect());
}

/// A monitor's views.
pub(super) struct Live {
    feed: Feed,
    server: Option<WebServer>,
    #[cfg(feature = "foxglove")]
    foxglove: Option<FoxgloveServer>,
    published: Instant,
    /// True for readable lines instead of lines with every digit.
    readable: bool,
}

impl Live {
    /// The views of a monitor; starts serving the page, if requested.
    ///
    /// # Errors
    /// If the address is in use, or is not one of this machine.
    pub(super) fn start(config: &Config, node: &MonitorNode, args: &MonitorArgs) -> Result<Self, Failure> {
        let web = &args.web;
        // only a page needs the history
        let state = match web.web {
            Some(_) => live_state(config).predicting(input_prediction(config)),
            None => live_state(config).for_text(),
        };
        let feed = Feed::new(state, monotonic_ns, web.web_control);
        let server = web
            .web
            .map(|address| {
                let control = match web.web_control {
                    true => Some(web_control::start(domain(config)?, config.bus.robot.clone())?),
                    false => None,
                };
                WebServer::start(feed.clone(), WebOptions { address, control })
                    .map_err(|e| Failure::Usage(format!("--web {address}: {}", why(&e))))
            })
            .transpose()?;
        if let Some(server) = &server {
            // Without this line the user does not know the address.
            logging::say(args.common.log_format, &format!("see it live at {}", server.url()));
        }
        #[cfg(feature = "foxglove")]
        let foxglove = web
            .foxglove
            .map(|address| foxglove(config, node, args, address))
            .transpose()?;
        #[cfg(not(feature = "foxglove"))]
        let _ = node;
        Ok(Self {
            #[cfg(feature = "foxglove")]
            foxglove,
            feed,
            server,
            published: Instant::now(),
            readable: matches!(args.common.log_format, LogFormat::Text),
        })
    }

    pub(super) fn sample(&mut self, sample: &Sample) {
        #[cfg(feature = "foxglove")]
        if let Some(server) = &mut self.foxglove {
            server.sample(sample);
        }
        if self.server.is_some() {
            self.feed.with(|state| state.on_sample(sample));
        }
    }

    pub(super) fn estimate(&mut self, node: &MonitorNode, estimate: &Estimate, sent_ns: u64) {
        self.feed
            .with(|state| state.on_estimate(estimate, node.truth(), sent_ns));
        #[cfg(feature = "foxglove")]
        if let Some(server) = &mut self.foxglove {
            server.estimate(estimate);
        }
        if !tracing::enabled!(tracing::Level::INFO) {
            return;
        }
        if !self.readable {
            tracing::info!("{}", node.line(estimate));
            return;
        }
        let changed = estimate.flags & estimate_flags::CHANGED != 0;
        let changed_t_s = changed.then(|| seconds(estimate.t_change_ns));
        let view = self.feed.with(|state| state.view(sent_ns));
        tracing::info!("{}", block_line(&view, changed_t_s));
    }

    pub(super) fn status(&mut self, status: &Status, sent_ns: u64) {
        self.feed.with(|state| state.on_status(status, sent_ns));
        #[cfg(feature = "foxglove")]
        if let Some(server) = &mut self.foxglove {
            server.status(status);
        }
    }

    /// Adopts the identifier's names, if its model differs from the configuration's.
    pub(super) fn rename(&mut self, description: &Description) {
        self.feed.with(|state| rename(state, description));
    }

    /// Call this often.
    pub(super) fn round(&mut self) {
        if self.server.is_some() && self.published.elapsed() >= PERIOD {
            self.published = Instant::now();
            self.feed.publish();
        }
    }

    /// Sends the final state to all viewers.
    pub(super) fn finish(&mut self) {
        if self.server.is_some() {
            self.feed.publish();
        }
    }
}

/// The same topics as in a recording, over the Foxglove protocol.
#[cfg(feature = "foxglove")]
fn foxglove(
    config: &Config,
    node: &MonitorNode,
    args: &MonitorArgs,
    address: SocketAddr,
) -> Result<FoxgloveServer, Failure> {
    args.web.check()?;
    let info = super::run_info::run_info(config, node, args.common.is_launched());
    let server =
        FoxgloveServer::start(&info, address).map_err(|e| Failure::Usage(format!("--foxglove {address}: {e}")))?;
    let line = format!("connect Foxglove to ws://{}:{}", address.ip(), server.port());
    logging::say(args.common.log_format, &line);
    Ok(server)
}

/// Why an address cannot be used, and what to do.
fn why(error: &std::io::Error) -> String {
    match error.kind() {
        ErrorKind::AddrInUse => "the port is in use; name another one, or 0 for any that is free".to_owned(),
        ErrorKind::AddrNotAvailable => "this machine has no such address".to_owned(),
        ErrorKind::PermissionDenied => "ports below 1024 need rights; name one above".to_owned(),
        _ => error.to_string(),
    }
}
