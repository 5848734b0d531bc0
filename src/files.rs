//! Files that appear completely or not at all, and are never written through another user's link.
//!
//! Everything is written to `TARGET.PID.tmp` next to its target and renamed. The temporary file is
//! opened with `O_CREAT | O_EXCL`, which POSIX lets fail on a symbolic link, dangling or not, and
//! it is locked (`flock`) while its process lives. So a leftover of a killed process can be
//! distinguished from a file in use, even if the process id is reused, and the next writer of the
//! same target removes it.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Number of names to try: a name occupied by another user, for example by a link, must not block
/// the service.
const NAMES: u32 = 16;

/// A file without its final name; removed on drop unless it gets it.
pub(crate) struct Temporary {
    file: File,
    path: PathBuf,
    target: PathBuf,
    named: bool,
}

impl Temporary {
    /// A new file next to `target`, after removing leftovers of killed processes for the same
    /// target.
    ///
    /// # Errors
    /// If the directory cannot be written to.
    pub(crate) fn beside(target: &Path) -> io::Result<Self> {
        sweep(target);
        let pid = std::process::id();
        for n in 0..NAMES {
            let name = match n {
                0 => format!("{pid}.tmp"),
                n => format!("{pid}-{n}.tmp"),
            };
            let path = with_suffix(target, &name);
            let file = match OpenOptions::new().write(true).read(true).create_new(true).open(&path) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
                file => file?,
            };
            // Before it was locked, another process's clean-up may have taken the file for a
            // leftover.
            let locked = !matches!(file.try_lock(), Err(TryLockError::WouldBlock));
            if locked && is_still(&path, &file) {
                return Ok(Self {
                    file,
                    path,
                    target: target.to_path_buf(),
                    named: false,
                });
            }
        }
        Err(io::Error::new(
            io::ErrorKind::AlreadyExists,
            format!("all names of a temporary file beside {} are taken", target.display()),
        ))
    }

    /// The open file.
    pub(crate) fn file(&self) -> &File {
        &self.file
    }

    /// Gives the file its name, replacing an existing file.
    ///
    /// # Errors
    /// If the system refuses to rename it.
    #[cfg(feature = "report")]
    pub(crate) fn replace(mut self) -> io::Result<()> {
        fs::rename(&self.path, &self.target)?;
        self.named = true;
        Ok(())
    }

    /// Gives the file its name, which must not exist.
    ///
    /// # Errors
    /// `AlreadyExists` if it exists; other errors of the system.
    pub(crate) fn appear(mut self) -> io::Result<()> {
        // A link fails on an existing name, while a rename would overwrite it.
        match fs::hard_link(&self.path, &self.target) {
            Ok(()) => {}
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => return Err(e),
            // a file system without hard links
            Err(_) => {
                vacant(&self.target)?;
                fs::rename(&self.path, &self.target)?;
                self.named = true;
            }
        }
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.named {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Fails with `AlreadyExists` if the name exists, including a dangling link.
pub(crate) fn vacant(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Ok(_) => Err(io::ErrorKind::AlreadyExists.into()),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(e),
    }
}

/// Writes a file completely or not at all; an existing one stays unchanged until then.
///
/// # Errors
/// If the directory cannot be written to or the disk is full.
#[cfg(feature = "report")]
pub(crate) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let temporary = Temporary::beside(path)?;
    io::Write::write_all(&mut temporary.file(), bytes)?;
    temporary.replace()
}

/// The same, and the data are on the disk when this returns.
///
/// # Errors
/// As [`write`].
#[cfg(feature = "service")]
pub(crate) fn write_synced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let temporary = Temporary::beside(path)?;
    io::Write::write_all(&mut temporary.file(), bytes)?;
    temporary.file().sync_all()?;
    temporary.replace()?;
    File::open(directory(path))?.sync_all()
}

