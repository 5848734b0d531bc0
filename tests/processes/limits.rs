//! Too little shared memory, other users, settings that the system refuses: clear messages instead
//! of surprises.

use crate::peers::permitted;
use crate::support::{Process, Program, QUICK, Site, eventually};
use nix::sys::signal::Signal;
use std::path::Path;
use std::process::{Command, Stdio};
use thetabus::messages::{RealtimeStatus, Status};

/// A shell with a /dev/shm of its own of this size.
fn with_small_memory(site: &Site, size: &str, script: &str, args: &[&str]) -> Process {
    let script = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm && {{ {script}; }}");
    let mut command = Command::new("unshare");
    command
        .current_dir(site.dir.path())
        .args(["--mount", "--propagation", "private", "sh", "-c", &script])
        .args(args)
        .args(["--domain", site.domain.name()]);
    Process::start(command)
}

fn may_mount() -> bool {
    let try_it = "mount -t tmpfs -o size=64k tmpfs /dev/shm";
    permitted("unshare", &["--mount", "--propagation", "private", "sh", "-c", try_it])
}

#[test]
fn fault_too_little_shared_memory_is_refused_with_the_numbers_and_never_kills() {
    if !may_mount() {
        return;
    }
    // As docs/deployment.md says, the identifier's topics take more than 14 MB, the samples of a
    // plant in real time 32 MB.
    for (size, program, bytes) in [
        ("1m", env!("CARGO_BIN_EXE_identifier"), 1 << 20),
        ("4m", env!("CARGO_BIN_EXE_plant_simulator"), 4 << 20),
    ] {
        let site = Site::new();
        let mut process = with_small_memory(&site, size, r#"exec "$0" "$@""#, &[program, "--set", "plant.speed=1"]);
        process.expect_code(1);
        let told = process.stderr();
        let left = told
            .split("/dev/shm has ")
            .nth(1)
            .and_then(|rest| rest.split(' ').next())
            .and_then(|number| number.parse::<u64>().ok());
        // The identifier's status comes first, and takes its share.
        assert!(left.is_some_and(|left| left <= bytes && left > bytes / 4), "{told}");
        for part in ["may need", "--shm-size", "topic"] {
            assert!(told.contains(part), "{part:?} is not in {told}");
        }
    }
}

#[test]
fn fault_shared_memory_that_somebody_fills_during_a_run_kills_nobody() {
    if !may_mount() {
        return;
    }
    let site = Site::new();
    // What the run needs fits, then a stranger takes the rest; each page that is used later was
    // taken at the start.
    let script = r#"
        "$0" "$@" & run=$!
        for i in $(seq 600); do [ -s out/estimates.csv ] && [ $(wc -l < out/estimates.csv) -gt 3 ] && break; sleep 0.05; done
        dd if=/dev/zero of=/dev/shm/stranger bs=4k 2>/dev/null
        echo "left: $(df --output=avail /dev/shm | tail -1)"
        wait $run"#;
    let args = [
        env!("CARGO_BIN_EXE_thetabus"),
        "run",
        "--out",
        "out",
        "--speed",
        "4",
        "--duration",
        "12",
        "--no-record",
    ];
    let mut run = with_small_memory(&site, "80m", script, &[&args[..], &QUICK].concat());
    run.expect_code(0);
    assert!(
        run.stdout().contains("left: 0") || run.stdout().contains("left:     0"),
        "{}",
        run.said()
    );
    assert_eq!(
        (site.summary().samples.accepted, site.summary().samples.missing),
        (12_000, 0),
        "{}",
        run.said()
    );
}

/// Each program that joins, in memory of any size: it works or refuses in words, and no signal ends
/// it.
#[test]
fn fault_joining_programs_are_refused_with_the_numbers_however_little_is_left() {
    if !may_mount() {
        return;
    }
    // A live system takes its share; a stranger leaves so many KiB to those who join it.
    let script = r#"
        plant=$0; identifier=$1; monitor=$2; thetabus=$3; left=$4; shift 4
        "$plant" --speed 1 "$@" 2>plant.log & plant_pid=$!
        "$identifier" "$@" 2>identifier.log & identifier_pid=$!
        for i in $(seq 400); do "$thetabus" ctl describe "$@" >/dev/null 2>&1 && break; sleep 0.05; done
        head -c 200M /dev/zero 2>/dev/null > /dev/shm/stranger
        truncate -s -${left}K /dev/shm/stranger
        for who in monitor plant identifier ctl doctor; do
            case $who in
                monitor) timeout -s TERM 2 "$monitor" --record "m.mcap" "$@" ;;
                plant) "$plant" --robot other --speed 1 --duration 0.5 "$@" ;;
                identifier) timeout -s TERM 2 "$identifier" --robot other "$@" ;;
                ctl) "$thetabus" ctl describe "$@" ;;
                doctor) "$thetabus" doctor "$@" ;;
            esac >$who.out 2>$who.err
            echo "ended: $who $?"
        done
        kill -0 $plant_pid && kill -0 $identifier_pid && echo "both live"
        rm /dev/shm/stranger
        "$thetabus" ctl describe "$@" >/dev/null && echo "answers"
        kill $plant_pid; wait $plant_pid; echo "ended: live plant $?"
        kill $identifier_pid; wait $identifier_pid; echo "ended: live identifier $?"
    "#;
    for left in ["0", "4", "16", "64", "256", "1024", "2048", "4096", "16384", "61440"] {
        let site = Site::new();
        let args = [
            env!("CARGO_BIN_EXE_plant_simulator"),
            env!("CARGO_BIN_EXE_identifier"),
            env!("CARGO_BIN_EXE_monitor"),
            env!("CARGO_BIN_EXE_thetabus"),
            left,
        ];
        let mut all = with_small_memory(&site, "160m", script.trim(), &args);
        all.expect_code(0);
        let told = all.stdout();
        for line in [
            "both live",
            "answers",
            "ended: live plant 0",
            "ended: live identifier 0",
            "ended: doctor 0",
        ] {
            assert!(
                told.contains(line),
                "{left} KiB left, {line:?} is not in\n{}",
                all.said()
            );
        }
        for who in ["monitor", "plant", "identifier", "ctl"] {
            let error = std::fs::read_to_string(site.dir.path().join(format!("{who}.err"))).expect("its log");
            let code = told
                .lines()
                .find_map(|line| line.strip_prefix(&format!("ended: {who} ")));
            match code {
                Some("0" | "124") => {}
                Some("1") => {
                    for part in ["/dev/shm has ", "may need", "--shm-size"] {
                        assert!(
                            error.contains(part),
                            "{left} KiB left, {who}: {part:?} is not in {error}"
                        );
                    }
                }
                other => panic!("{left} KiB left, {who} ended with {other:?}: {error}"),
            }
        }
        let refused = told.contains("ended: plant 1");
        assert_eq!(refused, left != "61440", "{left} KiB left\n{}", all.said());
    }
}

