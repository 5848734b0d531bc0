//! Orphaned services, which no node has and no process will remove.
//!
//! A node keeps a tag for each of its services; the tag is created before the service's file and
//! removed before it. So a node killed while releasing a service leaves a file without a tag, which
//! the clean-up of dead nodes does not find, and which prevents opening or creating the service.

use super::Domain;
use super::half_made::GRACE;
use super::objects::entries;
use std::collections::{HashMap, HashSet};
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;

/// Removes the files of services that no node has; waits for [`GRACE`] only if there are any.
pub(super) fn sweep(domain: &Domain) {
    let first = orphans(domain);
    if first.is_empty() {
        return;
    }
    // A living node that is releasing its services has removed them by then.
    std::thread::sleep(GRACE);
    for (path, inode) in orphans(domain) {
        if first.get(&path) == Some(&inode) && std::fs::remove_file(&path).is_ok() {
            tracing::info!(
                domain = domain.name(),
                file = %path.display(),
                "removed a service whose last user was killed while closing it"
            );
        }
    }
}

fn orphans(domain: &Domain) -> HashMap<PathBuf, u64> {
    // First the services: every listed one had its tag before.
    let services: Vec<_> = entries(&domain.root().join("services")).collect();
    if services.is_empty() {
        return HashMap::new();
    }
    let nodes = entries(&domain.root().join("nodes"));
    let tagged: HashSet<String> = nodes
        .flat_map(|node| entries(&node.path()))
        .filter_map(|entry| stem(&entry.file_name().to_string_lossy(), ".service_tag"))
        .collect();
    let is_orphan = |name: &str| stem(name, ".service").is_some_and(|stem| !tagged.contains(&stem));
    services
        .into_iter()
        .filter(|entry| is_orphan(&entry.file_name().to_string_lossy()))
        .filter_map(|entry| Some((entry.path(), entry.metadata().ok()?.ino())))
        .collect()
}

fn stem(name: &str, ending: &str) -> Option<String> {
    name.strip_suffix(ending).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::super::tests::TestDomain;
    use super::super::{Bus, Publisher};
    use super::*;
    use crate::messages::Status;

    #[test]
    fn fault_a_service_without_a_node_is_removed_and_one_that_is_used_is_not() {
        let domain = TestDomain::new();
        let bus = Bus::join(&domain.0, "arm", "identifier").expect("join");
        let _publisher = Publisher::<Status>::new(&bus).expect("publish");
        let services = domain.0.root().join("services");
        let used: Vec<PathBuf> = entries(&services).map(|entry| entry.path()).collect();
        assert_eq!(used.len(), 1);
        let orphan = services.join(format!("{}{}.service", domain.0.prefix(), "0a".repeat(20)));
        std::fs::copy(&used[0], &orphan).expect("copy");
        sweep(&domain.0);
        assert!(used[0].exists() && !orphan.exists());
    }
}
