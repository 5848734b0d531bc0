//! The three roles as values: messages in, messages out, no I/O, no clock. The runner waits, the
//! node computes.

mod block_grid;
mod block_history;
pub mod block_learner;
mod bound;
pub mod command;
mod command_queue;
mod estimate_message;
mod freeze;
pub mod identifier;
mod identifier_object;
mod identifier_options;
mod lacking;
pub mod learner;
mod misfit;
pub mod model;
pub mod monitor;
pub mod plant;
pub mod predicted_input;
mod replayed;
#[cfg(feature = "robot")]
pub mod robot;
#[cfg(feature = "robot")]
mod robot_evidence;
#[cfg(feature = "robot")]
pub mod robot_model;
#[cfg(feature = "robot")]
mod rowless;
mod sample_gate;
#[cfg(feature = "sim")]
pub mod simulated_plant;
pub mod state_words;
mod status_tracker;
pub mod stream;
#[cfg(test)]
mod tests;
