//! `thetabus run`: the three processes, one result.

use crate::support::{Program, QUICK, Site, column, cpu_time, eventually};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::thread;
use std::time::{Duration, Instant};
use thetabus::bus::{Bus, SampleSubscriber};

#[test]
fn e2e_the_papers_experiment_loses_nothing_and_leaves_table_and_files() {
    let site = Site::new();
    let mut run = site.start_run(&[]);
    run.expect_code(0);

    let stdout = run.stdout();
    for part in [
        "truth",
        "theta_1",
        "theta_9",
        "89 blocks, 170000 samples accepted, 0 missing, 0 rejected",
    ] {
        assert!(stdout.contains(part), "{part:?} is not in\n{stdout}");
    }
    let last: Vec<&str> = stdout.lines().rev().take(2).collect();
    let page = site.out().join("report.html");
    assert_eq!(
        last,
        [
            format!("open {}", page.display()),
            format!("results in {}", site.out().display())
        ]
    );

    let summary = site.summary();
    assert_eq!(
        (
            summary.samples.accepted,
            summary.samples.missing,
            summary.samples.rejected
        ),
        (170_000, 0, 0)
    );
    assert_eq!((summary.blocks, summary.parameters.len()), (89, 9));
    // A payload of 20 kg was picked up after 45 s: the truth is that of the end.
    let theta_7 = &summary.parameters[6];
    assert!(
        (theta_7.truth.expect("simulated") - 0.295_652).abs() < 1e-6,
        "{theta_7:?}"
    );
    assert!(summary.wall_s.expect("measured") > 0.0);
    let blocks = column(&site.out().join("estimates.csv"), "block");
    assert_eq!(blocks, (1..=89).map(f64::from).collect::<Vec<_>>());
    assert_eq!(site.processes(), Vec::<u32>::new());
    assert_eq!(site.shared_memory(), Vec::<String>::new());
}

#[test]
fn e2e_without_a_configuration_encoders_and_voltages_are_enough() {
    let site = Site::new();
    let out = site.out();
    let mut run = site.start(Program::Thetabus, &["run", "--out", out.to_str().expect("UTF-8")]);
    run.expect_code(0);
    let summary = site.summary();
    assert_eq!((summary.blocks, summary.samples.accepted), (89, 170_000));
    for parameter in &summary.parameters {
        let truth = parameter.truth.expect("simulated");
        let (theta, std) = (parameter.estimate.expect("known"), parameter.std.expect("known"));
        // One run and nine parameters: a deviation of 4.5 comes once in some 16 000 such runs.
        assert!((theta - truth).abs() < 4.5 * std, "{parameter:?}");
    }
    for parameter in &summary.parameters[4..] {
        // The worst of 20 seeds is 0.031 %, docs/encoder-results.md; twice that leaves room for
        // another reference.
        let error = parameter.relative_error.expect("simulated");
        assert!(error.abs() < 6e-4, "{parameter:?}");
    }
    let jump = &summary.changes[0];
    // The window of 100 ms and the noise, docs/encoder-results.md: within 30 ms in 20 of 20 runs.
    assert!((jump.t_s - 45.0).abs() < 0.05, "{jump:?}");
    let named = std::fs::read_to_string(out.join("config.toml")).expect("config.toml");
    assert!(named.contains("rows = \"projected\""), "{named}");
}

#[test]
fn e2e_the_estimates_converge_to_the_truth() {
    let site = Site::new();
    site.start_run(&[
        "--duration",
        "20",
        QUICK[2],
        QUICK[3],
        "--set",
        "estimator.block_len=500",
    ])
    .expect_code(0);
    for parameter in site.summary().parameters {
        let error = parameter.relative_error.expect("the truth is known");
        // Exact signals and a constant plant: what is left is the start values' weight, some 1e-3
        // of information beside 1e4 and more in each direction per block.
        assert!(error.abs() < 1e-5, "{}: {error}", parameter.name);
    }
}

#[test]
fn e2e_a_servo_axis_is_simulated_and_identified_from_position_and_voltage() {
    let site = Site::new();
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/servo_axis.toml");
    site.start_run(&[config, "--duration", "20"]).expect_code(0);
    let summary = site.summary();
    assert_eq!((summary.blocks, summary.samples.rejected), (10, 0));
    for parameter in &summary.parameters {
        let truth = parameter.truth.expect("simulated");
        let (theta, std) = (parameter.estimate.expect("known"), parameter.std.expect("known"));
        // Stiction, which the model leaves out, is there for a handful of samples only; seven
        // deviations leave room for it.
        assert!((theta - truth).abs() < 7.0 * std, "{parameter:?}");
        assert!(std < 0.02 * truth.abs(), "{parameter:?}");
    }
}

