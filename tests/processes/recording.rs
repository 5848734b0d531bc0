//! Runs kept as files: recorded, identified again, replayed, reported.

use crate::support::{ENCODERS, Program, QUICK, Site, eventually, text};
use nix::sys::signal::{Signal, kill};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use thetabus::messages::Sample;
use thetabus::recording::{Entry, Loss, RecordingReader, Span};

/// All samples of a recording as bits, without the `stream_id`.
fn samples(recording: &Path) -> (Vec<Vec<u64>>, Loss) {
    let bits = |s: &Sample| {
        let arrays = [s.q, s.dq, s.ddq, s.dddq, s.setpoint, s.input];
        let head = [
            s.seq,
            s.t_ns,
            u64::from(s.flags),
            u64::from(s.joints),
            u64::from(s.signals),
        ];
        head.into_iter()
            .chain(arrays.into_iter().flatten().map(f64::to_bits))
            .collect()
    };
    let mut reader = RecordingReader::open(recording, Span::default()).expect("a recording");
    let mut all = Vec::new();
    while let Some(entry) = reader.next_entry().expect("readable") {
        if let Entry::Sample { sample, .. } = entry {
            all.push(bits(sample));
        }
    }
    (all, reader.loss())
}

/// Identifies off line; the text of the estimates.csv that this gives.
fn identify(site: &Site, recording: &Path, name: &str, code: i32) -> String {
    let out = site.dir.path().join(name);
    let mut identify = site.start(Program::Thetabus, &["identify", text(recording), "--out", text(&out)]);
    identify.expect_code(code);
    assert!(identify.stdout().contains("theta_9"), "{}", identify.said());
    fs::read_to_string(out.join("estimates.csv")).expect("estimates.csv")
}

#[test]
fn replay_live_off_line_and_replayed_estimates_of_the_papers_experiment_are_the_same_to_the_bit() {
    let site = Site::new();
    site.start_run(&[]).expect_code(0);
    let recording = site.out().join("recording.mcap");
    // Every number in the file is written with all its digits, so equal text is equal bits.
    let live = fs::read_to_string(site.out().join("estimates.csv")).expect("estimates.csv");
    assert_eq!(live.lines().count(), 90);
    assert_eq!(identify(&site, &recording, "offline", 0), live);

    let config = site.out().join("config.toml");
    let out = site.dir.path().join("replayed");
    let monitor = site.start(Program::Monitor, &["--config", text(&config), "--out", text(&out)]);
    monitor.wait_for_log("monitor");
    let _identifier = site.start(Program::Identifier, &["--config", text(&config)]);
    // The run waited for its recorder, too; the replay is started as docs/recording.md has it, and
    // nobody records.
    let mut replay = site.start(Program::Thetabus, &["replay", text(&site.out())]);
    replay.expect_code(0);
    assert!(replay.stdout().contains("170000 samples replayed"), "{}", replay.said());
    eventually("the replayed estimates are those of the run", || {
        let replayed = fs::read_to_string(out.join("estimates.csv")).ok()?;
        (replayed.lines().count() == 90).then(|| assert_eq!(replayed, live))
    });
}

#[test]
fn replay_encoder_only_off_line_and_from_its_export_gives_the_same_estimates_to_the_bit() {
    let site = Site::new();
    // The payload jumps within the third block, so that the detector's work is compared, too.
    let jump = ["--set", "plant.mass_2.t_s=[0.0, 5.0]", "--duration", "15"];
    site.start_run(&[&[ENCODERS], &jump[..]].concat()).expect_code(0);
    let recording = site.out().join("recording.mcap");
    let live = fs::read_to_string(site.out().join("estimates.csv")).expect("estimates.csv");
    assert_eq!(live.lines().count(), 8);
    assert!(live.lines().any(|line| line.split(',').nth(3) == Some("1")), "{live}");
    assert_eq!(identify(&site, &recording, "offline", 0), live);

    let samples = site.dir.path().join("samples.csv");
    let export = ["export", text(&recording), "--out", text(&samples)];
    let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    assert!(command.args(export).status().expect("it runs").success());
    let head = fs::read_to_string(&samples).expect("samples.csv");
    assert!(head.starts_with("seq,t_ns,flags,signals,q_1_rad,"), "{}", &head[..200]);
    let out = site.dir.path().join("exported");
    let config = site.out().join("config.toml");
    let exported = [
        "identify",
        text(&samples),
        "--config",
        text(&config),
        "--out",
        text(&out),
    ];
    site.start(Program::Thetabus, &exported).expect_code(0);
    let exported = fs::read_to_string(out.join("estimates.csv")).expect("estimates.csv");
    assert_eq!(exported, live);

    // A file of somebody's work is not written over.
    let mut again = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    let output = again.args(export).output().expect("it runs");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("not written over"));
}

