//! Names within a recording.

/// Channel ids; fixed, so that a file whose definitions are damaged can still be read.
pub(super) mod channel {
    pub(in super::super) const SAMPLE: u16 = 1;
    pub(in super::super) const ESTIMATE: u16 = 2;
    pub(in super::super) const STATUS: u16 = 3;
    pub(in super::super) const RECORDER: u16 = 4;
    pub(in super::super) const JOINT_STATES: u16 = 5;
}

/// Name of the metadata record with [`RunInfo`](super::info::RunInfo).
pub(super) const RUN_METADATA: &str = "thetabus_run";
/// Name of the metadata records with commands to the identifier.
pub(super) const JOURNAL_METADATA: &str = "thetabus_journal";
/// Name of the metadata records with the clock of the following streams.
pub(super) const CLOCK_METADATA: &str = "thetabus_clock";
/// Name of the metadata record at the end of a finished file.
pub(super) const END_METADATA: &str = "thetabus_end";
