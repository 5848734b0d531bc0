//! Command lines of the programs of a run.

use super::args::{CommonArgs, TableFormat};
use crate::live::Screen;
use clap::Args;
use std::net::SocketAddr;
use std::path::PathBuf;

/// `plant_simulator`.
#[derive(Debug, Clone, Default, Args)]
pub struct PlantArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
    /// Simulated seconds per second, or max (key plant.speed)
    #[arg(long, value_name = "X|max", allow_negative_numbers = true)]
    pub speed: Option<String>,
    /// Length of the run in simulated seconds (key plant.duration_s)
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub duration: Option<String>,
    /// Seed of everything random (key plant.seed)
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<String>,
}

impl PlantArgs {
    pub(super) fn overrides(&self) -> [(&'static str, Option<String>); 3] {
        [
            ("plant.speed", self.speed.clone()),
            ("plant.duration_s", self.duration.clone()),
            ("plant.seed", self.seed.clone()),
        ]
    }
}

/// `identifier`.
#[derive(Debug, Clone, Default, Args)]
pub struct IdentifierArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
    /// Go on from the checkpoint in checkpoint.dir if there is one that fits
    #[arg(long)]
    pub warm: bool,
}

/// `controller`.
#[derive(Debug, Clone, Default, Args)]
pub struct ControllerArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

/// The page in a browser.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct WebArgs {
    /// Show it live as a page in a browser, on this machine only unless another address is named;
    /// port 0 for any that is free
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8080", value_parser = address)]
    pub web: Option<SocketAddr>,
    /// Let the page pause, resume, reset, fix and free; requires the token in the printed address
    #[arg(long, requires = "web")]
    pub web_control: bool,
    /// Stream samples, estimates and status to Foxglove or Lichtblick, ws://ADDRESS:PORT; the
    /// protocol has no token, so only on this machine
    #[cfg(feature = "foxglove")]
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8765", value_parser = address)]
    pub foxglove: Option<SocketAddr>,
    /// Also serve Foxglove on the network; anyone who can reach the address can read the data
    #[cfg(feature = "foxglove")]
    #[arg(long, requires = "foxglove")]
    pub foxglove_open: bool,
}

/// An address with a port; a port alone is one of this machine, and `localhost` is 127.0.0.1.
fn address(text: &str) -> Result<SocketAddr, String> {
    let (host, port) = match text.rsplit_once(':') {
        None => ("127.0.0.1", text),
        Some(("" | "localhost", port)) => ("127.0.0.1", port),
        Some(parts) => parts,
    };
    if let Ok(address) = format!("{host}:{port}").parse() {
        return Ok(address);
    }
    let advice = "such as 8080 or 127.0.0.1:8080 for this machine only, 0.0.0.0:8080 for the network";
    Err(match port.parse::<u16>() {
        Ok(_) => format!("expected the number of an address before the port, {advice}, got \"{host}\""),
        Err(_) => format!("expected a port from 0 to 65535 or ADDRESS:PORT, {advice}"),
    })
}

impl WebArgs {
    /// True if anything here shows samples.
    pub(super) fn takes_samples(&self) -> bool {
        #[cfg(feature = "foxglove")]
        if self.foxglove.is_some() {
            return true;
        }
        self.web.is_some()
    }

    /// Refuses to serve a whole network unless that is explicitly requested.
    #[cfg(feature = "foxglove")]
    pub(super) fn check(&self) -> Result<(), super::Failure> {
        match self.foxglove {
            Some(address) if !address.ip().is_loopback() && !self.foxglove_open => Err(super::Failure::Usage(format!(
                "--foxglove {address}: expected an address of this machine alone, such as 127.0.0.1:{port}: the protocol has no token, so anyone who \
                 can reach {address} could read the data; from elsewhere use ssh -L {port}:127.0.0.1:{port} HOST, or add --foxglove-open if all \
                 of the network may",
                port = address.port()
            ))),
            _ => Ok(()),
        }
    }
}

/// `thetabus watch`.
#[derive(Debug, Clone, Default, Args)]
pub struct WatchArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
}

impl WatchArgs {
    /// Logging options while the terminal is drawn on.
    pub fn logs(&self) -> CommonArgs {
        CommonArgs {
            draws: Screen::is_possible(),
            ..self.common.clone()
        }
    }
}

/// `monitor`.
#[derive(Debug, Clone, Default, Args)]
pub struct MonitorArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub common: CommonArgs,
    /// Directory for estimates.csv and summary.json, new or empty (key monitor.out_dir)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Record samples, estimates and status as MCAP; the file must not exist
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub web: WebArgs,
    /// Form of the result table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
}

/// `thetabus run`.
#[derive(Debug, Clone, Default, Args)]
pub struct RunArgs {
    /// Configuration file; without one config/encoder_only.toml, which is built in
    #[arg(value_name = "CONFIG")]
    pub file: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub plant: PlantArgs,
    /// Directory for the results, new or empty; thetabus-out/TIME without it (key monitor.out_dir)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Make no recording, and so no report
    #[arg(long)]
    pub no_record: bool,
    /// The identifier goes on from the checkpoint in checkpoint.dir if there is one that fits
    #[arg(long)]
    pub warm: bool,
    #[command(flatten)]
    #[allow(missing_docs, reason = "flattened")]
    pub web: WebArgs,
    /// Form of the result table on standard output
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub format: TableFormat,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_an_address_may_be_a_port_alone_and_anything_else_is_told_what_is_expected() {
        for (text, meant) in [
            ("8080", "127.0.0.1:8080"),
            (":0", "127.0.0.1:0"),
            ("localhost:8080", "127.0.0.1:8080"),
            ("0.0.0.0:80", "0.0.0.0:80"),
            ("[::1]:80", "[::1]:80"),
        ] {
            assert_eq!(address(text).map(|address| address.to_string()), Ok(meant.to_owned()));
        }
        for (text, said) in [
            ("", "expected a port from 0 to 65535 or ADDRESS:PORT"),
            ("99999", "expected a port from 0 to 65535"),
            ("127.0.0.1", "expected a port"),
            ("machine:80", "the number of an address before the port"),
        ] {
            let error = address(text).expect_err(text);
            assert!(error.contains(said) && error.contains("127.0.0.1:8080"), "{error}");
        }
    }
}
