//! Killed at any moment of its start or its end, a program leaves nothing that hinders the next one
//! or makes a live system in the same domain hang.
//!
//! strace kills at the entry of a system call. Between two calls that change a file nothing changes
//! that others could see, but for memory that is shared already, so the short tests kill at some of
//! the calls that change something, the long ones at all.

use crate::peers::{Place, User, permitted};
use crate::support::{Process, WATCHDOG, eventually};
use nix::sys::signal::Signal;
use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

const PLANT: &str = env!("CARGO_BIN_EXE_plant_simulator");
const IDENTIFIER: &str = env!("CARGO_BIN_EXE_identifier");
const MONITOR: &str = env!("CARGO_BIN_EXE_monitor");
const THETABUS: &str = env!("CARGO_BIN_EXE_thetabus");

/// What the next start may take, beside what a start on clean ground takes on this machine now.
const NEXT_START: Duration = Duration::from_secs(3);
/// A program that has been started under strace and has not been killed by then does not make the
/// call any more.
const VICTIM_LIMIT: Duration = Duration::from_secs(4);

/// A program that is killed, and the sign that it works.
#[derive(Clone, Copy)]
struct Victim {
    program: &'static str,
    args: &'static [&'static str],
    /// Words of its log when it works; without them it works by ending well.
    works: Option<&'static str>,
    /// Robot whose other programs live in a live system.
    robot: &'static str,
}

const VICTIMS: [Victim; 5] = [
    Victim {
        program: PLANT,
        args: &["--speed", "1", "--duration", "0.1"],
        works: None,
        robot: "without-plant",
    },
    Victim {
        program: IDENTIFIER,
        args: &[],
        works: Some("block_len"),
        robot: "without-identifier",
    },
    Victim {
        program: MONITOR,
        args: &[],
        works: Some(" monitor"),
        robot: "arm",
    },
    Victim {
        program: THETABUS,
        args: &["ctl", "describe"],
        works: None,
        robot: "arm",
    },
    Victim {
        program: THETABUS,
        args: &["doctor", "--clean"],
        works: None,
        robot: "",
    },
];

impl Victim {
    fn name(&self) -> String {
        let stem = self.program.rsplit('/').next().expect("a name");
        [&[stem], self.args].concat().join(" ")
    }

    fn args<'a>(&'a self, fresh: &'a [String]) -> Vec<&'a str> {
        let robot: &[&str] = match self.robot {
            "" => &[],
            robot => &["--robot", robot],
        };
        let fresh = fresh.iter().map(String::as_str);
        self.args
            .iter()
            .copied()
            .chain(robot.iter().copied())
            .chain(fresh)
            .collect()
    }
}

/// A domain with or without a live system.
struct Scene {
    place: Place,
    living: Vec<Process>,
    outputs: std::cell::Cell<usize>,
}

impl Scene {
    fn empty(user: User) -> Self {
        Self {
            place: Place::new(user),
            living: Vec::new(),
            outputs: std::cell::Cell::new(0),
        }
    }

    /// Whole and partial systems, so that every victim finds the others of its robot.
    fn alive(user: User) -> Self {
        let mut scene = Self::empty(user);
        let programs: [(&str, &[&str]); 7] = [
            (PLANT, &["--speed", "1", "--duration", "100000", "--robot", "arm"]),
            (IDENTIFIER, &["--robot", "arm"]),
            (MONITOR, &["--robot", "arm"]),
            (
                PLANT,
                &["--speed", "1", "--duration", "100000", "--robot", "without-identifier"],
            ),
            (MONITOR, &["--robot", "without-identifier"]),
            (IDENTIFIER, &["--robot", "without-plant"]),
            (MONITOR, &["--robot", "without-plant"]),
        ];
        for (program, args) in programs {
            let out = scene.fresh(program);
            let out: Vec<&str> = out.iter().map(String::as_str).collect();
            scene
                .living
                .push(scene.place.start(program, &[args, &out[..]].concat()));
        }
        eventually("the live system answers", || scene.answers().ok());
        scene
    }

    /// A monitor writes a recording of its own each time: it then reads the samples, too.
    fn fresh(&self, program: &str) -> Vec<String> {
        if program != MONITOR {
            return Vec::new();
        }
        self.outputs.set(self.outputs.get() + 1);
        vec!["--record".into(), format!("{}.mcap", self.outputs.get())]
    }

