//! Trials of the evidence: other arms, motions, sensors and seeds than those of our own studies;
//! the tables of docs/trials.md.
//!
//! What is on trial is not θ̂ alone but what is published with it: σ, `usable`, `use_ok`. A
//! **dangerous block** has `use_ok = 1` and a usable parameter, or a derived value, that is more
//! than 5 of its σ and more than 0.5 % off.
//!
//! A [`Spec`] says what is tried and gives the settings of the configuration, so that each case can
//! be run again by hand; [`Trial::run`] sends the samples of the simulated machine through the
//! identifier and scores what it publishes, beside the Cramér–Rao bound.

mod axis;
mod bound;
mod cases;
mod disturbance;
mod drawn;
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
pub use run::{Trial, rest_instant};
pub use score::{Danger, ParameterScore, TrialResult};
pub use spec::{Arm, Motion, TrialSpec};
pub use table::{CaseResult, trials_document};
