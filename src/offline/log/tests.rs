//! Reading of logs, and errors in logs.

use super::*;
use crate::messages::signals;

fn columns(time: bool) -> LogColumns {
    LogColumns {
        time: time.then(|| "t".to_owned()),
        time_unit_s: 1e-3,
        positions: vec!["x".to_owned()],
        position_units: vec![1e-3],
        inputs: vec!["u".to_owned()],
        input_unit: 2.0,
        setpoints: Vec::new(),
    }
}

fn read(text: &str, time: bool) -> Result<(Vec<Sample>, LogCounts), LogError> {
    let mut log = LogReader::new(text.as_bytes(), &columns(time), 1, 1e-3)?;
    let mut samples = Vec::new();
    while let Some(sample) = log.next_sample()? {
        samples.push(sample);
    }
    Ok((samples, log.counts()))
}

#[test]
fn val_columns_are_found_by_name_and_brought_to_si_units() {
    let (samples, counts) = read("u, other, x, t\n1.5, a, 2000, 10\n2.5, b, 3000, 11\n", true).unwrap();
    assert_eq!((samples.len(), counts.refused()), (2, 0));
    assert_eq!((samples[0].q[0], samples[0].input[0]), (2.0, 3.0));
    assert_eq!(samples.iter().map(|s| s.seq).collect::<Vec<_>>(), [0, 1]);
    assert_eq!((samples[1].t_ns, samples[1].joints), (1_000_000, 1));
    assert_eq!(samples[1].signals, signals::Q | signals::INPUT);
    assert!(samples[1].is_end() && !samples[0].is_end());
}

#[test]
fn fault_bad_rows_are_counted_with_their_line_and_leave_holes() {
    // (rows between good rows 0..5 and 6..10, in periods; expected counts; seqs; line of the first
    // refused row)
    type Check = fn(&LogCounts) -> u64;
    let cases: [(&str, &str, Check); 6] = [
        ("ragged", "5,1", |c| c.unreadable),
        ("no number", "5,1,x", |c| c.unreadable),
        ("not a number", "5,1,NaN", |c| c.not_finite),
        ("infinite", "5,inf,0", |c| c.not_finite),
        ("duplicated", "4,1,0", |c| c.duplicated),
        ("out of order", "2,1,0", |c| c.out_of_order),
    ];
    for (name, bad, count) in cases {
        let mut text = "t,x,u\n".to_owned();
        (0..5).for_each(|k| text.push_str(&format!("{k},1,0\n")));
        text.push_str(&format!("{bad}\n"));
        (6..11).for_each(|k| text.push_str(&format!("{k},1,0\n")));
        let (samples, counts) = read(&text, true).unwrap();
        assert_eq!(
            samples.iter().map(|s| s.seq).collect::<Vec<_>>(),
            [0, 1, 2, 3, 4, 6, 7, 8, 9, 10],
            "{name}"
        );
        assert_eq!((counts.rows, counts.refused(), count(&counts)), (11, 1, 1), "{name}");
        assert_eq!(counts.first_refused, Some(7), "{name}");
        assert!(counts.to_string().contains("line 7"), "{counts}");
    }
}

#[test]
fn fault_the_end_is_flagged_whatever_follows_it() {
    for tail in ["", "3,1", "3,1,NaN\n", "2,1,0\n", "1,1,0\n1,1,0\n"] {
        let (samples, _) = read(&format!("t,x,u\n0,1,0\n1,1,0\n2,1,0\n{tail}"), true).unwrap();
        assert_eq!(samples.len(), 3, "{tail:?}");
        assert!(samples[2].is_end() && !samples[1].is_end(), "{tail:?}");
    }
}

#[test]
fn fault_a_single_time_stamp_far_ahead_or_far_behind_costs_its_own_row_and_bounded_memory() {
    for (bad_row, bad_time) in [
        (0, 1e12),
        (0, -1e12),
        (1, 1e9),
        (700, 1e9),
        (700, -1e9),
        (1998, 1e9),
        (1999, 1e9),
    ] {
        let mut text = "t,x,u\n".to_owned();
        for k in 0..2000 {
            let t = if k == bad_row { bad_time } else { f64::from(k) };
            text.push_str(&format!("{t},1,0\n"));
        }
        let mut log = LogReader::new(text.as_bytes(), &columns(true), 1, 1e-3).unwrap();
        let mut samples = Vec::new();
        while let Some(sample) = log.next_sample().unwrap() {
            assert!(log.ahead.len() <= LOOK && log.ahead.capacity() <= 2 * LOOK);
            samples.push(sample);
        }
        let counts = log.counts();
        // Nothing follows the very last row that could contradict it: a gap is as likely as a wrong
        // time.
        let refused = u64::from(bad_row != 1999);
        assert_eq!(
            (samples.len() as u64, counts.refused()),
            (2000 - refused, refused),
            "row {bad_row}: {counts}"
        );
        let rates = samples[..1998].windows(2).map(|pair| pair[1].seq - pair[0].seq);
        assert!(rates.max() <= Some(2), "row {bad_row} leaves a hole");
    }
}

