//! Robots drawn at random: machines that were once wrong, and the page of all of them.

use thetabus::studies::for_each_index;
use thetabus::studies::robots::{RandomRobotCase, random_robot_trial, random_robots_document};
use thetabus::studies::trials::TrialResult;

fn runs(case: RandomRobotCase, seeds: &[u64]) -> Vec<TrialResult> {
    for_each_index(seeds.len(), |i| random_robot_trial(case, seeds[i]).unwrap())
}

/// Without the allowance for them, each of these robots has dangerous blocks: drag makes viscous
/// friction wrong, and a spring the moments of the links.
#[test]
fn fault_drag_and_springs_that_the_model_leaves_out_make_nothing_surely_wrong() {
    for (case, seeds) in [
        (RandomRobotCase::Drag, [15, 17, 27]),
        (RandomRobotCase::Spring, [9, 17, 20]),
    ] {
        for (seed, run) in seeds.iter().zip(runs(case, &seeds)) {
            assert_eq!((run.dangerous, run.blocks), (0, 75), "{case:?} {seed}: {:?}", run.worst);
        }
    }
}

/// Base parameters of these robots contain others with factors of up to 1477. If their priors allow
/// only for the parameter that they are named after, the first robot has 62 dangerous blocks, and
/// the second one 64.
#[test]
fn prop_priors_allow_for_all_that_a_base_parameter_is_made_of() {
    for (case, seed) in [(RandomRobotCase::Loss, 47), (RandomRobotCase::Counts, 48)] {
        let run = &runs(case, &[seed])[0];
        assert_eq!((run.dangerous, run.blocks), (0, 75), "{case:?} {seed}: {:?}", run.worst);
        assert!(run.use_ok > 10, "{case:?} {seed}: {} of 75 blocks usable", run.use_ok);
    }
}

#[test]
fn prop_the_page_has_a_row_for_each_case_and_their_sum() {
    let results: Vec<Vec<TrialResult>> = RandomRobotCase::ALL
        .iter()
        .enumerate()
        .map(|(i, _)| {
            let run = TrialResult {
                blocks: 75,
                use_ok: 40,
                dangerous: u64::from(i == 2),
                ..TrialResult::default()
            };
            vec![run.clone(), run]
        })
        .collect();
    let page = random_robots_document(&results).markdown("made");
    let rows: Vec<&str> = page
        .lines()
        .filter(|line| line.contains(" of ") && line.starts_with('|'))
        .collect();
    assert_eq!(rows.len(), 1 + RandomRobotCase::ALL.len() + 1, "{page}");
    assert!(
        rows[3].contains("| payload") && rows[3].contains(" 2 of 80 "),
        "{}",
        rows[3]
    );
    assert!(
        rows[18].contains("**all**") && rows[18].contains(" 2 of 1360 "),
        "{}",
        rows[18]
    );
}
