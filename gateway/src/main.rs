//! thetabus on other hosts: topics of a domain over zenoh.
//!
//! ```text
//! domain ──▶ out ──▶ thetabus/<host>/<robot>/<topic> ──▶ in ──▶ domain on another host
//!                      (by way of any number of routers)
//! ```

mod away;
mod envelope;
mod error;
mod inbox;
mod incoming;
mod inward;
mod keys;
mod latest;
mod load;
mod log;
mod network;
mod out;
mod ports;
mod questions;
mod record;
mod refusals;
mod remote_robot;
mod robots;
mod route;
mod silence;
mod tally;
mod way;

use clap::{Parser, Subcommand};
use error::GatewayError;
use nix::sys::signal::{SigSet, Signal};
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Signals this soon after the first mean the same.
const TOGETHER: Duration = Duration::from_millis(500);
/// Exit code after a second signal.
const SECOND_SIGNAL: i32 = 130;

#[derive(Debug, Parser)]
#[command(name = "thetabus-gateway", version, about = "thetabus on other hosts, over zenoh")]
#[command(
    after_help = "Exit codes:\n  0  ended by a signal\n  1  failed\n  2  wrong usage or configuration\n  130  ended by a second signal, half a second or more after the first"
)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Publish the topics of a domain
    Out(out::OutArgs),
    /// Bring the topics of other hosts into a domain
    In(inward::InArgs),
    /// Pass on what others send: a router without plugins
    Route(network::NetworkArgs),
    /// Simulate many robots behind two routers on this host, and measure
    Load(load::LoadArgs),
    #[command(hide = true)]
    LoadSender(load::SenderArgs),
}

fn main() -> ExitCode {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        // What zenoh says of its own affairs is said again, in our words, if it matters.
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("error,thetabus=info,thetabus_gateway=info"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(log::Log::default())
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .log_internal_errors(false)
        .init();
    match run(Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(std::io::stderr().lock(), "error: {error}");
            ExitCode::from(if error.is_usage() { 2 } else { 1 })
        }
    }
}

fn run(args: Args) -> Result<(), GatewayError> {
    let stop = on_signals()?;
    match args.command {
        Command::Out(args) => out::run(&args, &stop),
        Command::In(args) => inward::run(&args, &stop),
        Command::Route(args) => route::run(&args, &stop),
        Command::Load(args) => load::run(&args, &stop),
        Command::LoadSender(args) => load::send(&args, &stop),
    }
}

/// Set by the first signal; a second one half a second or more later ends the process with 130.
fn on_signals() -> Result<Arc<AtomicBool>, GatewayError> {
    let failed = |e: &dyn std::fmt::Display| GatewayError::Signals(e.to_string());
    let signals: SigSet = [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP].into_iter().collect();
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    let mut first = None;
    ctrlc::set_handler(move || {
        let now = Instant::now();
        flag.store(true, Ordering::SeqCst);
        if now.duration_since(*first.get_or_insert(now)) > TOGETHER {
            std::process::exit(SECOND_SIGNAL);
        }
    })
    .map_err(|e| failed(&e))?;
    // The handler has a thread of its own; in any other a signal could break off a wait of the bus.
    signals.thread_block().map_err(|e| failed(&e))?;
    Ok(stop)
}