#[test]
fn fault_a_log_is_refused_when_most_of_it_is_wherever_that_is_noticed() {
    // A clock set ahead for some rows, and back: all following rows are out of order.
    let mut text = "t,x,u\n".to_owned();
    (0..1000).for_each(|k| text.push_str(&format!("{k},1,0\n")));
    (0..100).for_each(|k| text.push_str(&format!("{},1,0\n", 1_000_000 + k)));
    (1000..4000).for_each(|k| text.push_str(&format!("{k},1,0\n")));
    let error = read(&text, true).err().unwrap();
    assert!(matches!(error, LogError::Unusable { .. }), "{error}");
    assert!(error.to_string().contains("goes back in line 1102"), "{error}");
    // The same if it is less than half.
    let text: String = text.lines().take(1800).map(|line| format!("{line}\n")).collect();
    let (samples, counts) = read(&text, true).unwrap();
    assert_eq!((samples.len(), counts.out_of_order), (1100, 699));
    // A log that is short and bad.
    assert!(read("t,x,u\n0,1,0\nx,1,0\ny,1,0\n", true).is_err());
}

#[test]
fn fault_a_quote_that_is_not_closed_costs_its_own_row() {
    let mut text = "t,x,u\n".to_owned();
    (0..500).for_each(|k| text.push_str(&format!("{k},{}1,0\n", if k == 50 { "\"" } else { "" })));
    let (samples, counts) = read(&text, true).unwrap();
    assert_eq!(
        (samples.len(), counts.unreadable, counts.first_refused),
        (499, 1, Some(52))
    );
}

#[test]
fn fault_the_likely_mistake_is_named() {
    let rows = |row: fn(u64) -> String| -> String { (0..300).map(|k| row(k) + "\n").collect() };
    let cases = [
        (
            "semicolons",
            format!("t;x;u\n{}", rows(|k| format!("{k};1;0"))),
            "semicolons",
        ),
        (
            "semicolons below",
            format!("t,x,u\n{}", rows(|k| format!("{k};1;0"))),
            "semicolons",
        ),
        (
            "dates",
            format!(
                "t,x,u\n{}",
                rows(|k| format!("2026-11-21T08:15:{:02}.{k:03},1,0", k / 1000))
            ),
            "date or time",
        ),
        (
            "decimal commas",
            format!("t,x,u\n{}", rows(|k| format!("\"{k},5\",\"1,5\",0"))),
            "decimal point",
        ),
        (
            "seconds",
            format!("t,x,u\n{}", rows(|k| format!("{},1,0", k as f64 * 1e-3))),
            "log.time_unit = \"s\"",
        ),
        (
            "nanoseconds",
            format!("t,x,u\n{}", rows(|k| format!("{},1,0", k * 1_000_000))),
            "log.time_unit = \"ns\"",
        ),
        (
            "another period",
            format!("t,x,u\n{}", rows(|k| format!("{},1,0", k * 2))),
            "plant.sample_period_s = 0.002",
        ),
        (
            "newest first",
            format!("t,x,u\n{}", rows(|k| format!("{},1,0", 300 - k))),
            "\"t\" runs backwards: 199 of the first 199 rows",
        ),
        ("another language", "a\u{ff},b\n".to_owned(), "\"a\u{ff}\", \"b\""),
    ];
    for (what, text, words) in cases {
        let error = read(&text, true).err().unwrap().to_string();
        assert!(error.contains(words), "{what}: {error}");
    }
    let wide: String = (0..1000).map(|k| format!("column_{k}_{},", "x".repeat(50))).collect();
    let error = read(&format!("{wide}\n"), true).err().unwrap().to_string();
    assert!(error.len() < 2000 && error.contains("971 more"), "{error}");
}

#[test]
fn prop_time_stamps_come_through_to_the_nanosecond_with_rate_and_spread() {
    // Rows of 0.8 and 1.2 ms in turn, and seconds since 1970 with all their digits.
    let mut text = "t,x,u\n".to_owned();
    let mut expected = Vec::new();
    let mut t_us = 0_u64;
    for k in 0..1000_u64 {
        text.push_str(&format!("17953056{:08}.{:03},1,0\n", t_us / 1000, t_us % 1000));
        expected.push(t_us * 1000);
        t_us += if k % 2 == 0 { 800 } else { 1200 };
    }
    let mut log = LogReader::new(text.as_bytes(), &columns(true), 1, 1e-3).unwrap();
    let mut times = Vec::new();
    while let Some(sample) = log.next_sample().unwrap() {
        times.push(sample.t_ns);
    }
    assert_eq!(times, expected);
    let steps = log.profile().steps;
    assert!(
        (steps.mean_s - 1e-3).abs() < 1e-6 && (steps.std_s() - 2e-4).abs() < 1e-6,
        "{steps:?}"
    );
    let told = log.profile().to_string();
    assert!(told.contains("1000 rows") && told.contains("0.8 to 1.2 ms"), "{told}");
}

