//! The program `studies`: the tables in `docs/`, made by the same nodes as those of the service.

mod args;
mod compare;
mod trials;

pub use args::{CompareArgs, TrialsArgs};
pub use compare::run as compare;
pub use trials::{run as trials, trial};
