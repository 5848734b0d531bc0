//! Warm starts: continues from a checkpoint that fits. Without one the start is cold, and the log
//! says why.

use super::Failure;
use super::wiring::identity;
use crate::checkpoint;
use crate::config::Config;
use crate::messages::{ErrorCode, LastError};
use crate::node::identifier::Identifier;
use crate::runner::Board;
use std::path::Path;

/// Where checkpoints are.
///
/// # Errors
/// If `checkpoint.dir` is not set.
pub(super) fn dir(config: &Config) -> Result<&Path, Failure> {
    let dir = config.checkpoint.dir.as_deref();
    dir.ok_or_else(|| Failure::Usage("--warm needs checkpoint.dir, the directory of the checkpoints".to_owned()))
}

/// Loads the checkpoint of the configured robot into a node; gives its bytes, or `None` if the
/// start is cold.
///
/// # Errors
/// If `checkpoint.dir` is not set.
pub(super) fn start(
    config: &Config,
    node: &mut dyn Identifier,
    board: Option<&Board>,
) -> Result<Option<Vec<u8>>, Failure> {
    let path = checkpoint::path(dir(config)?, &config.bus.robot);
    let used = match checkpoint::read(&path) {
        Ok(None) => {
            tracing::warn!(
                "no checkpoint {}; starting cold (run and identifier write one, identify does not)",
                path.display()
            );
            return Ok(None);
        }
        Ok(Some(bytes)) => checkpoint::decode(&bytes, &identity(config))
            .map_err(|e| e.to_string())
            .and_then(|state| node.load(&state).map(|()| state.block).map_err(|e| e.to_string()))
            .map(|block| (bytes, block)),
        Err(e) => Err(e.to_string()),
    };
    match used {
        Ok((bytes, block)) => {
            tracing::info!(block, "warm start from {}", path.display());
            Ok(Some(bytes))
        }
        Err(why) => {
            tracing::error!("checkpoint {} is not used: {why}; starting cold", path.display());
            if let Some(board) = board {
                board.tell(LastError::with_text(ErrorCode::CheckpointUnused, 0, &why));
                Board::count(&board.checkpoints_failed);
            }
            Ok(None)
        }
    }
}