    /// Do both identifiers answer? They look at plant and monitor between two answers. The caller
    /// judges how long it takes.
    fn answers(&self) -> Result<(), String> {
        for robot in ["arm", "without-plant"] {
            let ask = ["ctl", "describe", "--timeout", "40", "--robot", robot];
            let mut ctl = self.place.start(THETABUS, &ask);
            if !ctl.wait().success() {
                return Err(format!("{robot}: {}", ctl.said()));
            }
        }
        Ok(())
    }

    fn begin(&self, victim: &Victim, before: &[&str]) -> Process {
        let fresh = self.fresh(victim.program);
        let args = victim.args(&fresh);
        Process::start(self.place.command(before, victim.program, &args))
    }

    /// Starts the program as users do and waits until it works; how long that took.
    #[track_caller]
    fn next_start(&self, victim: &Victim) -> Duration {
        self.try_start(victim).unwrap_or_else(|said| panic!("{said}"))
    }

    /// The same; the error is what a program said that did not work.
    fn try_start(&self, victim: &Victim) -> Result<Duration, String> {
        let start = Instant::now();
        let mut process = self.begin(victim, &[]);
        let said = |process: &Process| format!("{}: {}", victim.name(), process.said());
        let Some(words) = victim.works else {
            let (status, took) = (process.wait(), start.elapsed());
            let is_done =
                status.success() || (self.living.is_empty() && said(&process).contains("no identifier of robot"));
            return if is_done { Ok(took) } else { Err(said(&process)) };
        };
        while !process.stderr().contains(words) {
            if !process.is_running() {
                process.wait();
                return Err(said(&process));
            }
            if start.elapsed() > WATCHDOG {
                return Err(said(&process));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let took = start.elapsed();
        process.signal(Signal::SIGTERM);
        process.expect_code(0);
        Ok(took)
    }

    /// Starts a program and kills it at this call.
    fn kill_at(&self, victim: &Victim, (call, count): &(String, usize)) {
        let (trace, inject) = (
            format!("trace={call}"),
            format!("inject={call}:signal=KILL:when={count}"),
        );
        let strace = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", &trace, "-e", &inject];
        let mut process = self.begin(victim, &strace);
        until_its_end(victim, &mut process);
    }

    /// The calls of a start and an end, in their order: name, how often it has been made, and
    /// whether it changes a file.
    fn calls(&self, victim: &Victim) -> Vec<((String, usize), bool)> {
        let log = self.place.dir.path().join("trace");
        let log = log.to_str().expect("UTF-8");
        let mut process = self.begin(victim, &["strace", "-f", "-qq", "-o", log]);
        until_its_end(victim, &mut process);
        let text = std::fs::read_to_string(log).expect("strace writes a log");
        let mut counts: HashMap<(&str, &str), usize> = HashMap::new();
        let mut seen = HashSet::new();
        let mut calls = Vec::new();
        for line in text.lines() {
            let Some((thread, rest)) = line.split_once(char::is_whitespace) else {
                continue;
            };
            let Some((name, args)) = rest.trim_start().split_once('(') else {
                continue;
            };
            if !name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_') {
                continue;
            }
            let count = counts.entry((thread, name)).or_default();
            *count += 1;
            // strace counts each thread's calls; a wait that is repeated changes nothing.
            let is_wait = ["clock_nanosleep", "futex", "recvfrom"].contains(&name) && *count > 3;
            let call = (name.to_owned(), *count);
            if !is_wait && !["execve", "exit", "exit_group"].contains(&name) && seen.insert(call.clone()) {
                calls.push((call, changes(name, args)));
            }
        }
        calls
    }

    /// Kills a start at each of these calls, and looks after each kill at the next start and at the
    /// live system. What goes wrong is collected, so that one run of the long tests shows all of
    /// it.
    fn must_survive(&mut self, victim: &Victim, calls: &[(String, usize)]) {
        let clean = self.next_start(victim);
        let mut failures = Vec::new();
        for (n, call) in calls.iter().enumerate() {
            if self.living.is_empty() {
                self.place.clear();
            }
            self.kill_at(victim, call);
            let context = format!("{} killed at {} number {}", victim.name(), call.0, call.1);
            let took = match self.try_start(victim) {
                Ok(took) => took,
                Err(said) => {
                    failures.push(format!("{context}: {said}"));
                    continue;
                }
            };
            // On a machine that others have made busy meanwhile, a start on clean ground takes
            // longer, too.
            let allowed = |scene: &Self, factor: u32| {
                let limit = factor * (NEXT_START + 4 * clean);
                took < limit || took < factor * (NEXT_START + 4 * scene.next_start(victim))
            };
            if !allowed(self, 1) {
                failures.push(format!(
                    "{context}: the next start took {took:?}, an undisturbed one {clean:?}"
                ));
            }
            if !self.living.is_empty() {
                let start = Instant::now();
                if let Err(said) = self.answers() {
                    failures.push(format!("{context}: the live system does not answer, {said}"));
                }
                let took = start.elapsed();
                for process in &mut self.living {
                    assert!(process.is_running(), "{context}: {}", process.said());
                }
                if took >= 2 * (NEXT_START + 4 * clean) {
                    failures.push(format!("{context}: the live system took {took:?} to answer"));
                }
            }
            if n % 100 == 99 {
                eprintln!("{}: {} of {} calls, {failures:#?}", victim.name(), n + 1, calls.len());
            }
        }
        assert!(failures.is_empty(), "{failures:#?}");
    }
}

/// Waits for the end of a traced program: its own, the one that strace gives it, or one on request
/// as soon as it works.
fn until_its_end(victim: &Victim, process: &mut Process) {
    let start = Instant::now();
    let mut asked = false;
    while process.is_running() && start.elapsed() < VICTIM_LIMIT {
        if !asked && victim.works.is_some_and(|words| process.stderr().contains(words)) {
            asked = true;
            process.signal_group(Signal::SIGTERM);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    if process.is_running() {
        process.signal_group(Signal::SIGKILL);
    }
    process.wait();
}

impl Drop for Scene {
    fn drop(&mut self) {
        // Before their domain goes.
        for process in &mut self.living {
            process.signal(Signal::SIGKILL);
            process.wait();
        }
    }
}

/// Does the call change what others can see?
fn changes(name: &str, args: &str) -> bool {
    match name {
        "openat" => args.contains("O_CREAT") || args.contains("O_TMPFILE"),
        "ftruncate" | "fallocate" | "fchmod" | "chmod" | "mkdir" | "rmdir" | "unlink" | "rename" | "linkat"
        | "bind" | "flock" => true,
        "fcntl" => args.contains("SETLK"),
        _ => false,
    }
}

fn may_trace(user: User) -> bool {
    // Traced by the user's own strace, as in the tests.
    user.is_possible() && {
        let words = ["strace", "-f", "-qq", "-o", "/dev/null", "true"];
        match user.is_own() {
            true => permitted(words[0], &words[1..]),
            false => {
                let ids = [format!("--reuid={}", user.0), format!("--regid={}", user.0)];
                permitted(
                    "setpriv",
                    &[&[&*ids[0], &ids[1], "--clear-groups", "--"], &words[..]].concat(),
                )
            }
        }
    }
}

const OTHER: User = User(65_534);

fn users() -> Vec<User> {
    [User::own(), OTHER]
        .into_iter()
        .filter(|user| may_trace(*user))
        .collect()
}

/// Some of the calls that change something: one of `stride`, and those before which shared memory
/// is empty and after which it has its size but nobody may read it.
fn some(calls: &[((String, usize), bool)], stride: usize) -> Vec<(String, usize)> {
    let changing: Vec<_> = calls
        .iter()
        .filter(|(_, changes)| *changes)
        .map(|(call, _)| call)
        .collect();
    let is_size = |call: &(String, usize)| call.0 == "ftruncate" && call.1 <= 4;
    let half_made = (0..changing.len()).filter(|&n| is_size(changing[n]) || (n > 0 && is_size(changing[n - 1])));
    let spread = (2..changing.len()).step_by(stride);
    let chosen: std::collections::BTreeSet<usize> = half_made.chain(spread).collect();
    chosen.into_iter().map(|n| changing[n].clone()).collect()
}

#[test]
fn fault_a_start_killed_at_some_system_calls_hinders_no_later_one() {
    for user in users() {
        let mut scene = Scene::empty(user);
        // A step prime to the pattern of calls that repeats from object to object.
        for victim in &VICTIMS[..3] {
            let calls = scene.calls(victim);
            assert!(calls.len() > 100, "{}: {}", victim.name(), calls.len());
            scene.must_survive(victim, &some(&calls, 37));
        }
    }
}

#[test]
fn fault_a_start_killed_beside_a_live_system_makes_nobody_hang() {
    for user in users() {
        let mut scene = Scene::alive(user);
        for victim in &VICTIMS {
            let calls = scene.calls(victim);
            scene.must_survive(victim, &some(&calls, 71));
        }
    }
}

/// Kills a start of this program at every single system call.
fn every_call(user: User, victim: usize, is_alive: bool) {
    if !may_trace(user) {
        return;
    }
    let mut scene = match is_alive {
        true => Scene::alive(user),
        false => Scene::empty(user),
    };
    let victim = &VICTIMS[victim];
    let calls: Vec<_> = scene.calls(victim).into_iter().map(|(call, _)| call).collect();
    let place = if is_alive { "beside a live system" } else { "alone" };
    eprintln!("{} as user {}, {place}: {} calls", victim.name(), user.0, calls.len());
    assert!(calls.len() > 100, "{}: {}", victim.name(), calls.len());
    scene.must_survive(victim, &calls);
}

/// A test for each program, so that they can be run by themselves and side by side.
macro_rules! every_call {
    ($place:ident, $user:expr, $is_alive:expr) => {
        mod $place {
            use super::*;

            every_call!(@ fault_plant_killed_at_every_system_call, $user, 0, $is_alive);
            every_call!(@ fault_identifier_killed_at_every_system_call, $user, 1, $is_alive);
            every_call!(@ fault_monitor_killed_at_every_system_call, $user, 2, $is_alive);
            every_call!(@ fault_ctl_killed_at_every_system_call, $user, 3, $is_alive);
            every_call!(@ fault_doctor_killed_at_every_system_call, $user, 4, $is_alive);
        }
    };
    (@ $name:ident, $user:expr, $victim:expr, $is_alive:expr) => {
        #[test]
        #[ignore = "ten minutes or more"]
        fn $name() {
            every_call($user, $victim, $is_alive);
        }
    };
}

every_call!(alone, User::own(), false);
every_call!(beside_a_live_system, User::own(), true);
every_call!(another_user_alone, OTHER, false);
every_call!(another_user_beside_a_live_system, OTHER, true);

/// The object that iceoryx2 keeps per domain and every join opens.
fn management(place: &Place) -> std::path::PathBuf {
    let hash = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5";
    format!("/dev/shm/{}{hash}_node.0_10_0.global_mgmt", place.prefix()).into()
}

/// A file of this user with this size and mode.
fn put(user: User, path: &std::path::Path, size: u32, mode: &str) {
    let script = format!(r#"rm -f "$0"; head -c {size} /dev/zero > "$0" && chmod {mode} "$0""#);
    assert!(user.can(&script, path), "{}", path.display());
}

#[test]
fn fault_half_made_objects_hinder_no_join_no_clean_up_and_no_living_program() {
    for user in [User::own(), OTHER].into_iter().filter(|user| user.is_possible()) {
        for (size, mode) in [(0, "0200"), (0, "0600"), (16, "0200"), (0, "0666")] {
            let scene = Scene::empty(user);
            let root = scene.place.root();
            let make_root = r#"mkdir -m 0700 "$0""#;
            assert!(user.can(make_root, &root));
            for victim in VICTIMS {
                put(user, &management(&scene.place), size, mode);
                let took = scene.next_start(&victim);
                assert!(
                    took < NEXT_START + NEXT_START,
                    "{} as {user:?}: {took:?}",
                    victim.name()
                );
                assert!(root.exists() || victim.args.contains(&"--clean"));
                if !root.exists() {
                    assert!(user.can(make_root, &root));
                }
            }
        }
    }
}

/// Stops a start of a program at this call and starts the others beside it: each works or is
/// refused in words, in time.
fn stand_still(scene: &Scene, maker: &Victim, (call, count): (&str, usize)) {
    let (trace, inject) = (
        format!("trace={call}"),
        format!("inject={call}:signal=STOP:when={count}"),
    );
    let strace = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", &trace, "-e", &inject];
    let stopped = scene.begin(maker, &strace);
    let context = format!("{} stands still at {call} number {count}", maker.name());
    eventually(&context, || is_anything_stopped(&scene.place.domain).then_some(()));
    let start = Instant::now();
    let others: Vec<_> = VICTIMS
        .iter()
        .map(|victim| (victim, scene.begin(victim, &[])))
        .collect();
    for (victim, mut process) in others {
        loop {
            if !process.is_running() {
                break;
            }
            if victim.works.is_some_and(|words| process.stderr().contains(words)) {
                process.signal(Signal::SIGTERM);
                break;
            }
            assert!(
                start.elapsed() < STANDSTILL,
                "{context}: {} hangs\n{}",
                victim.name(),
                process.said()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
        let status = process.wait();
        assert!(
            start.elapsed() < STANDSTILL,
            "{context}: {} took {:?}",
            victim.name(),
            start.elapsed()
        );
        let is_refused = status.code() == Some(1) && process.stderr().contains("error: ");
        assert!(status.success() || is_refused, "{context}: {}", process.said());
    }
    stopped.signal_group(Signal::SIGKILL);
}

/// What the others may take beside a program that stands still: 5 s until they give a lock up, the
/// same again where they meet what it had half made, and their starts on a busy machine.
const STANDSTILL: Duration = Duration::from_secs(30);

/// Has a process with this domain on its command line been stopped? Under strace each one stops at
/// every call for an instant.
fn is_anything_stopped(domain: &str) -> bool {
    let is_stopped = |process: &std::path::Path| {
        std::fs::read_to_string(process.join("stat")).is_ok_and(|stat| {
            stat.rsplit_once(") ")
                .is_some_and(|(_, rest)| rest.starts_with(['T', 't']))
        })
    };
    let processes = std::fs::read_dir("/proc").expect("/proc").flatten();
    processes.into_iter().map(|entry| entry.path()).any(|process| {
        let has_domain = std::fs::read(process.join("cmdline"))
            .is_ok_and(|line| line.split(|&byte| byte == 0).any(|word| word == domain.as_bytes()));
        has_domain
            && (0..30).all(|_| {
                std::thread::sleep(Duration::from_millis(10));
                is_stopped(&process)
            })
    })
}

#[test]
fn fault_a_program_that_stands_still_in_its_start_makes_nobody_hang() {
    if !may_trace(User::own()) {
        return;
    }
    // Empty objects of a node, of a service, of a port, and the lock of the members while it is
    // held.
    for (maker, call) in [(0, ("ftruncate", 2)), (1, ("ftruncate", 4)), (2, ("fchmod", 1))] {
        let scene = Scene::empty(User::own());
        stand_still(&scene, &VICTIMS[maker], call);
    }
}

#[test]
#[ignore = "ten minutes: stopped at each call that gives an object its size or opens it to readers"]
fn fault_a_program_that_stands_still_at_any_object_makes_nobody_hang() {
    if !may_trace(User::own()) {
        return;
    }
    for maker in &VICTIMS[..3] {
        let calls = Scene::empty(User::own()).calls(maker);
        let made = calls
            .iter()
            .filter(|((call, _), _)| ["ftruncate", "fchmod", "bind"].contains(&&**call));
        for ((call, count), _) in made {
            eprintln!("{} at {call} number {count}", maker.name());
            stand_still(&Scene::empty(User::own()), maker, (call, *count));
        }
    }
}

/// Kills a start of each program in turn at some time in its first 20 ms; the next start must work,
/// and quickly so.
fn early_kills(count: u64) {
    let scene = Scene::empty(User::own());
    let clean: Vec<Duration> = VICTIMS.iter().map(|victim| scene.next_start(victim)).collect();
    for n in 0..count {
        let which = (n % VICTIMS.len() as u64) as usize;
        let mut process = scene.begin(&VICTIMS[which], &[]);
        // The golden ratio spreads them evenly, however many there are.
        let fraction = (n as f64 * 0.618_033_988_749_895).fract();
        std::thread::sleep(Duration::from_secs_f64(0.02 * fraction));
        let _ = nix::sys::signal::kill(nix::unistd::Pid::from_raw(process.pid().cast_signed()), Signal::SIGKILL);
        process.wait();
        // One in five is looked at; what hinders stays until then.
        if n % 5 == 4 {
            let next = (n / 5 % VICTIMS.len() as u64) as usize;
            let took = scene.next_start(&VICTIMS[next]);
            assert!(
                took < NEXT_START + 4 * clean[next],
                "after kill {n}: {took:?}, else {:?}",
                clean[next]
            );
        }
    }
}

#[test]
fn fault_kills_in_the_first_milliseconds_hinder_no_later_start() {
    early_kills(150);
}

#[test]
#[ignore = "a quarter of an hour: 5000 kills in the first 20 ms"]
fn fault_thousands_of_early_kills_hinder_no_later_start() {
    early_kills(5_000);
}
