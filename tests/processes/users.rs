//! Users of one machine: they do not meet, and none can read, change, hang or deny what is
//! another's without being named.

use crate::peers::{Place, User, permitted};
use crate::support::{PAPER, Process, QUICK, eventually};
use nix::sys::signal::Signal;
use std::fs::Permissions;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const PLANT: &str = env!("CARGO_BIN_EXE_plant_simulator");
const IDENTIFIER: &str = env!("CARGO_BIN_EXE_identifier");
const MONITOR: &str = env!("CARGO_BIN_EXE_monitor");
const THETABUS: &str = env!("CARGO_BIN_EXE_thetabus");

/// Two users who are not the superuser, to whom nothing is closed.
const USERS: [User; 2] = [User(65_533), User(65_534)];
/// A refusal waits for nothing; a hang would last until the watchdog.
const REFUSAL: Duration = Duration::from_secs(10);

fn name(test: &str) -> String {
    format!("{test}{}", std::process::id())
}

fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        found.push(entry.path());
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            found.extend(files_below(&entry.path()));
        }
    }
    found
}

/// Every program, as it starts: each has to refuse.
fn programs() -> [(&'static str, Vec<&'static str>); 6] {
    [
        (PLANT, vec!["--duration", "1"]),
        (IDENTIFIER, vec![]),
        (MONITOR, vec![]),
        (THETABUS, vec!["ctl", "describe"]),
        (THETABUS, vec!["doctor"]),
        (THETABUS, vec!["doctor", "--clean"]),
    ]
}

#[track_caller]
fn expect_refusal(mut process: Process, parts: &[&str]) {
    let start = Instant::now();
    process.expect_code(1);
    assert!(start.elapsed() < REFUSAL, "{:?}", start.elapsed());
    process.expect_stderr(parts);
}

