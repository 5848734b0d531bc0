//! Errors of the bus, with messages for the person who must fix them.

use super::Topic;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Version of iceoryx2 of this program; peers need the same.
pub const ICEORYX2_VERSION: &str = "0.10.0";

/// Why something on the bus failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BusError {
    /// A domain or robot name that is not allowed.
    #[error("{what} name {name:?}: expected 1 to 32 characters of [a-z0-9_-]")]
    Name {
        /// `domain` or `robot`.
        what: &'static str,
        /// What was given.
        name: String,
    },
    /// The domain's paths are too long for sockets.
    #[error(
        "domain {domain:?}: the paths of its sockets below {} would take {len} bytes, but the system allows {max}; \
         use {}a shorter $XDG_RUNTIME_DIR",
        root.display(),
        match longest {
            0 => String::new(),
            longest => format!("a domain name of at most {longest} characters, or "),
        }
    )]
    SocketPath {
        /// The domain.
        domain: String,
        /// Its directory.
        root: PathBuf,
        /// Bytes needed.
        len: usize,
        /// Bytes allowed.
        max: usize,
        /// Characters that a domain name may have here.
        longest: usize,
    },
    /// The directory of all domains depends on the working directory.
    #[error(
        "$XDG_RUNTIME_DIR: expected a path from the root, such as /run/user/1000, got {dir:?}; set it so, or unset it for /tmp"
    )]
    RelativeRuntimeDir {
        /// Its value.
        dir: PathBuf,
    },
    /// The domain's directory cannot be created or read.
    #[error(
        "domain {domain:?}: directory {} cannot be used: {source}{}",
        root.display(),
        match root.starts_with("/tmp") {
            true => "",
            false => "; it is below $XDG_RUNTIME_DIR: let that name a directory of this user, or unset it for /tmp",
        }
    )]
    Root {
        /// The domain.
        domain: String,
        /// Its directory.
        root: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The domain's directory belongs to another user.
    #[error(
        "domain {domain:?}: {} must be a directory of user {uid}, but it is {kind} of user {found}; \
         remove it or use another --domain",
        root.display()
    )]
    RootOwner {
        /// The domain.
        domain: String,
        /// Its directory.
        root: PathBuf,
        /// Our user.
        uid: u32,
        /// Its owner.
        found: u32,
        /// `a directory`, `a symbolic link`, `a file`.
        kind: &'static str,
    },
    /// The domain's directory is open to others.
    #[error(
        "domain {domain:?}: directory {} has mode {mode:04o}, expected 0700: other users could have put something into it; \
         remove it or use another --domain",
        root.display()
    )]
    RootMode {
        /// The domain.
        domain: String,
        /// Its directory.
        root: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// Another user has an object under a name of this domain.
    #[error(
        "domain {domain:?}: {} must be a file of user {uid}, but it is of user {found} or is not a file; have it removed, \
         or use another --domain",
        path.display()
    )]
    ForeignObject {
        /// The domain.
        domain: String,
        /// The object.
        path: PathBuf,
        /// Our user.
        uid: u32,
        /// Its owner.
        found: u32,
    },
    /// An operation exceeded its time limit.
    #[error(
        "domain {domain:?}: {action} has not ended within {limit_s} s; another program in this domain may be stopped: \
         `thetabus doctor --domain {domain}` shows the programs; continue or end that one, or use another --domain"
    )]
    TimeLimit {
        /// The domain.
        domain: String,
        /// `joining`, `cleaning up`.
        action: &'static str,
        /// The time limit \[s\].
        limit_s: f64,
    },
    /// The system refuses to start a thread.
    #[error(
        "domain {domain:?}: {action} needs a thread of its own, and the system gives none ({source}); raise the limit of threads: \
         `ulimit -u` of this user, TasksMax of a systemd unit, --pids-limit of a container"
    )]
    Thread {
        /// The domain.
        domain: String,
        /// The operation: `joining`, `cleaning up`.
        action: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// A lock file cannot be used.
    #[error("lock file {}: {source}", path.display())]
    Lock {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The role is taken.
    #[error(
        "robot {robot:?} in domain {domain:?} has {role} already, process {pid}; stop it first, or use another --domain \
         (or --robot) to run beside it"
    )]
    AlreadyRunning {
        /// With its article: `a plant`, `an identifier`.
        role: &'static str,
        /// The robot.
        robot: String,
        /// The domain.
        domain: String,
        /// Process id of the holder, `?` if it could not be read.
        pid: String,
    },
    /// This process could not become part of the domain.
    #[error("domain {domain:?}: cannot join the bus below {}: {cause}", root.display())]
    Join {
        /// The domain.
        domain: String,
        /// Its directory.
        root: PathBuf,
        /// What iceoryx2 says.
        cause: String,
    },
    /// A topic could not be opened or created.
    #[error("topic {topic} of robot {robot:?} in domain {domain:?}: {problem}")]
    Topic {
        /// The topic.
        topic: Topic,
        /// The robot.
        robot: String,
        /// The domain.
        domain: String,
        /// Expected, found, and what to do.
        problem: String,
    },
    /// Sending or receiving failed.
    #[error("topic {topic}: {action} failed: {cause}")]
    Transfer {
        /// The topic.
        topic: Topic,
        /// What was tried.
        action: &'static str,
        /// What iceoryx2 says.
        cause: String,
    },
    /// A message of another schema arrived.
    #[error(
        "topic {topic}: a message with schema version {found} arrived, expected {expected}; \
         build both programs from the same version of thetabus"
    )]
    Schema {
        /// The topic.
        topic: Topic,
        /// Ours.
        expected: u32,
        /// Theirs.
        found: u32,
    },
    /// The shared memory is too small.
    #[error(
        "/dev/shm has {available} bytes left, but topic {topic} of robot {robot:?} may need {needed}; free some, or enlarge it \
         (`mount -o remount,size=… /dev/shm`, in a container `--shm-size`)"
    )]
    SharedMemory {
        /// The topic.
        topic: Topic,
        /// The robot.
        robot: String,
        /// Bytes needed at worst.
        needed: u64,
        /// Bytes available.
        available: u64,
    },
    /// A machine cannot be opened, or cannot send, as requested.
    #[error("{problem}")]
    Machine {
        /// Expected and found.
        problem: String,
    },
    /// No process serves `control`.
    #[error(
        "no identifier of robot {robot:?} runs in domain {domain:?}; start one, or name another with --robot and --domain"
    )]
    NoIdentifier {
        /// The robot.
        robot: String,
        /// The domain.
        domain: String,
    },
    /// The identifier did not answer.
    #[error(
        "the identifier of robot {robot:?} in domain {domain:?} did not answer within {limit_s} s; it hangs, is stopped, or has just ended"
    )]
    NoAnswer {
        /// The robot.
        robot: String,
        /// The domain.
        domain: String,
        /// The time limit \[s\].
        limit_s: f64,
    },
    /// No consumer attached in time.
    #[error(
        "topic {topic} of robot {robot:?} in domain {domain:?}: {attached} of {expected} consumers attached within {limit_s} s; \
         start them, or set bus.delivery = \"realtime\" to run without waiting for anybody"
    )]
    NoConsumers {
        /// The topic.
        topic: Topic,
        /// The robot.
        robot: String,
        /// The domain.
        domain: String,
        /// How many attached.
        attached: usize,
        /// How many were expected.
        expected: usize,
        /// The time limit \[s\].
        limit_s: f64,
    },
}
