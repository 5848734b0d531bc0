//! How close estimators come to the smallest possible error: the tables of docs/efficiency.md.
//!
//! ```text
//! simulated run ─▶ samples as the bus has them ─┬▶ thetabus, as shipped
//!                                               ├▶ a Kalman filter with θ in its state
//!                                               └▶ off line: prediction errors, output errors,
//!                                                  least squares, instrumental variables
//! the same run without noise ─▶ the Cramér–Rao bound
//! ```
//!
//! All use the same positions, inputs and setpoints and know the sensors' noise. The six-axis robot
//! has its own estimators and bound, see `robot`.

mod arm;
mod axis;
mod estimators;
mod instruments;
mod prediction;
#[cfg(feature = "robot")]
mod robot;
#[cfg(feature = "robot")]
mod robot_bound;
#[cfg(feature = "robot")]
mod robot_regression;
#[cfg(feature = "robot")]
mod robot_table;
mod table;

pub use arm::arm_run;
pub use axis::axis_run;
pub use estimators::{Method, Outcome, Published};
#[cfg(feature = "robot")]
pub use robot::{ROBOT_RUN_S, RobotCase, RobotMethod, RobotMotion, RobotOutcome, RobotRunError};
#[cfg(feature = "robot")]
pub use robot_bound::{RobotBound, RobotTruth};
#[cfg(feature = "robot")]
pub use robot_table::{RobotRuns, robot_sections};
pub use table::{CaseRuns, KNOWABLE, efficiency_document};