#[test]
fn e2e_two_users_work_in_a_domain_of_the_same_name_and_cannot_touch_each_others() {
    if !USERS.iter().all(|user| user.is_possible()) {
        return;
    }
    let places = USERS.map(|user| Place::named(user, &name("u")));
    let runs = places.each_ref().map(|place| {
        let args = [
            &["run", PAPER, "--out", "out", "--speed", "1", "--duration", "100000"],
            &QUICK[..],
        ]
        .concat();
        place.start(THETABUS, &args)
    });
    for place in &places {
        eventually("estimates", || {
            let csv = std::fs::read_to_string(place.dir.path().join("out/estimates.csv")).ok()?;
            (csv.lines().count() > 5).then_some(())
        });
    }
    let mut sockets = 0;
    for (place, stranger) in places.iter().zip([USERS[1], USERS[0]]) {
        let objects = place.objects();
        assert!(objects.len() > 10, "{objects:?}");
        for path in &objects {
            let found = std::fs::symlink_metadata(path).expect("there");
            assert_eq!((found.uid(), found.mode() & 0o777), (place.user.0, 0o600), "{path:?}");
            // In a subshell, because a redirection that fails ends the shell that tries it.
            let any = r#"head -c 1 "$0" || (: >> "$0") || rm -f "$0" || mv "$0" "$0.gone" || chmod 666 "$0""#;
            assert!(!stranger.can(any, path), "{}", path.display());
            assert!(path.exists());
        }
        let root = place.root();
        assert_eq!(std::fs::metadata(&root).expect("there").mode() & 0o777, 0o700);
        assert!(!stranger.can(r#"ls "$0""#, &root) && !stranger.can(r#"touch "$0/new""#, &root));
        assert!(!stranger.can(r#"mv "$0" "$0.gone""#, &root) && !stranger.can(r#"rm -rf "$0""#, &root));
        for path in files_below(&root) {
            let kind = std::fs::symlink_metadata(&path).expect("there").file_type();
            sockets += usize::from(kind.is_socket());
            // Without a way to it there is neither reading nor writing nor connecting.
            assert!(!stranger.can(r#"[ -e "$0" ]"#, &path), "{}", path.display());
        }
        // Nor by the programs: a clean-up of the other's domain of this name finds nothing.
        let mut clean = Process::start({
            let mut command = stranger.command(THETABUS);
            command
                .args(["doctor", "--clean", "--domain", "another"])
                .current_dir("/");
            command
        });
        clean.expect_code(0);
    }
    assert!(sockets >= 4, "{sockets}");
    for (mut run, place) in runs.into_iter().zip(&places) {
        run.signal(Signal::SIGTERM);
        run.expect_code(0);
        let summary = std::fs::read_to_string(place.dir.path().join("out/summary.json")).expect("a summary");
        let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
        assert!(summary["samples"]["accepted"].as_u64() > Some(1_000), "{summary}");
        assert_eq!(summary["samples"]["missing"], 0);
    }
}

#[test]
fn e2e_a_domain_that_another_user_has_used_before_is_free() {
    let users = [User::own(), USERS[0], USERS[1]];
    if !users.iter().all(|user| user.is_possible()) {
        return;
    }
    let places = users.map(|user| Place::named(user, &name("v")));
    for place in &places {
        let mut run = place.start(
            THETABUS,
            &[
                &["run", PAPER, "--no-record", "--out", "out", "--duration", "1"],
                &QUICK[..],
            ]
            .concat(),
        );
        run.expect_code(0);
    }
}

/// As [`User::can`], and it must.
fn put(user: User, path: &Path, script: &str) {
    assert!(user.can(script, path), "{script}: {}", path.display());
}

#[test]
fn fault_an_object_of_another_user_is_refused_by_name_and_makes_nobody_hang() {
    let (victim, stranger) = (USERS[0], USERS[1]);
    if !USERS.iter().all(|user| user.is_possible()) {
        return;
    }
    let hash = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5";
    for user in [victim, User::own()] {
        for script in [
            r#": > "$0" && chmod 666 "$0""#,
            r#"head -c 16 /dev/zero > "$0" && chmod 666 "$0""#,
            r#": > "$0" && chmod 000 "$0""#,
            r#"ln -s /etc/hostname "$0""#,
        ] {
            let place = Place::named(user, &name("w"));
            let object = format!("/dev/shm/{}{hash}_node.0_10_0.global_mgmt", place.prefix());
            put(stranger, Path::new(&object), script);
            for (program, args) in programs() {
                let process = place.start(program, &args);
                expect_refusal(process, &[&object, &format!("of user {}", stranger.0), "--domain"]);
            }
            assert!(
                std::fs::symlink_metadata(&object).is_ok(),
                "what is another's is left to him"
            );
        }
    }
}

#[test]
fn fault_an_object_that_another_user_adds_to_a_live_domain_stops_nobody() {
    let (victim, stranger) = (USERS[0], USERS[1]);
    if !USERS.iter().all(|user| user.is_possible()) {
        return;
    }
    let place = Place::new(victim);
    let run = [
        &[
            "run",
            PAPER,
            "--no-record",
            "--out",
            "out",
            "--speed",
            "1",
            "--duration",
            "8",
        ],
        &QUICK[..],
    ]
    .concat();
    let mut run = place.start(THETABUS, &run);
    let csv = place.dir.path().join("out/estimates.csv");
    eventually("estimates", || {
        (std::fs::read_to_string(&csv).ok()?.lines().count() > 5).then_some(())
    });
    for (n, hash) in ["0a", "112437a14a36c452eeea7e2aefc2af954fc5a3f2"].iter().enumerate() {
        let hash = hash.repeat(40 / hash.len());
        let object = format!("/dev/shm/{}{hash}_{n}.dynamic", place.prefix());
        put(stranger, Path::new(&object), r#": > "$0" && chmod 666 "$0""#);
        expect_refusal(place.start(THETABUS, &["ctl", "describe"]), &[&object]);
        put(stranger, Path::new(&object), r#"rm "$0""#);
    }
    run.expect_code(0);
    let summary = std::fs::read_to_string(place.dir.path().join("out/summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    assert_eq!(
        (&summary["samples"]["accepted"], &summary["samples"]["missing"]),
        (&8_000.into(), &0.into())
    );
}

#[test]
fn fault_a_domain_directory_that_is_a_link_or_open_or_anothers_is_refused_by_every_program() {
    let own = User::own();
    let target = tempfile::tempdir().expect("a directory");
    let mode = |path: &Path, mode: u32| std::fs::set_permissions(path, Permissions::from_mode(mode)).expect("its mode");
    let cases: [(&str, &dyn Fn(&Path), &[&str]); 4] = [
        (
            "a link",
            &|root| symlink(target.path(), root).expect("link"),
            &["must be a directory", "a symbolic link"],
        ),
        (
            "a broken link",
            &|root| symlink("/tmp/nowhere/at/all", root).expect("link"),
            &["a symbolic link"],
        ),
        (
            "open to all",
            &|root| {
                std::fs::create_dir(root).expect("create");
                mode(root, 0o777);
            },
            &["has mode 0777", "expected 0700"],
        ),
        (
            "a file",
            &|root| std::fs::write(root, "").expect("write"),
            &["a file of user"],
        ),
    ];
    for (what, make, parts) in cases {
        let place = Place::new(own);
        make(&place.root());
        for (program, args) in programs() {
            // A clean-up of a domain without a directory has nothing to refuse.
            let process = place.start(program, &args);
            expect_refusal(
                process,
                &[parts, &[&*place.root().to_string_lossy(), "--domain"]].concat(),
            );
        }
        assert_eq!(
            std::fs::read_dir(target.path()).expect("there").count(),
            0,
            "{what}: something was written"
        );
        let _ = std::fs::remove_file(place.root());
    }
    if !USERS.iter().all(|user| user.is_possible()) {
        return;
    }
    for user in [USERS[0], own] {
        let place = Place::new(user);
        put(USERS[1], &place.root(), r#"mkdir -m 0777 "$0""#);
        for (program, args) in programs() {
            let parts = [
                &format!("must be a directory of user {}", user.0),
                &*format!("of user {}", USERS[1].0),
            ];
            expect_refusal(place.start(program, &args), &parts);
        }
    }
}

#[test]
fn fault_nothing_is_open_to_others_at_any_moment() {
    if !permitted("strace", &["-f", "-qq", "-o", "/dev/null", "true"]) {
        return;
    }
    let place = Place::new(User::own());
    let log = place.dir.path().join("trace");
    let log = log.to_str().expect("UTF-8");
    let calls = "trace=openat,open,creat,mkdir,mkdirat,mknod,mknodat,chmod,fchmod,fchmodat,umask,linkat,link,bind";
    // A umask of nothing leaves the modes as the programs ask for them.
    let script = r#"umask 0; exec "$0" "$@""#;
    let strace = ["sh", "-c", script, "strace", "-f", "-y", "-qq", "-o", log, "-e", calls];
    let args = [
        &["run", PAPER, "--out", "out", "--speed", "4", "--duration", "2"],
        &QUICK[..],
    ]
    .concat();
    let mut run = Process::start(place.command(&strace, THETABUS, &args));
    run.expect_code(0);
    let text = std::fs::read_to_string(log).expect("a trace");
    let (root, memory) = (
        place.root().display().to_string(),
        format!("/dev/shm/{}", place.prefix()),
    );
    let mut seen = 0;
    for line in text
        .lines()
        .filter(|line| line.contains(&root) || line.contains(&memory) || line.contains("O_TMPFILE"))
    {
        // Modes are the only numbers that are written with a leading zero.
        let mode = line
            .split(|c: char| !c.is_ascii_alphanumeric() && c != '_')
            .filter(|word| word.len() >= 4 && word.starts_with('0') && word.bytes().all(|b| b.is_ascii_digit()))
            .find_map(|word| u32::from_str_radix(word, 8).ok());
        let Some(mode) = mode else { continue };
        seen += 1;
        // Below the root the group may enter directories that it cannot reach.
        let below = line.contains(&format!("{root}/"));
        assert!(mode & 0o077 == 0 || (below && mode == 0o750), "{line}");
    }
    assert!(seen > 50, "{seen} modes in\n{text}");
    // The trace shows who makes the object that every join opens: not iceoryx2, which opens it to
    // all.
    let object = text
        .lines()
        .any(|line| line.contains("linkat") && line.contains(&memory));
    assert!(object, "{text}");
}

#[test]
fn fault_who_holds_the_lock_of_a_domain_and_stands_still_is_named_in_time() {
    let place = Place::new(User::own());
    let mut first = place.start(PLANT, &["--speed", "1", "--duration", "0.1"]);
    first.expect_code(0);
    // Another program, as it would be in the middle of a clean-up.
    let lock = place.root().join("members.lock");
    let mut holder = std::process::Command::new("flock");
    holder.arg(&lock).args(["sleep", "1000"]);
    let mut holder = Process::start(holder);
    eventually("the lock is held", || {
        let file = std::fs::File::open(&lock).expect("there");
        file.try_lock().is_err().then_some(())
    });
    // Looking alone needs no lock.
    let others = programs().into_iter().filter(|(_, args)| args[..] != ["doctor"]);
    let refused: Vec<Process> = others.map(|(program, args)| place.start(program, &args)).collect();
    for process in refused {
        expect_refusal(process, &["members.lock", "process ", "5 s", "kill -CONT"]);
    }
    holder.signal_group(Signal::SIGKILL);
    holder.wait();
    place
        .start(PLANT, &["--speed", "1", "--duration", "0.1"])
        .expect_code(0);
}
