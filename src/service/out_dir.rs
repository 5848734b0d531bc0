//! The directory of results, which is never overwritten.

use super::Failure;
use super::new_file::whole;
use std::path::{Path, PathBuf};

/// Refuses a directory that is not empty, and anything that is not a directory.
pub(super) fn check(dir: &Path) -> Result<(), Failure> {
    match std::fs::read_dir(dir) {
        Ok(mut entries) => match entries.next() {
            None => Ok(()),
            Some(_) => Err(Failure::Usage(format!(
                "the directory for results, {}: expected an empty or a new one, got one with files; results are never written over: name another by --out or monitor.out_dir, or remove it",
                dir.display()
            ))),
        },
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(Failure::Usage(format!(
            "the directory for results, {}, cannot be used: {e}; name another by --out or monitor.out_dir",
            whole(dir).display()
        ))),
    }
}

/// Creates it.
pub(super) fn create(dir: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(dir).map_err(|e| {
        Failure::Failed(format!(
            "cannot make the directory for results, {}: {e}; name another by --out or monitor.out_dir",
            whole(dir).display()
        ))
    })
}

/// `thetabus-out/<time>` in UTC, with a number appended if that exists.
pub(super) fn default_dir() -> PathBuf {
    let base = Path::new("thetabus-out");
    let now = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(0, |since| since.as_secs());
    let name = utc(now);
    let numbered = (2..).map(|n| base.join(format!("{name}-{n}")));
    std::iter::once(base.join(&name))
        .chain(numbered)
        .find(|dir| !dir.exists())
        .unwrap_or_else(|| base.join(&name))
}

/// `2026-01-02 03:04:05 UTC` of seconds since 1970.
pub(super) fn date(seconds: u64) -> String {
    let digits = utc(seconds);
    let part = |range: std::ops::Range<usize>| digits.get(range).unwrap_or("");
    let date = [part(0..4), part(4..6), part(6..8)].join("-");
    let time = [part(9..11), part(11..13), part(13..15)].join(":");
    format!("{date} {time} UTC")
}

/// `20260102-030405` of seconds since 1970.
fn utc(seconds: u64) -> String {
    let (days, of_day) = (seconds / 86_400, seconds % 86_400);
    // Days since 0000-03-01, in eras of 400 years: the year begins in March, so the leap day is its
    // last.
    let shifted = days + 719_468;
    let (era, of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 {
        month_from_march + 3
    } else {
        month_from_march - 9
    };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    let (hour, minute, second) = (of_day / 3_600, of_day / 60 % 60, of_day % 60);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_times_in_utc() {
        // Known instants: the epoch, a leap day, the day after a leap day in a century that has
        // one, an end of year.
        for (seconds, text) in [
            (0, "19700101-000000"),
            (951_782_400, "20000229-000000"),
            (951_868_800, "20000301-000000"),
            (1_735_689_599, "20241231-235959"),
            (1_795_248_000, "20261121-080000"),
        ] {
            assert_eq!(utc(seconds), text);
            assert_eq!(
                date(seconds).replace(['-', ':'], "").replace(' ', "-"),
                format!("{text}-UTC")
            );
        }
    }

    #[test]
    fn prop_a_directory_with_anything_in_it_is_refused() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        assert!(check(dir.path()).is_ok());
        assert!(check(&dir.path().join("new")).is_ok());
        std::fs::write(dir.path().join("file"), "").expect("write");
        let error = check(dir.path()).expect_err("not empty").to_string();
        assert!(error.contains("expected an empty or a new one"), "{error}");
        assert!(check(&dir.path().join("file")).is_err());
    }
}