const NOBODY: [&str; 4] = ["--reuid=65534", "--regid=65534", "--clear-groups", "--"];

#[test]
fn fault_another_user_can_neither_read_nor_write_the_topics() {
    let site = Site::new();
    let mut observer = site.observer();
    let _identifier = site.start(Program::Identifier, &QUICK);
    let _plant = site.start(Program::Plant, &[&["--speed", "2"], &QUICK[..]].concat());
    observer.estimate("a block", |_| true);
    // By the modes, whoever runs this test.
    use std::os::unix::fs::PermissionsExt;
    let mode = |path: &Path| std::fs::metadata(path).expect("there").permissions().mode() & 0o777;
    assert_eq!(mode(site.domain.root()), 0o700);
    let objects: Vec<_> = std::fs::read_dir("/dev/shm")
        .expect("/dev/shm")
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| {
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            name.starts_with(site.domain.prefix())
        })
        .collect();
    assert!(objects.len() > 5, "{objects:?}");
    for path in &objects {
        assert_eq!(mode(path) & 0o077, 0, "{}", path.display());
    }
    // And by the deed, where this user may become another.
    if !permitted("setpriv", &[&NOBODY[..], &["true"]].concat()) {
        return;
    }
    let as_nobody = |script: &str, path: &Path| {
        let path = path.to_str().expect("UTF-8");
        let mut command = Command::new("setpriv");
        command.args(NOBODY).args(["sh", "-c", script, path]);
        command.stderr(Stdio::null()).stdout(Stdio::null());
        command.status().expect("a shell").success()
    };
    for path in &objects {
        assert!(!as_nobody(r#"head -c 1 "$0""#, path), "{} can be read", path.display());
        assert!(!as_nobody(r#": >> "$0""#, path), "{} can be written", path.display());
    }
    for script in [r#"ls "$0""#, r#": > "$0/new""#, r#"cat "$0/services/"*"#] {
        assert!(!as_nobody(script, site.domain.root()), "{script}");
    }
}

#[test]
fn fault_a_domain_that_belongs_to_another_user_is_refused_with_a_clear_message() {
    if !permitted("setpriv", &[&NOBODY[..], &["true"]].concat()) {
        return;
    }
    let binary = env!("CARGO_BIN_EXE_identifier");
    if !permitted("setpriv", &[&NOBODY[..], &[binary, "--version"]].concat()) {
        return;
    }
    let site = Site::new();
    // A place that both users have in common.
    let place = std::env::temp_dir().join(format!("thetabus-common-{}", std::process::id()));
    std::fs::create_dir(&place).expect("create");
    let owned = place.join("thetabus-shared");
    std::fs::create_dir(&owned).expect("create");
    let mut command = Command::new("setpriv");
    command
        .current_dir("/")
        .args(NOBODY)
        .args([binary, "--domain", "shared"])
        .env("XDG_RUNTIME_DIR", &place);
    let mut process = Process::start(command);
    let status = process.wait();
    eventually("its message", || process.stderr().contains("user 65534").then_some(()));
    std::fs::remove_dir_all(&place).expect("remove");
    assert_eq!(status.code(), Some(1), "{}", process.said());
    process.expect_stderr(&["must be a directory of user 65534", "--domain"]);
    drop(site);
}

/// Properties of a process's main thread, from the kernel: policy, priority, CPUs, locked memory.
fn kernel_says(pid: u32) -> (u32, u32, u64, bool) {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).expect("it lives");
    let fields: Vec<&str> = stat.rsplit_once(')').expect("a name").1.split_whitespace().collect();
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("it lives");
    let line = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        line.expect("known").trim().trim_end_matches(" kB").trim().to_owned()
    };
    // Fields 40 and 41 of proc(5).
    (
        fields[38].parse().expect("a number"),
        fields[37].parse().expect("a number"),
        u64::from_str_radix(&line("Cpus_allowed:").replace(',', ""), 16).expect("a mask"),
        line("VmLck:") != "0",
    )
}

const REALTIME: [&str; 6] = [
    "--set",
    "realtime.identifier.scheduler_priority=5",
    "--set",
    "realtime.identifier.cpu_affinity=[0]",
    "--set",
    "realtime.identifier.lock_memory=true",
];

fn reported(site: &Site, pid: u32) -> Status {
    site.observer().status("its heartbeat", |status| status.pid == pid)
}

#[test]
fn rt_status_says_what_the_system_granted_of_the_real_time_settings() {
    let site = Site::new();
    let identifier = site.start(Program::Identifier, &[&REALTIME[..], &QUICK].concat());
    let RealtimeStatus {
        policy,
        priority,
        affinity,
        memory_locked,
        refused,
    } = reported(&site, identifier.pid()).realtime;
    let (kernel_policy, kernel_priority, cpus, locked) = kernel_says(identifier.pid());
    assert_eq!((policy, priority), (kernel_policy, kernel_priority));
    // Whether granted or refused depends on who runs this; told is what holds, and a warning comes
    // with each refusal.
    assert_eq!(refused & 1 != 0, policy == 0);
    assert_eq!(refused & 2 != 0, affinity == 0);
    assert_eq!(refused & 4 != 0, memory_locked == 0);
    assert!(affinity == 0 || affinity == cpus, "{affinity:x} {cpus:x}");
    assert_eq!(memory_locked == 1, locked);
    for (bit, key) in [(1, "scheduler_priority"), (2, "cpu_affinity"), (4, "lock_memory")] {
        assert_eq!(
            refused & bit != 0,
            identifier.stderr().contains(&format!("{key} is refused")),
            "{}",
            identifier.said()
        );
    }
    identifier.signal(Signal::SIGTERM);
}

#[test]
fn rt_refused_settings_are_told_and_the_identifier_works_all_the_same() {
    // Without capabilities and with limits of 0, for any user.
    let bare = [
        "--bounding-set=-all",
        "--inh-caps=-all",
        "--",
        "prlimit",
        "--rtprio=0",
        "--memlock=65536",
        "--",
    ];
    if !permitted("setpriv", &[&bare[..], &["true"]].concat()) {
        return;
    }
    let site = Site::new();
    let mut command = Command::new("setpriv");
    command
        .current_dir(site.dir.path())
        .args(bare)
        .arg(env!("CARGO_BIN_EXE_identifier"))
        .args(["--domain", site.domain.name()])
        .args(REALTIME)
        .args(["--set", "realtime.identifier.cpu_affinity=[1023]"])
        .args(QUICK);
    let identifier = Process::start(command);
    let status = reported(&site, identifier.pid());
    assert_eq!(
        status.realtime,
        RealtimeStatus {
            refused: 7,
            ..RealtimeStatus::default()
        }
    );
    identifier.expect_stderr(&[
        "scheduler_priority is refused",
        "LimitRTPRIO",
        "cpu_affinity is refused",
        "lock_memory is refused",
        "LimitMEMLOCK",
    ]);
    let mut plant = site.start(Program::Plant, &[&["--duration", "2"], &QUICK[..]].concat());
    plant.expect_code(0);
    assert_eq!(site.observer().end().accepted, 2_000);
}
