//! The programs as library functions: command lines, logging, exit codes, and the wiring of nodes,
//! bus and runner.
//!
//! The files in `bins/` only call these functions, and `thetabus run` starts the same three roles
//! of `thetabus`.

mod advice;
mod app;
mod args;
mod bench;
mod calibrate;
mod cell;
mod check;
mod child;
mod children;
mod commands;
mod controller;
mod ctl;
mod ctl_args;
mod description;
mod desk;
mod desk_work;
mod doctor;
mod excite;
mod exit;
mod export;
mod failure;
mod file_args;
mod foreign;
#[cfg(test)]
mod fuzz;
mod identifier;
mod identify;
mod identify_log;
mod identify_robot;
mod launcher;
mod live;
mod load;
mod logging;
mod monitor;
mod new_file;
mod offline_run;
mod open_files;
mod out_dir;
mod plant;
mod progress;
mod readiness;
mod record;
mod replay;
mod report;
mod robot;
mod robot_args;
mod robot_file;
mod robot_log;
mod robot_profile;
mod robot_urdf;
mod role_args;
mod run_info;
mod script;
mod sparse;
#[cfg(feature = "studies")]
pub mod studies;
mod supervision;
mod ticker;
mod usage;
mod warm;
mod watch;
mod web_control;
mod wiring;

pub use app::app;
pub use args::{CommonArgs, LogFormat, TableFormat, VERSION};
pub use bench::{BenchArgs, run as bench};
pub use calibrate::run as calibrate;
pub use check::{config_check, config_new, config_show};
pub use controller::run as controller;
pub use ctl::run as ctl;
pub use ctl_args::{CtlArgs, CtlCommand};
pub use doctor::run as doctor;
use excite::check_motion;
pub use excite::run as excite;
pub use exit::{EXIT_CODES, main_with};
pub use export::run as export;
pub use failure::{Exit, Failure};
pub use file_args::{DoctorArgs, ExportArgs, IdentifyArgs, ReplayArgs, ReportArgs, SpanArgs};
pub use identifier::run as identifier;
pub use identify::run as identify;
pub use launcher::run as launch;
pub use load::run as load;
pub use monitor::run as monitor;
pub use plant::run as plant;
pub use replay::run as replay;
pub use report::run as report;
pub use robot_args::{CalibrateArgs, ExciteArgs, UrdfArgs};
pub use robot_urdf::run as urdf;
pub use role_args::{ControllerArgs, IdentifierArgs, MonitorArgs, PlantArgs, RunArgs, WatchArgs, WebArgs};
pub use watch::run as watch;
