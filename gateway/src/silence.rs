//! How long a robot may be silent before its roles in the domain are given back.

use std::fmt;
use std::str::FromStr;
use std::time::{Duration, Instant};

/// How long a robot may be silent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Silence {
    /// For less than this time.
    Limit(Duration),
    /// As long as it likes: its roles are never given back.
    NoLimit,
}

impl Silence {
    /// Whether a robot that was last heard at `heard` has been silent for too long.
    pub fn has_lasted(self, heard: Instant, now: Instant) -> bool {
        match self {
            Self::Limit(limit) => now.duration_since(heard) >= limit,
            Self::NoLimit => false,
        }
    }
}

impl FromStr for Silence {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<u32>() {
            Ok(seconds @ 1..) => Ok(Self::Limit(Duration::from_secs(seconds.into()))),
            _ if text == "never" => Ok(Self::NoLimit),
            _ => Err("expected seconds, a whole number of 1 or more, or `never`".to_owned()),
        }
    }
}

impl fmt::Display for Silence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Limit(limit) => write!(f, "{}", limit.as_secs()),
            Self::NoLimit => f.write_str("never"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_silence_lasts_from_the_last_word_on_and_without_a_limit_never() {
        let (now, limit) = (Instant::now(), Silence::Limit(Duration::from_secs(60)));
        for (after_s, has_lasted) in [(0, false), (59, false), (60, true), (7200, true)] {
            let later = now + Duration::from_secs(after_s);
            assert_eq!(limit.has_lasted(now, later), has_lasted, "{after_s} s");
            assert!(!Silence::NoLimit.has_lasted(now, later));
        }
    }

    #[test]
    fn fault_a_silence_that_is_none_is_refused_with_what_was_expected() {
        assert_eq!("60".parse(), Ok(Silence::Limit(Duration::from_secs(60))));
        assert_eq!("never".parse(), Ok(Silence::NoLimit));
        for wrong in ["", "0", "-1", "1.5", "1m", "99999999999"] {
            let error = Silence::from_str(wrong).expect_err(wrong);
            assert!(error.contains("1 or more") && error.contains("never"), "{error}");
        }
    }
}