/// Removes leftovers of killed processes for a target. Errors are ignored, because they do not
/// affect the target itself.
fn sweep(target: &Path) {
    let Some(name) = target.file_name() else { return };
    let name = name.as_encoded_bytes();
    for entry in fs::read_dir(directory(target)).into_iter().flatten().flatten() {
        let found = entry.file_name();
        let middle = found
            .as_encoded_bytes()
            .strip_prefix(name)
            .and_then(|rest| rest.strip_prefix(b"."))
            .and_then(|rest| rest.strip_suffix(b".tmp"));
        let ours = middle.is_some_and(|m| !m.is_empty() && m.iter().all(|b| b.is_ascii_digit() || *b == b'-'));
        // The type of the entry itself, because a link is not ours.
        if !ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        let path = entry.path();
        let Ok(file) = File::open(&path) else { continue };
        if file.try_lock().is_ok() && is_still(&path, &file) {
            let _ = fs::remove_file(&path);
        }
    }
}

/// Whether the name belongs to the open file.
fn is_still(path: &Path, file: &File) -> bool {
    match (fs::symlink_metadata(path), file.metadata()) {
        (Ok(named), Ok(open)) => (named.dev(), named.ino()) == (open.dev(), open.ino()),
        _ => false,
    }
}

fn directory(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(suffix);
    PathBuf::from(name)
}

#[cfg(all(test, feature = "service"))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap().flatten();
        let mut names: Vec<String> = entries.map(|e| e.file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn fault_what_a_killed_process_has_left_is_removed_and_what_is_in_use_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("summary.json");
        // of an ended process, of an earlier process with this id, and files with similar names
        let left = [
            "summary.json.1.tmp".to_owned(),
            format!("summary.json.{}.tmp", std::process::id()),
        ];
        let others = [
            "summary.json.bak.tmp",
            "summary.json..tmp",
            "other.json.1.tmp",
            "summary.json.1.tmp.old",
        ];
        for name in left.iter().map(String::as_str).chain(others) {
            fs::write(dir.path().join(name), "x").unwrap();
        }
        let in_use = Temporary::beside(&target).unwrap();
        write_synced(&target, b"whole").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"whole");
        let mut expected: Vec<String> = others.map(str::to_owned).to_vec();
        expected.extend(["summary.json".to_owned(), left[1].clone()]);
        expected.sort();
        assert_eq!(
            names(dir.path()),
            expected,
            "the one in use has the name of this process"
        );
        drop(in_use);
        assert!(!names(dir.path()).contains(&left[1]));
    }

    #[test]
    fn fault_no_link_is_followed_at_any_name_that_is_written() {
        let dir = tempfile::tempdir().unwrap();
        let victim = dir.path().join("victim");
        let target = dir.path().join("arm.checkpoint");
        // a dangling link that would create the victim, and one that would overwrite it
        for exists in [false, true] {
            if exists {
                fs::write(&victim, "precious").unwrap();
            }
            for link in [
                target.clone(),
                with_suffix(&target, &format!("{}.tmp", std::process::id())),
            ] {
                let _ = fs::remove_file(&link);
                symlink(&victim, &link).unwrap();
            }
            assert!(
                Temporary::beside(&target).unwrap().appear().is_err(),
                "something has the name"
            );
            write(&target, b"mine").unwrap();
            assert!(fs::symlink_metadata(&target).unwrap().is_file());
            assert_eq!(fs::read(&target).unwrap(), b"mine");
            assert_eq!(fs::read(&victim).ok(), exists.then(|| b"precious".to_vec()));
        }
    }

    #[test]
    fn fault_a_name_that_is_taken_is_not_written_over_and_nothing_stays() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("run.mcap");
        Temporary::beside(&target).unwrap().appear().unwrap();
        assert_eq!(names(dir.path()), ["run.mcap"]);
        let error = Temporary::beside(&target).unwrap().appear().unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(names(dir.path()), ["run.mcap"]);
    }

    #[test]
    fn fault_a_directory_or_a_full_one_leaves_the_file_that_was_there() {
        let dir = tempfile::tempdir().unwrap();
        assert!(write(&dir.path().join("gone").join("x"), b"x").is_err());
        let target = dir.path().join("taken");
        fs::create_dir(&target).unwrap();
        assert!(write(&target, b"x").is_err());
        assert_eq!(names(dir.path()), ["taken"]);
    }
}