#[test]
fn e2e_in_lockstep_no_estimate_is_lost_even_of_the_shortest_blocks() {
    let site = Site::new();
    site.start_run(&["--duration", "10", "--set", "estimator.block_len=2"])
        .expect_code(0);
    let summary = site.summary();
    assert_eq!((summary.blocks, summary.samples.accepted), (5_000, 10_000));
    let blocks = column(&site.out().join("estimates.csv"), "block");
    assert_eq!(blocks, (1..=5_000).map(f64::from).collect::<Vec<_>>());
}

#[test]
fn e2e_samples_that_the_simulation_loses_are_no_loss_of_the_run() {
    let site = Site::new();
    let losses = "plant.sensors.loss_probability=0.01";
    let mut run = site.start_run(&["--duration", "12", "--set", losses]);
    run.expect_code(0);
    let samples = site.summary().samples;
    assert_eq!(samples.accepted + samples.missing, 12_000);
    // 120 ± 11
    assert!((65..175).contains(&samples.missing), "{}", samples.missing);
}

#[test]
fn e2e_the_same_seed_gives_the_same_estimates_bit_for_bit() {
    let sites = [Site::new(), Site::new()];
    let files = sites.each_ref().map(|site| {
        let args = ["--duration", "10", "--seed", "7", "--set", "plant.setpoint.kind=random"];
        site.start_run(&[&args[..], &QUICK].concat()).expect_code(0);
        std::fs::read_to_string(site.out().join("estimates.csv")).expect("estimates.csv")
    });
    assert_eq!(files[0].lines().count(), 51);
    assert_eq!(files[0], files[1]);
}

#[test]
fn e2e_interrupting_the_job_or_the_launcher_still_writes_table_and_files() {
    for (signal, whole_job) in [
        (Signal::SIGINT, true),
        (Signal::SIGINT, false),
        (Signal::SIGTERM, false),
    ] {
        let site = Site::new();
        let mut observer = site.observer();
        let mut run = site.start_run(&[&["--speed", "1"], &QUICK[..]].concat());
        observer.estimate("a third block", |estimate| estimate.block >= 3);
        if whole_job {
            run.signal_group(signal);
        } else {
            run.signal(signal);
        }
        run.expect_code(0);
        assert!(run.stdout().contains("theta_9"), "{}", run.said());
        assert!(run.stdout().trim_end().ends_with("report.html"), "{}", run.said());
        let summary = site.summary();
        assert!(summary.blocks >= 3, "{summary:?}");
        // The plant's END came first, so all that was sent was also taken in.
        assert_eq!(summary.samples.missing, 0, "{summary:?}");
        assert!(column(&site.out().join("estimates.csv"), "block").len() >= 3);
        drop(observer);
        assert_eq!(site.processes(), Vec::<u32>::new());
        assert_eq!(site.shared_memory(), Vec::<String>::new());
    }
}

#[test]
fn e2e_an_interrupt_before_the_first_sample_ends_the_run_too() {
    let site = Site::new();
    let mut run = site.start_run(&[]);
    eventually("the directory exists", || {
        site.out().join("config.toml").exists().then_some(())
    });
    run.signal(Signal::SIGINT);
    let status = run.wait();
    // Too early for a result is a failure that says so; late enough, it is none.
    assert!(matches!(status.code(), Some(0 | 1)), "{status:?}\n{}", run.said());
    assert_eq!(site.processes(), Vec::<u32>::new());
}

#[test]
fn fault_a_launcher_killed_with_9_leaves_no_process_behind_and_nothing_in_the_way() {
    let site = Site::new();
    let mut observer = site.observer();
    let mut run = site.start_run(&[&["--speed", "1"], &QUICK[..]].concat());
    observer.estimate("a first block", |_| true);
    assert_eq!(site.processes().len(), 4);
    run.signal(Signal::SIGKILL);
    run.wait();
    eventually("the children have ended", || site.processes().is_empty().then_some(()));
    drop(observer);
    // The next run needs no cleaning up.
    std::fs::remove_dir_all(site.out()).expect("results");
    site.start_run(&["--duration", "2", QUICK[0], QUICK[1]]).expect_code(0);
    assert_eq!(site.summary().samples.accepted, 2_000);
}