#[test]
fn fault_irregular_times_are_used_and_counted_and_another_period_is_refused() {
    let (samples, counts) = read("t,x,u\n0,1,0\n1.1,1,0\n2.4,1,0\n3,1,0\n", true).unwrap();
    assert_eq!(
        (samples.len(), counts.irregular, counts.first_irregular),
        (4, 1, Some(4))
    );
    let error = read("t,x,u\n0,1,0\n2,1,0\n4,1,0\n", true).err().unwrap().to_string();
    assert!(
        error.contains("0.002 s apart") && error.contains("plant.sample_period_s"),
        "{error}"
    );
}

/// Steps of 0.7 and 1.3 ms, and stamps 0.4 ms off at random, of samples every ms; then samples
/// every 1.02 ms of which one in twenty is lost.
#[test]
fn prop_the_average_period_is_that_of_the_machine_whatever_the_stamps() {
    let random = |k: u64| (k.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f64 / (1u64 << 24) as f64 - 0.5;
    let log = |t_ms: &dyn Fn(u64) -> f64, lost: u64| {
        let rows = (0..4_000u64).filter(|k| k % lost != lost - 1);
        rows.fold("t,x,u\n".to_owned(), |text, k| format!("{text}{:.4},1,0\n", t_ms(k)))
    };
    let mean = |text: &str| read(text, true).unwrap().1.other_period_ns();
    assert_eq!(mean(&log(&|k| k as f64 + 0.3 * (k % 2) as f64, u64::MAX)), None);
    assert_eq!(mean(&log(&|k| k as f64 + 0.8 * random(k), u64::MAX)), None);
    let slow = mean(&log(&|k| 1.02 * k as f64, 20)).expect("2 % off");
    assert!((slow / 1.02e6 - 1.0).abs() < 1e-3, "{slow}");
}

#[test]
fn fault_a_log_that_is_none_is_refused_with_what_is_missing() {
    let error = read("a,b\n1,2\n", true).err().unwrap().to_string();
    assert!(error.contains("log.time") && error.contains("\"a\", \"b\""), "{error}");
    let garbage: String = (0..2000).map(|k| format!("{},\u{1F600}\n", k % 7)).collect();
    let text = format!("t,x,u\n0,1,0\n1,1,0\n{garbage}");
    assert!(read(&text, true).is_err() || read(&text, true).unwrap().0.len() == 2);
    let mut two = columns(true);
    two.positions.push("y".to_owned());
    let error = LogReader::new("t,x,u\n".as_bytes(), &two, 1, 1e-3).err().unwrap();
    assert!(error.to_string().contains("log.q: expected 1"), "{error}");
    assert_eq!(read("t,x,u\n", true).unwrap().0.len(), 0, "an empty log has no samples");
    let error = read("", true).err().unwrap().to_string();
    assert!(error.contains("got an empty file"), "{error}");
}

#[test]
fn val_without_a_time_column_rows_follow_at_the_period_and_bad_ones_leave_holes() {
    let (samples, counts) = read("x,u\n1,0\nbad,0\n1,0\n", false).unwrap();
    assert_eq!(samples.iter().map(|s| s.seq).collect::<Vec<_>>(), [0, 2]);
    assert_eq!((counts.unreadable, counts.first_refused), (1, Some(3)));
}

#[test]
fn prop_a_joint_that_nothing_drives_needs_no_column() {
    let passive = LogColumns {
        positions: vec!["x".to_owned(), "y".to_owned()],
        position_units: vec![1.0, 1.0],
        inputs: vec!["u".to_owned(), "0".to_owned()],
        ..columns(false)
    };
    let first = |text: &str| {
        let mut log = LogReader::new(text.as_bytes(), &passive, 2, 1e-3).unwrap();
        let sample = log.next_sample().unwrap().unwrap();
        (sample.input, log.profile().columns.len())
    };
    let (input, columns) = first("x,y,u\n1,2,3\n1,2,3\n");
    assert_eq!((&input[..2], columns), (&[6.0, 0.0][..], 3));
    // unless a column has that name
    let (input, columns) = first("x,y,u,0\n1,2,3,4\n1,2,3,4\n");
    assert_eq!((&input[..2], columns), (&[6.0, 8.0][..], 4));
}
