//! Live views of a running identification.
//!
//! ```text
//! estimates, status, samples ─▶ LiveState ─┬─ line      one line of text per block
//!                                          ├─ table     in place on a terminal
//!                                          └─ web       a page in a browser (feature `web`)
//! ```
//!
//! [`LiveState`] takes messages and returns a [`View`], without I/O or clock. All views show the
//! same texts and numbers.

#[cfg(feature = "foxglove")]
mod foxglove;
mod history;
mod line;
mod quantity;
mod signals;
mod state;
mod table;
mod terminal;
mod view;
#[cfg(feature = "web")]
pub mod web;

#[cfg(feature = "foxglove")]
pub use foxglove::{FoxgloveServer, FoxgloveStartError};
pub use history::{History, Point};
pub use line::{block_line, progress_line};
pub use quantity::{About, Quantity};
pub use signals::{SignalPoint, Signals};
pub use state::LiveState;
pub use table::{TableContext, draw};
pub use terminal::{Key, Screen, columns};
pub use view::{Health, Row, Times, Trend, View};
