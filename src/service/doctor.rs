//! `thetabus doctor`: shows what is on the bus, and what a crash has left there.

use super::{DoctorArgs, Exit, Failure, TableFormat, logging};
use crate::bus::{BusError, Cleaned, Domain, DomainReport, clean, domains, inspect, shared_memory};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Shows every domain of this user; with `clean`, first removes the resources of dead processes.
///
/// # Errors
/// If the domain cannot be used: an invalid name, or a directory of another user.
pub fn run(args: &DoctorArgs) -> Result<Exit, Failure> {
    if let Some(words) = Domain::warning() {
        tracing::warn!("{words}");
    }
    let chosen = match &args.domain {
        Some(name) => vec![Domain::new(name)?],
        None => domains(),
    };
    if let (true, [domain]) = (args.iox2, &chosen[..]) {
        logging::result(domain.iceoryx2_toml().trim_end())?;
        return Ok(Exit::Done);
    }
    let mut reports = Vec::new();
    let mut removed = Vec::new();
    for domain in chosen {
        match look(&domain, args.clean) {
            Ok((cleaned, report)) => {
                removed.extend(cleaned.map(|cleaned| (domain, cleaned)));
                reports.extend(report);
            }
            Err(error) if args.domain.is_some() => return Err(error.into()),
            // One domain that cannot be inspected must not hide the others.
            Err(error) => tracing::error!("{error}"),
        }
    }
    match args.format {
        TableFormat::Text => logging::result(text(&reports, &removed, args).trim_end())?,
        TableFormat::Json => logging::result(&format!("{:#}", json(&reports, &removed)))?,
    }
    Ok(Exit::Done)
}

/// What was removed, if anything, and the report, if the domain still exists.
fn look(domain: &Domain, is_clean_up: bool) -> Result<(Option<Cleaned>, Option<DomainReport>), BusError> {
    let cleaned = match is_clean_up {
        true => Some(clean(domain)?).filter(|cleaned| *cleaned != Cleaned::default()),
        false => None,
    };
    let report = match cleaned {
        Some(Cleaned { domain: true, .. }) => None,
        _ => Some(inspect(domain)?),
    };
    Ok((cleaned, report))
}

fn text(reports: &[DomainReport], removed: &[(Domain, Cleaned)], args: &DoctorArgs) -> String {
    let mut text = String::new();
    match shared_memory() {
        Some((size, free)) => _ = writeln!(text, "/dev/shm: {} free of {}", mib(free), mib(size)),
        None => text.push_str("/dev/shm cannot be looked at\n"),
    }
    for (domain, cleaned) in removed {
        let _ = match cleaned.domain {
            true => writeln!(
                text,
                "removed domain {}: no program was running, {} file(s)",
                domain.name(),
                cleaned.files
            ),
            false => writeln!(
                text,
                "cleaned domain {}: {} dead program(s), {} file(s)",
                domain.name(),
                cleaned.nodes,
                cleaned.files
            ),
        };
    }
    if reports.is_empty() {
        text.push_str("no domains\n");
    }
    for report in reports {
        one(&mut text, report);
    }
    if !args.clean && reports.iter().any(DomainReport::has_dead) {
        text.push_str(
            "\nthetabus doctor --clean removes what is dead; the next program that starts there does so, too\n",
        );
    }
    text
}

