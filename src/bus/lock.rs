//! One plant, one identifier, one run, one gateway per robot and domain.

use super::lock_file::open_lock;
use super::{BusError, Domain, domain::check_name};
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, Write};
use std::time::Duration;

/// Number of attempts before a taken lock is reported.
const LOOKS: usize = 5;
const PAUSE: Duration = Duration::from_millis(5);

/// A role, of which there can be only one per robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Publishes samples.
    Plant,
    /// Publishes estimates and status.
    Identifier,
    /// Has launched the others.
    Run,
    /// Publishes commands to the machine.
    Controller,
    /// Carries the topics to other hosts, or brings them from there.
    Gateway,
}

impl Role {
    fn file_stem(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Identifier => "identifier",
            Self::Run => "run",
            Self::Controller => "controller",
            Self::Gateway => "gateway",
        }
    }

    fn with_article(self) -> &'static str {
        match self {
            Self::Plant => "a plant",
            Self::Identifier => "an identifier",
            Self::Run => "a run",
            Self::Controller => "a controller",
            Self::Gateway => "a gateway",
        }
    }
}

/// Holds a role of a robot for as long as it lives.
///
/// The kernel releases the lock when the process ends, in any way; a leftover file has no meaning.
#[derive(Debug)]
pub struct RoleLock {
    _file: File,
}

impl RoleLock {
    /// Takes the role, or reports its holder.
    ///
    /// # Errors
    /// If the robot's name is invalid, another process has the role, or the lock cannot be used.
    pub fn acquire(domain: &Domain, robot: &str, role: Role) -> Result<Self, BusError> {
        check_name("robot", robot)?;
        let name = format!("{robot}.{}.lock", role.file_stem());
        let (mut file, taken) = open_lock(domain, &name, |file| {
            // A process that inspects the domain holds the lock for an instant, so a refusal is
            // checked again.
            for _ in 0..LOOKS {
                match file.try_lock() {
                    Ok(()) => return Ok((file.try_clone()?, false)),
                    Err(TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
                    Err(TryLockError::Error(source)) => return Err(source),
                }
            }
            Ok((file.try_clone()?, true))
        })?;
        if taken {
            return Err(BusError::AlreadyRunning {
                role: role.with_article(),
                robot: robot.into(),
                domain: domain.name().into(),
                pid: holder(&mut file).unwrap_or_else(|| "?".into()),
            });
        }
        let write = |file: &mut File| {
            file.set_len(0)?;
            file.write_all(format!("{}\n", std::process::id()).as_bytes())
        };
        write(&mut file).map_err(|source| BusError::Lock {
            path: domain.root().join(&name),
            source,
        })?;
        Ok(Self { _file: file })
    }
}

/// The process that holds a role, or held it last; `None` if there was none.
pub(super) fn role_holder(domain: &Domain, robot: &str, role: Role) -> Option<i32> {
    let path = domain.root().join(format!("{robot}.{}.lock", role.file_stem()));
    std::fs::read_to_string(path).ok()?.strip_suffix('\n')?.parse().ok()
}

/// The process id in a lock file. The holder writes it just after locking, so an empty file is read
/// again.
fn holder(file: &mut File) -> Option<String> {
    for _ in 0..20 {
        let mut text = String::new();
        file.rewind().ok()?;
        file.read_to_string(&mut text).ok()?;
        if let Some(pid) = text.strip_suffix('\n').filter(|pid| !pid.is_empty()) {
            return Some(pid.into());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_second_holder_is_refused_with_the_first_ones_pid_and_the_lock_ends_with_its_holder() {
        let domain = Domain::new(&format!("lock-{}", std::process::id())).expect("valid name");
        let first = RoleLock::acquire(&domain, "arm", Role::Plant).expect("free");
        let error = RoleLock::acquire(&domain, "arm", Role::Plant)
            .expect_err("taken")
            .to_string();
        assert!(error.contains(&format!("process {}", std::process::id())), "{error}");
        assert!(error.contains("--domain"), "{error}");
        RoleLock::acquire(&domain, "arm", Role::Identifier).expect("another role");
        RoleLock::acquire(&domain, "leg", Role::Plant).expect("another robot");
        drop(first);
        RoleLock::acquire(&domain, "arm", Role::Plant).expect("free again");
        std::fs::remove_dir_all(domain.root()).expect("clean up");
    }
}
