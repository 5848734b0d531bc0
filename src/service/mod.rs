//! The programs as library functions: command lines, logging, exit codes, and the wiring of nodes, bus and runner.
//!
//! The files in `bins/` call these and nothing else, and `thetabus` offers the same three roles to `thetabus run`.

mod args;
mod check;
mod child;
mod compare;
mod exit;
mod identifier;
mod identify_log;
mod launcher;
mod logging;
mod monitor;
mod out_dir;
mod plant;
mod progress;
mod wiring;

pub use args::{CommonArgs, CompareArgs, IdentifierArgs, LogFormat, MonitorArgs, PlantArgs, RunArgs, VERSION};
pub use check::config_check;
pub use compare::run as compare;
pub use exit::{EXIT_CODES, Exit, Failure, main_with};
pub use identifier::run as identifier;
pub use identify_log::run as identify_log;
pub use launcher::run as launch;
pub use monitor::run as monitor;
pub use plant::run as plant;