fn one(text: &mut String, report: &DomainReport) {
    let state = match (report.abandoned, report.has_dead()) {
        _ if !report.cut_off.is_empty() => "in use, but closed to programs that start now",
        (true, true) => "no program is running; stale resources are left",
        (true, false) => "no program is running",
        (false, true) => "in use; stale resources are left",
        (false, false) => "in use",
    };
    let _ = writeln!(
        text,
        "\ndomain {}: {state}\n  {}",
        report.domain.name(),
        report.domain.root().display()
    );
    for node in &report.nodes {
        let state = match node.alive {
            Some(true) => "alive",
            Some(false) => "dead",
            None => "unknown",
        };
        let name = if node.name.is_empty() { "unnamed" } else { &node.name };
        let pid = node.pid.map_or_else(|| "?".to_owned(), |pid| pid.to_string());
        let _ = writeln!(
            text,
            "  program  {name:<18} {state:<8} process {pid} {}",
            node.executable
        );
    }
    for lock in &report.locks {
        let holder = match &lock.holder {
            Some(pid) => format!("held by process {pid}"),
            None => "free".to_owned(),
        };
        let _ = writeln!(
            text,
            "  lock     {:<18} {holder}",
            format!("{}.{}", lock.robot, lock.role)
        );
    }
    for service in &report.services {
        let message = service
            .message
            .as_ref()
            .map_or_else(String::new, |(name, size)| format!(", {name} of {size} bytes"));
        let _ = writeln!(
            text,
            "  service  {:<32} {}{message}, {} program(s)",
            service.name, service.pattern, service.nodes
        );
    }
    if report.unreadable_services > 0 {
        let _ = writeln!(
            text,
            "  {} services that cannot be read: damaged, or of another version of iceoryx2",
            report.unreadable_services
        );
    }
    if report.is_blocked {
        text.push_str("  programs and services cannot be listed: an incompletely created object blocks the listing\n");
    }
    for object in &report.half_made {
        let _ = writeln!(
            text,
            "  incompletely created object {object}: the process that creates it was killed or is stopped"
        );
    }
    if let Some(words) = report.removed_memory() {
        let _ = writeln!(text, "  {words}");
    }
    let memory = &report.memory;
    let _ = writeln!(
        text,
        "  memory   {} objects, {}, of that {} in use; {} objects that nobody has open",
        memory.objects,
        mib(memory.bytes),
        mib(memory.resident_bytes),
        memory.unused
    );
}

fn json(reports: &[DomainReport], removed: &[(Domain, Cleaned)]) -> Value {
    let memory = shared_memory();
    let removed: Vec<Value> = removed
        .iter()
        .map(|(domain, cleaned)| {
            json!({
                "domain": domain.name(),
                "whole_domain": cleaned.domain,
                "programs": cleaned.nodes,
                "files": cleaned.files,
            })
        })
        .collect();
    let domains: Vec<Value> = reports.iter().map(domain_json).collect();
    json!({
        "shared_memory": {
            "size_bytes": memory.map(|(size, _)| size),
            "free_bytes": memory.map(|(_, free)| free),
        },
        "removed": removed,
        "domains": domains,
    })
}

fn domain_json(report: &DomainReport) -> Value {
    let programs: Vec<Value> = report
        .nodes
        .iter()
        .map(|node| json!({ "name": node.name, "pid": node.pid, "executable": node.executable, "alive": node.alive }))
        .collect();
    let services: Vec<Value> = report
        .services
        .iter()
        .map(|service| {
            json!({
                "name": service.name,
                "pattern": service.pattern,
                "type": service.message.as_ref().map(|(name, _)| name),
                "message_bytes": service.message.as_ref().map(|(_, size)| size),
                "programs": service.nodes,
            })
        })
        .collect();
    let locks: Vec<Value> = report
        .locks
        .iter()
        .map(|lock| json!({ "robot": lock.robot, "role": lock.role, "holder": lock.holder }))
        .collect();
    json!({
        "name": report.domain.name(),
        "directory": report.domain.root().display().to_string(),
        "abandoned": report.abandoned,
        "has_dead": report.has_dead(),
        "programs": programs,
        "services": services,
        "unreadable_services": report.unreadable_services,
        "half_made": report.half_made,
        "is_blocked": report.is_blocked,
        "cut_off_processes": report.cut_off,
        "locks": locks,
        "memory": {
            "objects": report.memory.objects,
            "bytes": report.memory.bytes,
            "resident_bytes": report.memory.resident_bytes,
            "unused_objects": report.memory.unused,
        },
    })
}

fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}
