//! Requirements of a test besides the programs: tools, rights, other users.

use crate::support::Process;
use nix::unistd::{Gid, Uid};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use tempfile::TempDir;

/// May this user run the command? If not, the test is skipped with a message, or fails if nothing
/// may be skipped.
pub fn permitted(command: &str, args: &[&str]) -> bool {
    let done = Command::new(command)
        .args(args)
        .current_dir("/")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    let permitted = done.is_ok_and(|status| status.success());
    if !permitted {
        let why = format!("not possible here: {command} {}", args.join(" "));
        assert!(std::env::var("THETABUS_REQUIRE_PEERS").as_deref() != Ok("1"), "{why}");
        eprintln!("skipped: {why}");
    }
    permitted
}

/// A user who needs no entry anywhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct User(pub u32);

impl User {
    pub fn own() -> Self {
        Self(Uid::effective().as_raw())
    }

    pub fn is_own(self) -> bool {
        self == Self::own()
    }

    /// A command of this user's.
    pub fn command(self, program: &str) -> Command {
        let mut command = Command::new(if self.is_own() { program } else { "setpriv" });
        if !self.is_own() {
            command.args(self.setpriv()).arg(program);
        }
        command.env_remove("XDG_RUNTIME_DIR");
        command
    }

    fn setpriv(self) -> [String; 4] {
        let Self(uid) = self;
        [
            format!("--reuid={uid}"),
            format!("--regid={uid}"),
            "--clear-groups".into(),
            "--".into(),
        ]
    }

    /// May we become this user, and run our programs then?
    pub fn is_possible(self) -> bool {
        let setpriv = self.setpriv();
        let become_user: Vec<&str> = setpriv.iter().map(String::as_str).collect();
        self.is_own()
            || permitted(
                "setpriv",
                &[&become_user[..], &[env!("CARGO_BIN_EXE_thetabus"), "--version"]].concat(),
            )
    }

    /// Runs a shell script; its success.
    pub fn can(self, script: &str, path: &Path) -> bool {
        let mut command = self.command("sh");
        command.args(["-c", script]).arg(path).current_dir("/");
        let done = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        done.expect("a shell").success()
    }
}

/// A domain and a directory of a user's.
pub struct Place {
    pub user: User,
    pub domain: String,
    pub dir: TempDir,
}

impl Place {
    pub fn new(user: User) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let n = COUNT.fetch_add(1, Ordering::Relaxed);
        Self::named(user, &format!("p{}-{n}", std::process::id()))
    }

    /// Several users may have a domain of the same name.
    pub fn named(user: User, domain: &str) -> Self {
        let dir = tempfile::tempdir().expect("a temporary directory");
        if !user.is_own() {
            let User(uid) = user;
            nix::unistd::chown(dir.path(), Some(Uid::from_raw(uid)), Some(Gid::from_raw(uid))).expect("we may");
        }
        Self {
            user,
            domain: domain.into(),
            dir,
        }
    }

    pub fn root(&self) -> PathBuf {
        PathBuf::from(format!("/tmp/thetabus-{}-{}", self.user.0, self.domain))
    }

    pub fn prefix(&self) -> String {
        format!("thetabus_{}_{}_", self.user.0, self.domain)
    }

    /// The domain's objects in /dev/shm.
    pub fn objects(&self) -> Vec<PathBuf> {
        let entries = std::fs::read_dir("/dev/shm").expect("/dev/shm").flatten();
        entries
            .filter(|entry| entry.file_name().to_string_lossy().starts_with(&self.prefix()))
            .map(|entry| entry.path())
            .collect()
    }

    /// A program of ours in this domain, below `before`: a tracer and its options, or nothing.
    pub fn command(&self, before: &[&str], program: &str, args: &[&str]) -> Command {
        let words = [before, &[program], args, &["--domain", &self.domain]].concat();
        let mut command = self.user.command(words[0]);
        command.args(&words[1..]).current_dir(self.dir.path());
        command
    }

    pub fn start(&self, program: &str, args: &[&str]) -> Process {
        Process::start(self.command(&[], program, args))
    }

    /// Leaves nothing of the domain.
    pub fn clear(&self) {
        let _ = std::fs::remove_dir_all(self.root());
        for object in self.objects() {
            let _ = std::fs::remove_file(object);
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.clear();
    }
}
