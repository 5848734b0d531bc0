//! Domains never meet, and there is one plant, one identifier, one run in each.

use crate::support::{Program, QUICK, Site};
use nix::sys::signal::Signal;

#[test]
fn e2e_two_domains_side_by_side_never_meet() {
    let sites = [(Site::new(), "4", 4_000), (Site::new(), "6", 6_000)];
    let mut runs = sites
        .each_ref()
        .map(|(site, duration, _)| site.start_run(&[&["--speed", "4", "--duration", duration], &QUICK[..]].concat()));
    for run in &mut runs {
        run.expect_code(0);
    }
    for (site, _, samples) in &sites {
        let summary = site.summary();
        assert_eq!((summary.samples.accepted, summary.samples.missing), (*samples, 0));
        assert_eq!(summary.blocks, samples / 200);
    }
}

#[test]
fn e2e_two_robots_in_one_domain_never_meet() {
    let site = Site::new();
    let outs = ["left", "right"].map(|robot| (robot, site.dir.path().join(robot)));
    let mut runs = outs.each_ref().map(|(robot, out)| {
        let duration = if *robot == "left" { "3" } else { "5" };
        let out = out.to_str().expect("UTF-8");
        site.start(
            Program::Thetabus,
            &[
                &[
                    "run",
                    "--robot",
                    robot,
                    "--out",
                    out,
                    "--speed",
                    "4",
                    "--duration",
                    duration,
                ],
                &QUICK[..],
            ]
            .concat(),
        )
    });
    for (run, accepted) in runs.iter_mut().zip(["3000 samples", "5000 samples"]) {
        run.expect_code(0);
        assert!(run.stdout().contains(accepted), "{}", run.said());
    }
}

#[test]
fn fault_a_second_plant_identifier_or_run_is_refused_with_the_first_ones_pid() {
    let site = Site::new();
    let mut observer = site.observer();
    let run = site.start_run(&[&["--speed", "1"], &QUICK[..]].concat());
    observer.estimate("a first block", |_| true);
    let (plant, identifier) = (
        site.child(&run, "plant").to_string(),
        site.child(&run, "identifier").to_string(),
    );
    for (program, args, pid) in [
        (Program::Plant, &[][..], &plant),
        (Program::Identifier, &[], &identifier),
        (Program::Thetabus, &["run", "--out", "second"], &run.pid().to_string()),
    ] {
        let mut second = site.start(program, args);
        second.expect_code(1);
        second.expect_stderr(&[&format!("process {pid};"), "--domain", site.domain.name()]);
    }
    // The first ones have not noticed.
    let block = observer.last_estimate.expect("seen").block;
    observer.estimate("later blocks", |estimate| estimate.block > block + 1);
    run.signal(Signal::SIGTERM);
}
