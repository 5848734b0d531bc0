//! Limit on open files, for many robots: each topic uses several files of shared memory.

use nix::sys::resource::{Resource, getrlimit, setrlimit};

/// Raises the limit on open files as far as permitted. A refusal shows later, if a file cannot be
/// opened.
pub(super) fn raise_limit() {
    if let Ok((soft, hard)) = getrlimit(Resource::RLIMIT_NOFILE)
        && soft < hard
    {
        let _ = setrlimit(Resource::RLIMIT_NOFILE, hard, hard);
    }
}
