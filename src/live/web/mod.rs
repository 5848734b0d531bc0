//! The same in a browser: one page, embedded in the program, fed by server-sent events.
//!
//! ```text
//! LiveState ─▶ feed ─▶ events of one kind for all browsers ─▶ server (hyper, one thread)
//!                                 browser ─▶ POST /control ─▶ guard ─▶ the caller's control thread
//! ```
//!
//! There is no real-time code here, and nothing can block the caller: it updates a state behind a
//! lock a few times per second, and everything else runs on the server's thread. A browser that
//! does not keep up misses updates and gets the complete state again; one that never reads is cut
//! off.

mod body;
mod feed;
mod guard;
mod patience;
mod server;

pub use feed::Feed;
pub use server::{ControlRequest, WebOptions, WebServer};
