//! What a running identification looks like, for people who watch it.
//!
//! ```text
//! estimates, status, samples ─▶ LiveState ─┬─ line      one readable line per block
//!                                          ├─ table     in place on a terminal
//!                                          └─ web       a page in a browser (feature `web`)
//! ```
//!
//! [`LiveState`] is plain: messages in, a [`View`] out, no I/O and no clock. All views show the
//! same words and numbers.

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
