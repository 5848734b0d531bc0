//! Repeats the commands of a recording at the same borders.

use super::commands::{Commands, Wanted};
use super::{Failure, report};
use crate::messages::{Command, Journal, Sample};
use crate::node::command::Order;
use crate::node::identifier::Identifier;
use crate::recording::read_journal;
use std::collections::{HashSet, VecDeque};
use std::path::Path;

/// The journal of a recording, for a node.
pub(super) struct Script {
    commands: Commands,
    entries: VecDeque<Journal>,
    /// Streams that have begun.
    seen: HashSet<u64>,
    now: u64,
    skipped: u64,
}

/// The commands of a recording; warns about damaged ones.
///
/// # Errors
/// If the recording cannot be read.
pub(super) fn recorded_commands(recording: &Path) -> Result<Vec<Journal>, Failure> {
    let (entries, damaged) = read_journal(recording).map_err(report::unreadable)?;
    if damaged > 0 {
        tracing::warn!(
            damaged,
            "commands of the recording cannot be read and are left out: estimates may differ from the recorded ones"
        );
    }
    Ok(entries)
}

impl Script {
    /// Reads the journal of a recording, for a node that matches `commands`.
    ///
    /// # Errors
    /// If the recording cannot be read.
    pub(super) fn read(recording: &Path, commands: Commands) -> Result<Self, Failure> {
        let entries = VecDeque::from(recorded_commands(recording)?);
        if !entries.is_empty() {
            tracing::info!(entries = entries.len(), "the recording's commands are repeated");
        }
        Ok(Self {
            commands,
            entries,
            seen: HashSet::new(),
            now: 0,
            skipped: 0,
        })
    }

    /// Sends the node the commands that took effect before this sample; call it before passing the
    /// sample to the node.
    pub(super) fn before(&mut self, sample: &Sample, node: &mut dyn Identifier) {
        if self.entries.is_empty() {
            return;
        }
        let new_stream = self.now != sample.stream_id;
        while let Some(entry) = self.entries.front() {
            let due = match entry.stream_id {
                0 => true,
                stream_id if stream_id == sample.stream_id => sample.seq >= entry.request.from_seq,
                // a stream that is over; a later one is awaited
                stream_id => self.seen.contains(&stream_id),
            };
            if !due {
                break;
            }
            self.give(node);
        }
        if new_stream {
            self.now = sample.stream_id;
            self.seen.insert(sample.stream_id);
        }
        while node.take_done().is_some() {}
    }

    fn give(&mut self, node: &mut dyn Identifier) {
        let Some(entry) = self.entries.pop_front() else { return };
        let given = match self.commands.prepare(&entry.request) {
            Ok(Wanted::Order(change, _)) => node
                .offer(Order::new(0, 0, change).for_stream(entry.request.stream))
                .map(|_| ())
                .map_err(|_| "the node has no room for it".to_owned()),
            Ok(_) => Ok(()),
            Err(why) => Err(why),
        };
        if let Err(why) = given {
            self.skipped += 1;
            let command = Command::from_wire(entry.request.command).map_or("command", Command::name);
            tracing::error!(
                block = entry.block,
                "a recorded {command} is not repeated, so estimates differ from the recorded ones: {why}"
            );
        }
    }
}
