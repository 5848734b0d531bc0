//! Many robots in one identifier process.

use crate::support::{PAPER, Process, Program, SERVO, Site, eventually};
use nix::sys::signal::Signal;
use std::path::PathBuf;
use std::process::Command;
use std::thread;
use std::time::Duration;
use thetabus::bus::{Bus, Delivery, Domain, Limits, SamplePublisher, Subscriber};
use thetabus::config::{Config, Source};
use thetabus::messages::{Estimate, Sample, State, Status, sample_flags};
use thetabus::node::simulated_plant::sample_stream_of;

const BLOCKS: &str = "estimator.block_len=200";

/// A file for two arms, an axis and what they share.
fn file(site: &Site) -> PathBuf {
    let path = site.dir.path().join("cell.toml");
    let text = format!(
        "[bus]\nsample_buffer = 1024\nmax_sample_subscribers = 4\nmax_estimate_subscribers = 4\n\
         [estimator]\nblock_len = 200\n\
         [checkpoint]\ndir = \"checkpoints\"\nperiod_s = 3600\n\
         [[robot]]\nname = \"arm\"\nconfig = {PAPER:?}\ncount = 2\n\
         [[robot]]\nname = \"axis\"\nconfig = {SERVO:?}\n"
    );
    std::fs::write(&path, text).expect("write");
    std::fs::create_dir_all(site.dir.path().join("checkpoints")).expect("a directory");
    path
}

fn config(file: &str, duration_s: u32) -> Config {
    let arguments = [BLOCKS.to_owned(), format!("plant.duration_s={duration_s}")];
    Config::load(&[Source::File(file.into())], &arguments).expect("valid")
}

/// The samples of a configuration's machine.
fn samples(config: &Config, stream_id: u64) -> Vec<Sample> {
    let mut node = sample_stream_of(&*config.model, &config.plant.sim, stream_id).expect("a machine");
    std::iter::from_fn(|| node.next_sample()).collect()
}

fn limited(domain: &Domain) -> Domain {
    domain.clone().with_limits(Limits {
        sample_buffer: 1024,
        sample_subscribers: 4,
        estimate_subscribers: 4,
        programs: 64,
    })
}

/// One robot as a machine and a reader see it.
struct Robot {
    publisher: SamplePublisher,
    estimates: Subscriber<Estimate>,
    statuses: Subscriber<Status>,
    seen: Vec<Estimate>,
    status: Option<Status>,
}

impl Robot {
    fn new(domain: &Domain, name: &str) -> Self {
        let bus = Bus::join(&limited(domain), name, "machine").expect("join");
        Self {
            publisher: SamplePublisher::new(&bus, Delivery::Realtime, Default::default()).expect("a publisher"),
            estimates: Subscriber::new(&bus).expect("subscribe"),
            statuses: Subscriber::new(&bus).expect("subscribe"),
            seen: Vec::new(),
            status: None,
        }
    }

    fn look(&mut self) {
        let (seen, status) = (&mut self.seen, &mut self.status);
        self.estimates.drain(|e| seen.push(*e)).expect("drain");
        self.statuses.drain(|s| *status = Some(*s)).expect("drain");
    }

    fn send(&mut self, samples: &[Sample]) {
        for sample in samples {
            self.publisher.send(sample).expect("send");
        }
        self.look();
    }

    /// Waits until the identifier has connected to its samples.
    fn connected(&mut self) {
        eventually("the identifier takes samples", || {
            self.publisher.serve_late_joiners().expect("serve");
            (self.publisher.attached() > 0).then_some(())
        });
        // Its end is connected within a tick of seeing the publisher.
        thread::sleep(Duration::from_millis(50));
    }

    fn ended(&mut self, stream_id: u64) -> Status {
        eventually("the end has come through", || {
            self.look();
            let ended = |s: &Status| s.stream_id == stream_id && s.state == State::Ended as u32;
            self.status.filter(ended)
        })
    }
}

