//! Trials of the evidence: with arms, motions, sensors and seeds other than those of the studies;
//! the tables of docs/trials.md.
//!
//! They test not only θ̂ but also the published evidence: σ, `usable`, `use_ok`. A **dangerous
//! block** has `use_ok = 1` and a usable parameter, or a derived value, that is more than 5 of its
//! σ and more than 0.5 % off.
//!
//! A [`Spec`] describes a case and gives the settings of the configuration, so each case can be run
//! again by hand; [`Trial::run`] passes the samples of the simulated machine to the identifier and
//! scores its estimates, with the Cramér–Rao bound.

mod axis;
mod bound;
mod cases;
mod disturbance;
mod drawn;
mod drawn_arm;
mod random_arm;
mod random_axis;
mod run;
mod score;
mod settings;
mod spec;
mod spread;
mod table;

pub use axis::{AxisMotion, AxisSpec};
pub use bound::CramerRaoBound;
pub use cases::{Case, Spec, full_cases, quick_cases};
pub use disturbance::Disturbance;
pub use drawn::drawn_errors;
pub use random_arm::{RandomArmSpec, Trouble};
pub use random_axis::{RandomAxisMotion, RandomAxisSpec};
pub use run::{Trial, rest_instant};
#[cfg(feature = "robot")]
pub(in crate::studies) use score::Truth;
pub use score::{Danger, ParameterScore, TrialResult};
pub use spec::{Arm, Motion, TrialSpec};
pub use table::{CaseResult, trials_document};
