//! Limits the memory that the configuration in a recording may request.
//!
//! A recording may be from anyone, so reading it must not take gigabytes unexpectedly. Settings
//! stated by the user are not limited.

use super::error::{ConfigError, Origin, Problem};
use super::layers::Layers;
use super::sections::Config;
use crate::rows::{FirstBlocks, RowForm};

/// The keys on which the size of a block's rows depends.
const KEYS: [&str; 5] = [
    "estimator.block_len",
    "identifier.projected.stride_s",
    "identifier.projected.window_s",
    "identifier.projected.velocity_half_width_s",
    "plant.sample_period_s",
];
/// Largest memory for the rows of a recorded configuration \[bytes\]. The default blocks of the arm
/// take 2 MB.
const LIMIT: u64 = 512 << 20;

/// Those of [`KEYS`] that a recording states.
pub(super) fn recorded(layers: &Layers) -> Vec<(&'static str, Origin)> {
    let stated = |key: &'static str| Some((key, layers.recorded_origin(key)?));
    KEYS.into_iter().filter_map(stated).collect()
}

impl Config {
    /// Refuses a configuration from a recording whose blocks take too much memory.
    ///
    /// # Errors
    /// If the rows take more than 512 MiB because of a key that only the recording states; the
    /// command line may state it again.
    pub fn limit_recorded_memory(&self) -> Result<(), ConfigError> {
        let bytes = self.rows_bytes();
        let Some((key, origin)) = self.recorded.first().filter(|_| bytes > LIMIT) else {
            return Ok(());
        };
        let again: Vec<String> = self.recorded.iter().map(|(key, _)| format!("--set {key}=…")).collect();
        let message = format!(
            "expected blocks whose rows take at most {} MiB of memory, because a recording states them, got {} samples per block{}, \
             which take some {} MiB; state a shorter block, or the same on the command line if you trust the recording: {}",
            LIMIT >> 20,
            self.estimator.block_len,
            match &self.identifier.rows {
                RowForm::Pointwise => String::new(),
                RowForm::Projected(options) => format!(
                    ", a window of {} s each {} s with a sample period of {} s",
                    options.window_s, options.stride_s, options.sample_period_s
                ),
            },
            bytes >> 20,
            again.join(" ")
        );
        Err(ConfigError {
            problems: vec![Problem::new(origin.clone(), key, message)],
        })
    }

    /// Upper estimate of the memory for the rows of a block \[bytes\]: signals and features of each
    /// sample, samples of the first four blocks, columns of each window, and three bands of the
    /// windows' covariance, as wide as a window reaches.
    fn rows_bytes(&self) -> u64 {
        let definition = self.model.definition();
        let (joints, equations) = (definition.joints as u64, definition.equations.len() as u64);
        let params = definition.parameters.len() as u64;
        let block_len = self.estimator.block_len as u64;
        let sample = 8 * (23 * joints + 32);
        match &self.identifier.rows {
            RowForm::Pointwise => block_len.saturating_mul(sample + 8 * (params + 1) * equations),
            RowForm::Projected(options) => {
                let samples = |time_s: f64| (time_s / options.sample_period_s).round().max(1.0) as u64;
                let (window, stride) = (samples(options.window_s), samples(options.stride_s));
                let reach = window + 4 * options.velocity_half_width as u64;
                let room = FirstBlocks::room(self.estimator.block_len) as u64;
                let capacity = room + room / 16 + 2 * reach + stride;
                let windows = capacity / stride + 2;
                let band = 3 * (reach / stride + 2);
                let columns = 4 * (params + 16) + 16;
                let of_windows = windows.saturating_mul(8 * equations * (band + columns));
                let kept = FirstBlocks::kept(self.estimator.block_len) as u64;
                let of_first_blocks = kept.saturating_mul(8 * (1 + 3 * joints));
                let of_samples = capacity.saturating_mul(sample).saturating_add(of_first_blocks);
                of_samples.saturating_add(of_windows)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Source;
    use super::*;

    fn recorded(own: &[&str], user: &[&str]) -> Config {
        let lines = own.iter().map(|line| format!("{line}\n")).collect::<String>();
        let sources = [
            Config::embedded("encoder_only").expect("built in"),
            Source::Recorded {
                name: "the recording's configuration".to_owned(),
                text: lines,
            },
        ];
        let user: Vec<String> = user.iter().map(|set| (*set).to_owned()).collect();
        Config::load(&sources, &user).expect("valid")
    }

    #[test]
    fn regress_the_keys_that_decide_on_memory_exist() {
        for key in KEYS {
            assert!(super::super::schema::key(key).is_some(), "{key}");
        }
    }

    #[test]
    fn fault_a_recording_may_not_ask_for_gigabytes_and_the_user_may() {
        let long = "estimator.block_len = 10000000";
        let dense = "identifier.projected.stride_s = 0.001";
        let (long_set, dense_set) = ("estimator.block_len=10000000", "identifier.projected.stride_s=0.001");
        for (own, key) in [
            (&[long][..], "estimator.block_len"),
            (&["estimator.block_len = 500000", dense], "estimator.block_len"),
        ] {
            let error = recorded(own, &[]).limit_recorded_memory().expect_err(key).to_string();
            for part in [
                "the recording's configuration:1",
                key,
                "512 MiB",
                "samples per block",
                "--set",
            ] {
                assert!(error.contains(part), "{part:?} is not in {error}");
            }
        }
        for (own, user) in [
            (&[][..], &[][..]),
            (&["estimator.block_len = 200000"], &[]),
            (&[long], &["estimator.block_len=1900"]),
            (&[long], &[long_set]),
            (&[long, dense], &[long_set, dense_set]),
        ] {
            assert!(recorded(own, user).limit_recorded_memory().is_ok(), "{own:?} {user:?}");
        }
    }

    #[test]
    fn val_the_memory_of_rows_is_not_far_from_what_was_measured() {
        // Resident memory of `identify` over that of a block of 1900 samples, 500 000 samples at 1
        // kHz.
        for (stride, measured_mb) in [("0.02", 265), ("0.001", 3_930)] {
            let stride = format!("identifier.projected.stride_s={stride}");
            let config = recorded(&[], &["estimator.block_len=500000", &stride]);
            let mb = config.rows_bytes() / 1_000_000;
            // Only memory written to is resident; more is allocated.
            assert!((measured_mb..4 * measured_mb).contains(&mb), "{stride}: {mb} MB");
        }
    }
}
