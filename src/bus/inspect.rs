//! Inspects a domain and its programs, and removes the resources of dead processes only.
//!
//! A resource is dead if it belongs to no living process: nodes whose lock the kernel has released,
//! and files and shared memory that no process holds open. Inspecting changes nothing and disturbs
//! no process.

use super::domain::check_name;
use super::half_made;
use super::membership::{Lock, RoleFile, exists, lock_members, others_live, remove_domain};
use super::objects::{SHM, entries, is_ours, is_service_memory, mapped_memory, refuse_foreign, unused};
use super::orphans;
use super::time_limit::within;
use super::watch::Watch;
use super::{BusError, Domain, wiped};
use iceoryx2::node::{Node, NodeState, NodeView};
use iceoryx2::prelude::{CallbackProgression, Config, LogLevel, Service, ipc, set_log_level_from_env_or};
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern;
use std::collections::{BTreeMap, HashSet};
use std::fs::DirEntry;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::Duration;

/// Younger objects may still be under construction.
const SETTLED: Duration = Duration::from_secs(10);
/// Inspecting a domain takes milliseconds, unless a half-made object blocks it.
const LOOK_LIMIT: Duration = Duration::from_secs(2);
/// Cleaning up takes tens of milliseconds per dead program.
const CLEAN_LIMIT: Duration = Duration::from_secs(20);

/// A program in a domain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeReport {
    /// Its own name; empty if that cannot be read.
    pub name: String,
    /// Its process.
    pub pid: Option<i32>,
    /// Its executable file.
    pub executable: String,
    /// Whether it is alive; `None` if unknown.
    pub alive: Option<bool>,
}

/// A service in a domain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServiceReport {
    /// `thetabus/arm/sample`.
    pub name: String,
    /// `publish-subscribe`, `event`, `request-response`, `blackboard`.
    pub pattern: &'static str,
    /// Type and size of its messages, if it has messages of one type.
    pub message: Option<(String, usize)>,
    /// Programs that have opened it.
    pub nodes: usize,
}

/// A role's lock.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LockReport {
    /// The robot.
    pub robot: String,
    /// `plant`, `identifier`, `run`, ….
    pub role: String,
    /// Its holder; `None` for a leftover file.
    pub holder: Option<String>,
}

/// Objects in /dev/shm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MemoryReport {
    /// Number of objects.
    pub objects: usize,
    /// Their size \[bytes\].
    pub bytes: u64,
    /// Of that, memory in use \[bytes\].
    pub resident_bytes: u64,
    /// Objects that no process has open, as far as this user can see.
    pub unused: usize,
}

/// State of a domain.
#[derive(Debug, Clone)]
pub struct DomainReport {
    /// The domain.
    pub domain: Domain,
    /// Its programs.
    pub nodes: Vec<NodeReport>,
    /// Its services.
    pub services: Vec<ServiceReport>,
    /// Services whose files cannot be read: of another iceoryx2 version, or damaged.
    pub unreadable_services: usize,
    /// Objects that have been half-made for longer than creation takes.
    pub half_made: Vec<String>,
    /// Programs and services could not be listed, because of a half-made object.
    pub is_blocked: bool,
    /// Processes whose shared memory was removed from /dev/shm while they use it.
    pub cut_off: Vec<i32>,
    /// Its locks.
    pub locks: Vec<LockReport>,
    /// Its shared memory.
    pub memory: MemoryReport,
    /// No process lives in it.
    pub abandoned: bool,
}

impl DomainReport {
    /// True if it contains dead resources; the files of a cleanly left domain do not count.
    pub fn has_dead(&self) -> bool {
        let left_behind = self.abandoned && (self.memory.objects > 0 || !self.services.is_empty());
        let half_made = self.is_blocked || !self.half_made.is_empty();
        left_behind
            || half_made
            || self.nodes.iter().any(|node| node.alive == Some(false))
            || self.unreadable_services > 0
    }

    /// What the removal of shared memory in use means, and what to do; `None` if there was none.
    pub fn removed_memory(&self) -> Option<String> {
        (!self.cut_off.is_empty()).then(|| wiped::words(&self.cut_off))
    }
}

/// The resources that [`clean`] removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cleaned {
    /// Dead programs whose resources were freed.
    pub nodes: usize,
    /// Further files and shared-memory objects.
    pub files: usize,
    /// The whole domain was removed.
    pub domain: bool,
}

