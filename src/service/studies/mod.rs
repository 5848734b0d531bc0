//! The program `studies`: generates the tables in `docs/` with the same nodes as the service.

mod args;
mod compare;
mod efficiency;
mod output;
mod random_robots;
mod robots;
mod track;
mod trials;

pub use args::{CompareArgs, EfficiencyArgs, RobotsArgs, TrackArgs, TrialsArgs};
pub use compare::run as compare;
pub use efficiency::run as efficiency;
pub use random_robots::run as random_robots;
pub use robots::run as robots;
pub use track::run as track;
pub use trials::{run as trials, trial};
