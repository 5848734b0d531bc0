//! The program `studies`: the tables in `docs/`, made by the same nodes as those of the service.

mod args;
mod compare;
mod output;
mod robots;
mod track;
mod trials;

pub use args::{CompareArgs, RobotsArgs, TrackArgs, TrialsArgs};
pub use compare::run as compare;
pub use robots::run as robots;
pub use track::run as track;
pub use trials::{run as trials, trial};
