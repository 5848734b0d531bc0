//! The launcher, the tools, and the three roles.
//!
//! ```text
//! run ─┬─ plant ── sample ──▶ identifier ── estimate ──▶ monitor ─▶ result table, files
//!      └─ one signal, one result
//! ```
#![forbid(unsafe_code)]

use std::process::ExitCode;
use thetabus::config::Catalog;

fn main() -> ExitCode {
    thetabus::service::app(Catalog::default())
}