#[test]
fn fault_a_child_that_dies_fails_the_run_loudly_and_ends_the_others() {
    for role in ["plant", "identifier", "monitor"] {
        let site = Site::new();
        let mut observer = site.observer();
        let mut run = site.start_run(&[&["--speed", "1"], &QUICK[..]].concat());
        observer.estimate("a first block", |_| true);
        let child = site.child(&run, role);
        kill(child, Signal::SIGKILL).expect("it lives");
        run.expect_code(1);
        run.expect_stderr(&[&format!(
            "the {role}, process {child}, was killed by signal 9 (SIGKILL)"
        )]);
        drop(observer);
        assert_eq!(site.processes(), Vec::<u32>::new(), "{role}");
        assert_eq!(site.shared_memory(), Vec::<String>::new(), "{role}");
    }
}

#[test]
fn fault_results_are_never_written_over() {
    let site = Site::new();
    std::fs::create_dir(site.out()).expect("create");
    std::fs::write(site.out().join("precious"), "data").expect("write");
    let mut run = site.start_run(&["--duration", "1"]);
    run.expect_code(2);
    run.expect_stderr(&["expected an empty or a new one", "--out"]);
    assert_eq!(std::fs::read_dir(site.out()).expect("directory").count(), 1);
}

#[test]
fn e2e_without_a_directory_the_results_go_to_one_named_by_the_time() {
    let site = Site::new();
    let mut run = site.start(Program::Thetabus, &[&["run", "--duration", "1"], &QUICK[..]].concat());
    run.expect_code(0);
    let stdout = run.stdout();
    let named = stdout
        .lines()
        .find_map(|line| line.strip_prefix("results in "))
        .expect("the directory");
    assert!(named.starts_with("thetabus-out/"), "{named}");
    assert!(site.dir.path().join(named).join("summary.json").exists());
    let page = format!("{named}/report.html");
    assert_eq!(stdout.lines().last(), Some(format!("open {page}").as_str()));
    assert!(site.dir.path().join(page).exists());
}

#[test]
fn e2e_the_table_as_json_is_the_summary_and_nothing_else() {
    let site = Site::new();
    let args = ["--duration", "1", "--no-record", "--format", "json"];
    let mut run = site.start_run(&[&args[..], &QUICK].concat());
    run.expect_code(0);
    let printed: serde_json::Value = serde_json::from_str(&run.stdout()).expect("JSON");
    let written = std::fs::read_to_string(site.out().join("summary.json")).expect("summary.json");
    assert_eq!(
        printed,
        serde_json::from_str::<serde_json::Value>(&written).expect("JSON")
    );
    run.expect_stderr(&["results in"]);
}

#[test]
fn rt_speed_1_holds_1_khz_and_the_processes_need_a_fraction_of_a_core() {
    let site = Site::new();
    let run = site.start_run(&[&["--speed", "1", "--duration", "8"], &QUICK[..]].concat());
    let bus = Bus::join(&site.domain, "arm", "observer").expect("join");
    let mut samples = SampleSubscriber::new(&bus).expect("subscribe");
    let pids = ["plant", "identifier", "monitor"].map(|role| site.child(&run, role));
    let cpu = |pids: &[Pid]| pids.iter().map(|&pid| cpu_time(pid)).sum::<Duration>();

    let (mut times, start, used) = (Vec::new(), Instant::now(), cpu(&pids));
    while times.len() < 6_000 && start.elapsed() < Duration::from_secs(20) {
        samples.refresh().expect("refresh");
        samples
            .drain_timed(usize::MAX, |sample, sent_ns| {
                times.push((sample.seq as f64, sent_ns as f64))
            })
            .expect("drain");
        thread::sleep(Duration::from_millis(20));
    }
    let (wall, used) = (start.elapsed(), cpu(&pids) - used);

    // The slope of the line through (seq, time of sending): a single late sample does not move it.
    assert!(times.len() >= 6_000, "{} samples", times.len());
    let n = times.len() as f64;
    let (mean_seq, mean_ns) = times
        .iter()
        .fold((0.0, 0.0), |(x, y), &(seq, ns)| (x + seq / n, y + ns / n));
    let (xx, xy) = times.iter().fold((0.0, 0.0), |(xx, xy), &(seq, ns)| {
        (xx + (seq - mean_seq).powi(2), xy + (seq - mean_seq) * (ns - mean_ns))
    });
    let period_ns = xy / xx;
    println!(
        "mean period {period_ns:.1} ns, {:.1} % of a core",
        100.0 * used.as_secs_f64() / wall.as_secs_f64()
    );
    assert!((period_ns / 1e6 - 1.0).abs() < 1e-3, "mean period {period_ns} ns");
    assert!(used.as_secs_f64() < 0.2 * wall.as_secs_f64(), "{used:?} of {wall:?}");
}