#[test]
fn val_garbage_and_silence_of_other_robots_change_no_bit_of_an_estimate() {
    let site = Site::new();
    let file = file(&site);
    let mut identifier = site.start(Program::Identifier, &["--config", file.to_str().expect("UTF-8")]);
    let [mut good, mut bad] = ["arm-1", "arm-2"].map(|name| Robot::new(&site.domain, name));
    good.connected();
    bad.connected();

    let config = config(PAPER, 4);
    let stream = samples(&config, 77);
    for (i, chunk) in stream.chunks(50).enumerate() {
        good.send(chunk);
        // The neighbour begins new streams, jumps, repeats samples, sends values that are not
        // numbers, and sends faster than anyone can receive.
        for k in 0..400_u64 {
            let mut sample = stream[(k as usize * 7) % stream.len()];
            sample.stream_id = 1 + (k + i as u64) % 5;
            sample.seq = sample.seq.wrapping_mul(k).wrapping_sub(3);
            sample.joints = (k % 11) as u32;
            sample.q[0] = [f64::NAN, f64::INFINITY, 1e300, -0.0][k as usize % 4];
            sample.flags = (k % 4) as u32 & sample_flags::END;
            bad.publisher.send(&sample).expect("send");
        }
        bad.look();
        thread::sleep(Duration::from_millis(5));
    }
    let status = good.ended(77);
    assert_eq!(
        (status.accepted, status.missing, status.rejected),
        (stream.len() as u64, 0, 0)
    );

    let mut alone = config.identifier().expect("a node");
    let mut expected = Vec::new();
    for sample in &stream {
        alone.on_sample(sample, &mut |estimate| expected.push(*estimate));
    }
    assert_eq!(expected.len(), 20);
    // As text, which tells every bit apart and takes a standard deviation that is not known, NaN,
    // for equal.
    let text = |estimates: &[Estimate]| estimates.iter().map(|e| format!("{e:?}")).collect::<Vec<_>>();
    assert!(
        text(&good.seen) == text(&expected),
        "{:?}\n{:?}",
        good.seen.last(),
        expected.last()
    );
    // Its samples arrived, and no estimate from them may be used.
    bad.look();
    assert!(bad.status.is_some_and(|status| status.rejected > 0));
    assert!(bad.seen.iter().all(|estimate| estimate.use_ok == 0));

    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(0);
    for line in [
        "arm-1: 4000 samples accepted, 0 missing",
        "arm-2: ",
        "axis: 0 samples accepted",
    ] {
        assert!(identifier.stdout().contains(line), "{line}\n{}", identifier.said());
    }
}

#[test]
fn e2e_each_robot_of_a_process_has_its_own_commands_description_and_checkpoint() {
    let site = Site::new();
    let file = file(&site);
    let file = file.to_str().expect("UTF-8");
    let ctl = |robot: &str, what: &str| {
        let mut ctl = site.start(Program::Thetabus, &["ctl", what, "--config", file, "--robot", robot]);
        ctl.expect_code(0);
        ctl.stdout()
    };
    let mut identifier = site.start(Program::Identifier, &["--config", file]);
    let mut robots = [("arm-1", PAPER), ("axis", SERVO)].map(|(name, own)| {
        let mut robot = Robot::new(&site.domain, name);
        robot.connected();
        (robot, samples(&config(own, 2), 5))
    });
    assert!(ctl("arm-2", "describe").contains("theta_9"));
    assert!(ctl("axis", "describe").contains("coulomb"));
    ctl("axis", "pause");
    for (robot, stream) in &mut robots {
        for chunk in stream.chunks(100) {
            robot.send(chunk);
            thread::sleep(Duration::from_millis(10));
        }
        robot.ended(5);
    }
    let [(arm, _), (axis, _)] = &robots;
    assert!(arm.seen.iter().all(|estimate| estimate.state != State::Paused as u32));
    assert!(!axis.seen.is_empty() && axis.seen.iter().all(|estimate| estimate.state == State::Paused as u32));
    identifier.signal(Signal::SIGTERM);
    identifier.expect_code(0);
    let kept = |name: &str| site.dir.path().join(format!("checkpoints/{name}.checkpoint")).exists();
    assert!(
        kept("arm-1") && !kept("arm-2") && !kept("axis"),
        "{}",
        identifier.said()
    );
    let warm = site.start(Program::Identifier, &["--config", file, "--warm"]);
    warm.wait_for_log("warm start from");
    warm.wait_for_log("no checkpoint");
}

