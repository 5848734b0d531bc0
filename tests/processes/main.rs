//! The programs as users start them: real processes on real shared memory.
//!
//! Each test has a bus domain and a directory of its own, waits for conditions under a watchdog,
//! and leaves nothing behind.
#![cfg(feature = "service")]

mod browsers;
mod cell;
mod config;
mod control;
mod controller;
mod doctor;
#[cfg(feature = "foxglove")]
mod foxglove;
mod hostile;
mod isolation;
mod kills;
mod labels;
mod late;
mod limits;
mod live;
mod lockstep;
mod log;
mod loop_kills;
mod order;
mod own_plant;
mod peers;
mod progress;
mod readiness;
mod realtime;
mod recording;
mod robot;
mod robot_files;
mod run;
mod signals;
mod soak;
mod storm;
mod streams;
mod supervision;
mod support;
mod table;
mod users;