#[test]
fn replay_a_part_of_a_recording_is_cut_into_the_same_blocks() {
    let site = Site::new();
    site.start_run(&[&["--duration", "5"], &QUICK[..]].concat())
        .expect_code(0);
    let recording = site.out().join("recording.mcap");
    let out = site.dir.path().join("part");
    let span = ["--from", "1.1", "--to", "2.999"];
    let mut identify = site.start(
        Program::Thetabus,
        &[&["identify", text(&recording), "--out", text(&out)], &span[..]].concat(),
    );
    identify.expect_code(0);
    // 1.1 s lie inside the sixth block of 200 samples, which is skipped; 2.999 s end the fifteenth.
    let csv = fs::read_to_string(out.join("estimates.csv")).expect("estimates.csv");
    let blocks: Vec<&str> = csv.lines().skip(1).filter_map(|line| line.split(',').next()).collect();
    assert_eq!(blocks, ["7", "8", "9", "10", "11", "12", "13", "14", "15"]);
}

#[test]
fn fault_a_part_without_samples_is_refused_and_leaves_nothing_behind() {
    let site = Site::new();
    site.start_run(&[&["--duration", "2"], &QUICK[..]].concat())
        .expect_code(0);
    let results = site.out();
    let out = site.dir.path().join("nothing");
    // Each tool takes the directory for the recording inside.
    for (command, own) in [
        ("identify", &["--out", text(&out)][..]),
        ("report", &["--out", text(&out)]),
        ("export", &["--out", text(&out)]),
        ("replay", &[]),
    ] {
        for (span, part) in [
            (["--from", "100"], "holds no samples from 100 s on"),
            (
                ["--from", "-1"],
                "--from: expected seconds of stream time, 0 or more, got -1",
            ),
        ] {
            let mut program = Command::new(env!("CARGO_BIN_EXE_thetabus"));
            let output = program.args([command, text(&results)]).args(span).args(own).output();
            let output = output.expect("it runs");
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{command}: {said}");
            assert!(said.contains(part), "{command}: {said}");
            assert!(!out.exists(), "{command}");
        }
    }
}

#[test]
fn fault_samples_without_the_signals_that_rows_need_are_told_as_the_reason() {
    let site = Site::new();
    site.start_run(&[ENCODERS, "--duration", "3"]).expect_code(0);
    // Rows from single samples need derivatives, and encoders give none.
    let mut identify = site.start(
        Program::Thetabus,
        &["identify", text(&site.out()), "--set", "identifier.rows=pointwise"],
    );
    // Nothing of it was used: no success.
    identify.expect_code(3);
    identify.expect_stderr(&[
        "3000 of 3000 samples were rejected",
        "3000 lack a signal that is needed",
        "the sample lacks dq, ddq, dddq and has q, setpoint, input",
        "identifier.rows = \"projected\" does without",
    ]);
}

#[test]
fn replay_two_runs_with_one_seed_record_the_same_samples_to_the_bit() {
    let (one, two) = (Site::new(), Site::new());
    let args = [&["--duration", "5", "--seed", "7"], &QUICK[..]].concat();
    let recordings = [one, two].map(|site| {
        site.start_run(&args).expect_code(0);
        let (samples, loss) = samples(&site.out().join("recording.mcap"));
        assert!(loss.is_none(), "{loss}");
        samples
    });
    assert_eq!(recordings[0].len(), 5_000);
    assert!(recordings[0] == recordings[1], "the samples differ");
}