/// All domains of this user, including those of which only shared memory is left.
pub fn domains() -> Vec<Domain> {
    set_log_level_from_env_or(LogLevel::Error);
    let mut found: BTreeMap<_, Domain> = BTreeMap::new();
    for root in Domain::roots() {
        found.insert((root.name().to_owned(), root.root().to_owned()), root);
    }
    let named: HashSet<String> = found.keys().map(|(name, _)| name.clone()).collect();
    let ours = format!("thetabus_{}_", nix::unistd::geteuid());
    for entry in entries(Path::new(SHM)).filter(is_ours) {
        let name = entry.file_name();
        let Some(name) = name.to_str().and_then(|name| domain_of_memory(name, &ours)) else {
            continue;
        };
        if !named.contains(name)
            && let Ok(domain) = Domain::new(name)
        {
            found.insert((name.to_owned(), domain.root().to_owned()), domain);
        }
    }
    found.into_values().collect()
}

/// `thetabus_1000_left-arm_<40 hexadecimal digits>_…` belongs to `left-arm` of user 1000, whose
/// objects begin with `ours`.
fn domain_of_memory<'a>(object: &'a str, ours: &str) -> Option<&'a str> {
    let rest = object.strip_prefix(ours)?;
    let name = rest.match_indices('_').map(|(at, _)| &rest[..at]).find(|name| {
        let hash = rest[name.len() + 1..].split('_').next().unwrap_or("");
        hash.len() == 40 && hash.bytes().all(|b| b.is_ascii_hexdigit())
    })?;
    check_name("domain", name).is_ok().then_some(name)
}

/// Inspects a domain.
///
/// # Errors
/// If the domain's directory belongs to another user or cannot be passed to iceoryx2, or another
/// user has an object under its names.
pub fn inspect(domain: &Domain) -> Result<DomainReport, BusError> {
    set_log_level_from_env_or(LogLevel::Error);
    let config = domain.config()?;
    domain.check_existing_root()?;
    refuse_foreign(domain)?;
    let half_made = settled_half_made(domain);
    let listed = within(domain, "looking at its programs", LOOK_LIMIT, move || {
        (nodes(&config), services(&config))
    });
    let is_blocked = matches!(listed, Err(BusError::TimeLimit { .. }));
    let (nodes, services) = match listed {
        Err(BusError::TimeLimit { .. }) => Default::default(),
        listed => listed?,
    };
    let files = entries(&domain.root().join("services")).count();
    let unreadable_services = if is_blocked {
        0
    } else {
        files.saturating_sub(services.len())
    };
    let locks = locks(domain);
    let lives = nodes.iter().any(|node| node.alive != Some(false));
    let abandoned = !lives && locks.iter().all(|lock| lock.holder.is_none()) && !is_member_held(domain);
    Ok(DomainReport {
        nodes,
        services,
        unreadable_services,
        half_made,
        is_blocked,
        cut_off: wiped::cut_off(domain),
        locks,
        memory: memory(domain),
        abandoned,
        domain: domain.clone(),
    })
}

fn nodes(config: &Config) -> Vec<NodeReport> {
    let mut nodes = Vec::new();
    // A domain without a directory has no nodes.
    let _ = Node::<ipc::Service>::list(config, |state| {
        nodes.push(node(&state));
        CallbackProgression::Continue
    });
    nodes.sort_by(|a, b| (&a.name, a.pid).cmp(&(&b.name, b.pid)));
    nodes
}

fn services(config: &Config) -> Vec<ServiceReport> {
    let mut services = Vec::new();
    let _ = ipc::Service::list(config, |details| {
        let fixed = &details.static_details;
        let (pattern, message) = match fixed.messaging_pattern() {
            MessagingPattern::PublishSubscribe(config) => {
                let payload = config.message_type_details().payload;
                (
                    "publish-subscribe",
                    Some((payload.type_name().to_string(), payload.size())),
                )
            }
            MessagingPattern::Event(_) => ("event", None),
            MessagingPattern::RequestResponse(_) => ("request-response", None),
            MessagingPattern::Blackboard(_) => ("blackboard", None),
            _ => ("of another kind", None),
        };
        services.push(ServiceReport {
            name: fixed.name().to_string(),
            pattern,
            message,
            nodes: details.dynamic_details.map_or(0, |details| details.nodes.len()),
        });
        CallbackProgression::Continue
    });
    services.sort_by(|a, b| (&a.name, a.pattern).cmp(&(&b.name, b.pattern)));
    services
}