#[test]
fn e2e_a_load_of_simulated_robots_is_identified_without_a_loss() {
    let site = Site::new();
    let file = file(&site);
    let file = file.to_str().expect("UTF-8");
    let identifier = site.start(Program::Identifier, &["--config", file]);
    identifier.wait_for_log("identifier");
    let args = ["load", "--config", file, "--speed", "1", "--duration", "2"];
    let mut load = site.start(Program::Thetabus, &args);
    load.expect_code(0);
    for line in [
        "3 robots, 6000 samples sent",
        "6000 samples accepted, 0 missing, 0 rejected",
        "% of a core",
    ] {
        assert!(load.stdout().contains(line), "{line}\n{}", load.said());
    }
    let mut fast = site.start(Program::Thetabus, &["load", "--config", file, "--speed", "max"]);
    fast.expect_code(2);
    fast.expect_stderr(&["real time", "--speed"]);
}

/// An identifier of three robots with room for so few files that one worker, both, or neither can
/// open its ports: it serves, or it ends in words. One that could not begin made the other wait for
/// ever.
#[test]
fn fault_a_worker_that_cannot_begin_makes_no_other_wait() {
    let (mut refused, mut served) = (0, 0);
    for limit in [24, 32, 40, 48, 56, 72, 120] {
        let site = Site::new();
        let file = file(&site);
        let mut command = Command::new("sh");
        command
            .current_dir(site.dir.path())
            .args(["-c", &format!("ulimit -n {limit} && exec \"$@\""), "sh"])
            .args([
                env!("CARGO_BIN_EXE_identifier"),
                "--domain",
                site.domain.name(),
                "--config",
            ])
            .arg(&file);
        let mut identifier = Process::start(command);
        let is_refused = eventually("the identifier serves or ends", || {
            if !identifier.is_running() {
                return Some(true);
            }
            let ask = ["ctl", "describe", "--timeout", "1", "--robot", "axis", "--config"];
            let mut ctl = site.start(
                Program::Thetabus,
                &[&ask[..], &[file.to_str().expect("UTF-8")]].concat(),
            );
            ctl.wait().success().then_some(false)
        });
        if is_refused {
            identifier.expect_code(1);
            identifier.expect_stderr(&["error: "]);
            refused += 1;
        } else {
            identifier.signal(Signal::SIGTERM);
            identifier.expect_code(0);
            served += 1;
        }
    }
    assert!(refused > 0 && served > 0, "{refused} refused, {served} served");
}

#[test]
fn fault_entries_that_cannot_be_meant_are_refused_by_name() {
    let site = Site::new();
    let path = site.dir.path().join("cell.toml");
    for (text, parts) in [
        (
            "[[robot]]\nnam = \"a\"\n",
            &["cell.toml:2: robot[1].nam: unknown key"][..],
        ),
        (
            "[[robot]]\nname = \"A b\"\n[[robot]]\nname = \"a\"\ncount = 0\n",
            &[
                "cell.toml:2: robot[1].name: ",
                "\"A b\"",
                "cell.toml:5: robot[2].count: ",
            ],
        ),
        ("[[robot]]\nname = \"a\"\nconfig = \"none.toml\"\n", &["none.toml"]),
        (
            "[[robot]]\nname = \"a\"\n[[robot]]\nname = \"b\"\n[bus]\nrobt = 1\n",
            &["cell.toml:", "bus.robt"],
        ),
    ] {
        std::fs::write(&path, text).expect("write");
        let mut identifier = site.start(Program::Identifier, &["--config", "cell.toml"]);
        identifier.expect_code(2);
        identifier.expect_stderr(parts);
    }
    let file = file(&site);
    let file = file.to_str().expect("UTF-8");
    for args in [
        &["run", file][..],
        &["ctl", "pause", "--config", file],
        &["watch", "--config", file],
    ] {
        let mut program = site.start(Program::Thetabus, args);
        program.expect_code(2);
        program.expect_stderr(&["3 robots", "arm-1, arm-2, axis", "--robot"]);
    }
    let mut program = site.start(Program::Monitor, &["--config", file, "--robot", "arm"]);
    program.expect_code(2);
    program.expect_stderr(&["\"arm\"", "arm-1"]);
}