#[test]
fn fault_of_a_recorder_killed_with_9_what_was_flushed_is_identified_with_exit_code_3() {
    let site = Site::new();
    let recording = site.dir.path().join("killed.mcap");
    let monitor = site.start(
        Program::Monitor,
        &[&["--record", text(&recording)], &QUICK[..]].concat(),
    );
    monitor.wait_for_log("monitor");
    let _identifier = site.start(Program::Identifier, &QUICK);
    let _plant = site.start(
        Program::Plant,
        &[&["--speed", "4", "--duration", "60"], &QUICK[..]].concat(),
    );
    // A flush a second writes near 4000 samples of 260 bytes.
    let size = || fs::metadata(&recording).map_or(0, |file| file.len());
    eventually("some seconds have been recorded", || (size() > 2_000_000).then_some(()));
    kill(nix::unistd::Pid::from_raw(monitor.pid().cast_signed()), Signal::SIGKILL).expect("it lives");
    drop(monitor);

    let (recovered, loss) = samples(&recording);
    assert!(recovered.len() > 4_000, "{} samples", recovered.len());
    assert_eq!(loss.unfinished_files, 1, "{loss}");
    let seqs: Vec<u64> = recovered.iter().map(|sample| sample[0]).collect();
    assert!(seqs.windows(2).all(|pair| pair[1] == pair[0] + 1), "a hole");

    let out = site.dir.path().join("out");
    let args = ["identify", text(&recording), "--out", text(&out)];
    let mut identify = site.start(Program::Thetabus, &args);
    identify.expect_code(3);
    identify.expect_stderr(&["the recording is not complete", "not finished by the recorder"]);
    let csv = fs::read_to_string(out.join("estimates.csv")).expect("estimates.csv");
    assert!(csv.lines().count() > 20, "{csv}");
}

#[test]
fn fault_a_stopped_recorder_loses_samples_and_says_so() {
    let site = Site::new();
    let recording = site.dir.path().join("slow.mcap");
    let args = [&["--record", text(&recording)], &QUICK[..]].concat();
    let mut monitor = site.start(Program::Monitor, &args);
    monitor.wait_for_log("monitor");
    let _identifier = site.start(Program::Identifier, &QUICK);
    let mut plant = site.start(
        Program::Plant,
        &[&["--speed", "10", "--duration", "20"], &QUICK[..]].concat(),
    );
    let size = || fs::metadata(&recording).map_or(0, |file| file.len());
    eventually("something has been recorded", || (size() > 200_000).then_some(()));
    // More than its queue of 4096 holds; the plant must not notice.
    monitor.signal(Signal::SIGSTOP);
    plant.expect_code(0);
    monitor.signal(Signal::SIGCONT);
    monitor.wait_for_log("the recorder cannot keep up");
    site.observer()
        .status("the identifier says so, too", |s| s.process.recorder_missing > 1_000);
    monitor.signal(Signal::SIGTERM);
    monitor.expect_code(3);
    let (recorded, loss) = samples(&recording);
    assert!(loss.samples_not_recorded > 1_000, "{loss}");
    let first = recorded[0][0];
    assert_eq!(recorded.len() as u64 + loss.samples_not_recorded, 20_000 - first);
}

#[test]
fn fault_what_is_no_recording_is_a_wrong_use() {
    let site = Site::new();
    let file = site.dir.path().join("no.mcap");
    fs::write(&file, "seq,t_ns\n").expect("write");
    for command in ["identify", "replay"] {
        let mut program = site.start(Program::Thetabus, &[command, text(&file)]);
        program.expect_code(2);
        program.expect_stderr(&["no.mcap is not a recording of thetabus"]);
    }
    let missing = site.dir.path().join("missing.mcap");
    site.start(Program::Thetabus, &["identify", text(&missing)])
        .expect_code(2);
}