/// The objects that stay half-made for longer than creation takes.
fn settled_half_made(domain: &Domain) -> Vec<String> {
    let names = || -> Vec<String> {
        let found = half_made::half_made(domain).into_iter();
        found.map(|(path, _)| path.display().to_string()).collect()
    };
    let first = names();
    if first.is_empty() {
        return first;
    }
    std::thread::sleep(half_made::GRACE);
    let second = names();
    first.into_iter().filter(|name| second.contains(name)).collect()
}

/// Removes the dead resources of a domain, and the whole domain if no process lives there.
///
/// # Errors
/// If the domain's directory or an object under its names belongs to another user, the directory
/// cannot be used, or a time limit has passed.
pub fn clean(domain: &Domain) -> Result<Cleaned, BusError> {
    set_log_level_from_env_or(LogLevel::Error);
    domain.check_existing_root()?;
    refuse_foreign(domain)?;
    // Keeps the clean-up from hanging if another process is killed meanwhile.
    let _watch = Watch::start(domain)?;
    let half_made = settled_half_made(domain).len();
    half_made::sweep(domain);
    orphans::sweep(domain);
    let own = domain.clone();
    let mut cleaned = within(domain, "cleaning up", CLEAN_LIMIT, move || clean_up(&own))??;
    cleaned.files += half_made.saturating_sub(half_made::half_made(domain).len());
    Ok(cleaned)
}

fn clean_up(domain: &Domain) -> Result<Cleaned, BusError> {
    let config = domain.config()?;
    // While it is held no process joins; one that waits for it finds the file removed and creates
    // another.
    if domain.root().exists() {
        let lock = lock_members(domain)?;
        let held = locks(domain).iter().any(|lock| lock.holder.is_some());
        if matches!(lock, Lock::Alone(_)) && !held && !others_live(&config, None) {
            return Ok(Cleaned {
                files: remove_domain(domain),
                domain: true,
                ..Cleaned::default()
            });
        }
        drop(lock);
    } else {
        return Ok(Cleaned {
            files: remove_domain(domain),
            domain: true,
            ..Cleaned::default()
        });
    }
    let mut cleaned = Cleaned::default();
    let (mut dead, mut living) = (Vec::new(), Vec::new());
    let _ = Node::<ipc::Service>::list(&config, |state| {
        match state {
            NodeState::Dead(view) => dead.push(view),
            NodeState::Alive(view) => living.push(view.id().pid::<ipc::Service>().ok().map(|pid| pid.value())),
            // Of unknown state: dead if its process is dead.
            NodeState::Inaccessible(id) | NodeState::Undefined(id) => {
                match id.pid::<ipc::Service>().ok().map(|pid| pid.value()) {
                    Some(pid) if !exists(pid) => cleaned.files += remove_node(domain, &id.value().to_string()),
                    pid => living.push(pid),
                }
            }
        }
        CallbackProgression::Continue
    });
    for view in dead {
        let id = view.id().value().to_string();
        if view.try_remove_stale_resources().is_ok() {
            cleaned.nodes += 1;
        }
        // iceoryx2 does not remove a node of another version or a damaged one.
        cleaned.files += remove_node(domain, &id);
    }
    // Unused objects can be determined only if the open files of every living process are visible.
    let Some(mapped) = living
        .iter()
        .copied()
        .collect::<Option<Vec<i32>>>()
        .and_then(|pids| mapped_memory(domain, &pids))
    else {
        return Ok(cleaned);
    };
    for entry in unused(domain, &mapped, is_service_memory).filter(is_settled) {
        cleaned.files += usize::from(std::fs::remove_file(entry.path()).is_ok());
    }
    let readable: HashSet<String> = service_files(&config, domain);
    for entry in entries(&domain.root().join("services")).filter(is_settled) {
        if !readable.contains(&*entry.file_name().to_string_lossy()) {
            cleaned.files += usize::from(std::fs::remove_file(entry.path()).is_ok());
        }
    }
    Ok(cleaned)
}