/// The report as a browser sees it, without any network; `None` where there is no browser and none
/// is required.
///
/// Each start has a profile of its own, because two browsers with one profile share a process and
/// the later one then prints nothing. A browser that ends without a page is started again: beside
/// the other tests its own processes may be too late for each other.
fn dom(site: &Site, page: &Path) -> Option<String> {
    let mut last = String::new();
    for attempt in 0..3 {
        let profile = site.dir.path().join(format!("browser{attempt}"));
        let arguments = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            // Whatever the page would load from elsewhere fails.
            "--host-resolver-rules=MAP * ~NOTFOUND",
            "--dump-dom",
        ];
        let found = ["chromium", "chromium-browser", "google-chrome"]
            .into_iter()
            .find_map(|browser| {
                Command::new(browser)
                    .args(arguments)
                    .arg(format!("--user-data-dir={}", profile.display()))
                    .arg(format!("file://{}", page.display()))
                    .output()
                    .ok()
            });
        let Some(output) = found else {
            assert!(
                std::env::var("THETABUS_REQUIRE_PEERS").as_deref() != Ok("1"),
                "there is no chromium to open the report"
            );
            eprintln!("skipped: there is no chromium to open the report");
            return None;
        };
        if output.status.success() && !output.stdout.is_empty() {
            return Some(String::from_utf8_lossy(&output.stdout).into_owned());
        }
        last = format!("{}: {}", output.status, String::from_utf8_lossy(&output.stderr));
    }
    panic!("the browser shows no page, three times: {last:.3000}");
}

#[test]
fn e2e_the_report_of_a_run_opens_in_a_browser_with_every_figure_inside() {
    let site = Site::new();
    site.start_run(&[&["--duration", "20"], &QUICK[..]].concat())
        .expect_code(0);
    let page = site.out().join("report.html");
    let html = fs::read_to_string(&page).expect("report.html");
    for foreign in ["src=\"http", "href=\"http", "url(http", "@import", "<script", "<link"] {
        assert!(!html.contains(foreign), "the page must load nothing: {foreign}");
    }
    // Setpoints, nine parameters, four derived values, accuracy, inputs, residuals, excitation,
    // timing.
    let expected: usize = 1 + 9 + 4 + 5;
    // Signals are exact, and the machine does not change: each joint's input was known before it
    // was learnt from, to some thousandths.
    let captions = html
        .split("(root mean squares): ")
        .nth(1)
        .expect("the caption of the inputs");
    let shares = captions.split("joint ").skip(1).take(2);
    let shares: Vec<f64> = shares
        .filter_map(|text| text.split([' ', '%']).nth(1)?.parse().ok())
        .collect();
    assert!(
        shares.len() == 2 && shares.iter().all(|share| *share < 1.0),
        "{captions:.60}"
    );
    assert_eq!(html.matches("<figure ").count(), expected);
    let figures: Vec<PathBuf> = fs::read_dir(site.out().join("figures"))
        .expect("figures")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    let forms = if cfg!(feature = "png") { 2 } else { 1 };
    assert_eq!(figures.len(), forms * expected);
    for figure in figures {
        let bytes = fs::read(&figure).expect("a figure");
        let is_png = figure.extension().is_some_and(|e| e == "png");
        let magic: &[u8] = if is_png { b"\x89PNG" } else { b"<svg" };
        assert!(bytes.starts_with(magic) && bytes.len() > 2_000, "{}", figure.display());
    }

    if let Some(dom) = dom(&site, &page) {
        assert_eq!(dom.matches("<svg ").count(), expected, "{}", dom.len());
        assert!(dom.contains("Identification of the parameter θ₉"));
        assert!(dom.contains("samples accepted"));
    }

    // The same again from the recording alone, with the table as JSON.
    let out = site.dir.path().join("again");
    let recording = site.out().join("recording.mcap");
    let args = ["report", text(&recording), "--out", text(&out), "--format", "json"];
    let mut report = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    let output = report.args(args).output().expect("it runs");
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let table: thetabus::report::Summary = serde_json::from_slice(&output.stdout).expect("a summary");
    assert_eq!(table.parameters, site.summary().parameters);
    assert!(out.join("report.html").exists());
}

#[test]
fn fault_a_result_that_a_full_standard_output_loses_is_a_failure() {
    let site = Site::new();
    site.start_run(&[&["--duration", "2"], &QUICK[..]].concat())
        .expect_code(0);
    let results = site.out();
    let out = site.dir.path().join("again");
    for args in [
        &["identify", text(&results), "--out", text(&out)][..],
        &["report", text(&results)],
        &["export", text(&results)],
        &["config", "check", ENCODERS],
        &["completions", "bash"],
        &["man"],
    ] {
        let full = fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .expect("the device");
        let mut program = Command::new(env!("CARGO_BIN_EXE_thetabus"));
        let output = program.args(args).stdout(full).output().expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {said}");
        assert!(
            said.contains("standard output") && said.contains("No space left"),
            "{args:?}: {said}"
        );
    }
    // What goes into files does not depend on it.
    assert!(out.join("summary.json").exists() && out.join("report.html").exists());
}

#[test]
fn e2e_a_run_and_its_recording_need_no_table_of_setpoints_beside_them() {
    let site = Site::new();
    let beside = site.dir.path().join("experiment");
    fs::create_dir(&beside).expect("a directory");
    let rows: String = (0..40)
        .map(|k| {
            format!(
                "{},{},{}\n",
                0.05 * f64::from(k),
                0.2 * f64::from(k % 3),
                -0.1 * f64::from(k % 5)
            )
        })
        .collect();
    fs::write(beside.join("moves.csv"), format!("t_s,q1_rad,q2_rad\n{rows}")).expect("setpoints");
    let toml = "plant.setpoint = { kind = \"csv\", csv = { path = \"moves.csv\" } }\nplant.duration_s = 2.0\n";
    fs::write(beside.join("moves.toml"), toml).expect("a configuration");
    // A relative path on the command line, and a relative path in the file.
    let run = ["run", "experiment/moves.toml", "--out", "results"];
    site.start(Program::Thetabus, &[&run[..], &QUICK].concat())
        .expect_code(0);
    let results = site.dir.path().join("results");
    let live = fs::read_to_string(results.join("estimates.csv")).expect("estimates.csv");
    assert!(live.lines().count() > 5, "{live}");
    fs::remove_dir_all(&beside).expect("removed");
    assert_eq!(identify(&site, &results.join("recording.mcap"), "offline", 0), live);
    let config = results.join("config.toml");
    let mut check = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    let checked = check
        .args(["config", "check", text(&config)])
        .output()
        .expect("it runs");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}