/// Names of the service files that iceoryx2 can read.
fn service_files(config: &Config, domain: &Domain) -> HashSet<String> {
    let mut names = HashSet::new();
    let _ = ipc::Service::list(config, |details| {
        let hash = details.static_details.service_hash().as_str();
        names.insert(format!("{}{hash}.service", domain.prefix()));
        CallbackProgression::Continue
    });
    names
}

/// Removes files of a node that iceoryx2 does not remove; returns their number.
fn remove_node(domain: &Domain, id: &str) -> usize {
    let nodes = domain.root().join("nodes");
    let mut count = 0;
    let mut remove = |path: &Path| count += usize::from(std::fs::remove_file(path).is_ok());
    let directory = nodes.join(id);
    entries(&directory).for_each(|entry| remove(&entry.path()));
    let _ = std::fs::remove_dir(&directory);
    let monitor = format!("{}{id}.node_monitor", domain.prefix());
    entries(&nodes)
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(&monitor))
        .for_each(|entry| remove(&entry.path()));
    count
}

fn node(state: &NodeState<ipc::Service>) -> NodeReport {
    let (details, alive) = match state {
        NodeState::Alive(view) => (view.details().as_ref(), Some(true)),
        NodeState::Dead(view) => (view.details().as_ref(), Some(false)),
        NodeState::Inaccessible(_) | NodeState::Undefined(_) => (None, None),
    };
    let pid = state.node_id().pid::<ipc::Service>().ok().map(|pid| pid.value());
    NodeReport {
        name: details.map_or_else(String::new, |details| details.name().to_string()),
        executable: details.map_or_else(String::new, |details| details.executable().to_string()),
        // A node in an unknown state is dead if its process is dead.
        alive: alive.or_else(|| pid.filter(|pid| !exists(*pid)).map(|_| false)),
        pid,
    }
}

fn locks(domain: &Domain) -> Vec<LockReport> {
    let mut locks: Vec<LockReport> = entries(domain.root())
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let (robot, role) = name.strip_suffix(".lock")?.rsplit_once('.')?;
            Some(LockReport {
                robot: robot.to_owned(),
                role: role.to_owned(),
                holder: RoleFile(&entry.path()).holder(),
            })
        })
        .collect();
    locks.sort_by(|a, b| (&a.robot, &a.role).cmp(&(&b.robot, &b.role)));
    locks
}

/// True if a program of this library has joined or is about to join.
fn is_member_held(domain: &Domain) -> bool {
    RoleFile(&domain.root().join(super::membership::MEMBERS)).is_held()
}

fn memory(domain: &Domain) -> MemoryReport {
    let mapped = mapped_memory(domain, &[]).unwrap_or_default();
    let mut report = MemoryReport::default();
    for entry in entries(Path::new(SHM)).filter(is_ours) {
        let name = entry.file_name().to_string_lossy().into_owned();
        if !is_service_memory(&name, domain.prefix()) {
            continue;
        }
        let Ok(found) = entry.metadata() else { continue };
        report.objects += 1;
        report.bytes += found.len();
        report.resident_bytes += found.blocks() * 512;
        report.unused += usize::from(!mapped.contains(&format!("{SHM}/{name}")));
    }
    report
}

fn is_settled(entry: &DirEntry) -> bool {
    let modified = entry.metadata().and_then(|found| found.modified());
    modified.is_ok_and(|time| time.elapsed().is_ok_and(|age| age > SETTLED))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_shared_memory_object_tells_its_domain_whatever_is_in_the_name() {
        let hash = "0354a209029e7d094a819e2d4030ea331e6caaf0";
        let ours = "thetabus_1000_";
        for name in ["a", "a_b", "left-arm", "t1_2-3"] {
            let object = format!("{ours}{name}_{hash}_12.data");
            assert_eq!(domain_of_memory(&object, ours), Some(name));
        }
        for object in ["1000_a_12.data", "other_a", "1000_", "1000_A_"] {
            let object = format!("thetabus_{object}");
            assert_eq!(domain_of_memory(&object, ours), None, "{object}");
        }
        for user in ["1000_", "0_a", "100_a"] {
            let object = format!("thetabus_{user}_{hash}_1.data");
            assert_eq!(domain_of_memory(&object, ours), None, "{object}");
        }
    }
}