#[test]
fn e2e_a_monitor_started_again_keeps_to_record_files_and_joins_what_is_left() {
    let site = Site::new();
    let recording = site.dir.path().join("run.mcap");
    let args = [
        "--record",
        text(&recording),
        "--set",
        "monitor.record_file_mib=1",
        "--set",
        "monitor.record_files=2",
    ];
    let files = || -> Vec<String> {
        let names = fs::read_dir(site.dir.path()).expect("a directory").flatten();
        let names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
        let mut names: Vec<String> = names.filter(|name| name.starts_with("run")).collect();
        names.sort();
        names
    };
    let monitor = site.start(Program::Monitor, &[&args[..], &QUICK].concat());
    monitor.wait_for_log("monitor");
    let _identifier = site.start(Program::Identifier, &QUICK);
    let _plant = site.start(
        Program::Plant,
        &[&["--speed", "10", "--duration", "200"], &QUICK[..]].concat(),
    );
    eventually("the first file was removed for a later one", || {
        (!recording.exists() && files().len() == 2).then_some(())
    });
    kill(nix::unistd::Pid::from_raw(monitor.pid().cast_signed()), Signal::SIGKILL).expect("it lives");
    drop(monitor);
    let before = files();
    // What a recorder killed while it makes its next file leaves behind.
    let number: u32 = before[1][4..8].parse().expect("a number");
    let next = format!("run_{:04}.mcap", number + 1);
    fs::write(site.dir.path().join(format!("{next}.1.tmp")), "begun").expect("a file");
    let mut monitor = site.start(Program::Monitor, &[&args[..], &["--resume"], &QUICK].concat());
    monitor.wait_for_log("monitor");
    eventually("as many files as may be kept, and nothing of a killed recorder", || {
        let now = files();
        let whole = now.iter().all(|name| name.ends_with(".mcap"));
        (whole && now.len() == 2 && !now.contains(&before[0]) && now[1] >= next).then_some(())
    });
    // Enough of it on the disk that both sides of the border between two files have samples.
    eventually("the newest file has samples", || {
        let newest = site.dir.path().join(files().last()?);
        (fs::metadata(newest).ok()?.len() > 300_000).then_some(())
    });
    monitor.signal(Signal::SIGTERM);
    assert!(matches!(monitor.wait().code(), Some(0 | 3)), "{}", monitor.said());
    // The files that are left are one recording to its readers.
    let seqs = |path: &Path| -> Vec<u64> { samples(path).0.iter().map(|sample| sample[0]).collect() };
    let [oldest, newest] = [0, 1].map(|i| site.dir.path().join(&files()[i]));
    assert_eq!(thetabus::recording::oldest_file(&recording), Some(oldest.clone()));
    let (all, last) = (seqs(&oldest), seqs(&newest));
    assert!(
        !last.is_empty() && all.ends_with(&last),
        "{} and {}",
        all.len(),
        last.len()
    );
    let out = site.dir.path().join("offline");
    let mut identify = site.start(Program::Thetabus, &["identify", text(&recording), "--out", text(&out)]);
    // The recorder that was killed did not finish its file, and what came meanwhile is lost.
    identify.expect_code(3);
}

/// tests/data/recordings/README.md says how the file was made.
#[test]
fn regress_a_recording_from_before_the_form_of_ros_2_is_read_identified_and_reported() {
    let earlier = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recordings/before_ros2.mcap");
    let (taken, loss) = samples(&earlier);
    assert_eq!((taken.len(), loss), (600, Loss::default()));
    assert_eq!((taken[0][0], taken[599][0], taken[599][1]), (0, 599, 599_000_000));
    let mut reader = RecordingReader::open(&earlier, Span::default()).expect("a recording");
    let mut published = Vec::new();
    while let Some(entry) = reader.next_entry().expect("readable") {
        if let Entry::Estimate { estimate, .. } = entry {
            let usable: Vec<usize> = (0..4).filter(|&i| estimate.usable.contains(i)).collect();
            published.push((estimate.block, estimate.theta[0].to_bits(), usable));
        }
    }
    // What the program that made the file wrote into its estimates.csv.
    let mass = [95.11674652644615f64, 95.17148255605422, 95.16051984008318].map(f64::to_bits);
    let usable = [vec![0, 1], vec![0, 1, 2], vec![0, 1, 2]];
    for (k, estimate) in published.iter().enumerate() {
        assert_eq!(*estimate, (k as u64 + 1, mass[k], usable[k].clone()));
    }
    assert_eq!(published.len(), 3);

    let site = Site::new();
    let out = site.dir.path().join("again");
    let mut identify = site.start(Program::Thetabus, &["identify", text(&earlier), "--out", text(&out)]);
    identify.expect_code(0);
    assert!(identify.stdout().contains("viscous_friction"), "{}", identify.said());
    let csv = fs::read_to_string(out.join("estimates.csv")).expect("estimates.csv");
    assert_eq!(csv.lines().count(), 4);
    let report = site.dir.path().join("report");
    let mut command = Command::new(env!("CARGO_BIN_EXE_thetabus"));
    command.args(["report", text(&earlier), "--out", text(&report)]);
    let output = command.output().expect("the program starts");
    assert!(
        output.status.success() && report.join("report.html").exists(),
        "{output:?}"
    );
}
