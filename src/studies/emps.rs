//! A real machine: the Electro-Mechanical Positioning System (EMPS), a carriage on a ball screw.
//!
//! A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, Workshop on Nonlinear
//! System Identification Benchmarks, 2019.

use super::CompareError;
use super::document::{Section, Table, two_digits};
use crate::estimator::{BlockEstimator, EstimatorOptions, Report};
use crate::model::{DriveInput, JointSample, Motion, ServoAxis};
use crate::rows::{InputTiming, ProjectedBlock, ProjectedOptions, SampleBlock, SensorNoise, priors, structure};

/// Force on the carriage per volt of the drive \[N/V\].
pub const GAIN: f64 = 35.150_651_88;
/// Published mass \[kg\], viscous friction \[N s/m\], Coulomb friction \[N\] and offset \[N\]:
/// off-line fits of the same record.
pub const PUBLISHED: [f64; 4] = [95.1089, 203.5034, 20.3935, -3.1648];

/// Rows for the recording at 1 kHz.
pub fn rows(window_s: f64, timing: InputTiming) -> ProjectedOptions {
    let mut noise = SensorNoise::NONE;
    noise.position_resolution[0] = 50e-9;
    noise.input_noise[0] = 0.05;
    ProjectedOptions {
        window_s,
        stride_s: window_s / 5.0,
        timing,
        noise,
        ..ProjectedOptions::recommended()
    }
}

/// One on-line pass over position \[m\] and voltage \[V\]: the last report, and in how many blocks
/// every parameter was excited.
///
/// # Errors
/// If the options are invalid.
pub fn pass(
    record: &[(f64, f64)],
    rows: ProjectedOptions,
    forgetting_factor: f64,
) -> Result<(Report, usize), CompareError> {
    const BLOCK_LEN: usize = 1900;
    let axis = ServoAxis::new(Motion::Linear, DriveInput::Voltage, GAIN)
        .expect("only a gain of 0 is refused, and this is not 0");
    let mut options = EstimatorOptions::recommended(priors(&axis), 1);
    options.forgetting_factor = forgetting_factor;
    options.change_detection = None;
    let mut block = ProjectedBlock::new(axis.clone(), rows, BLOCK_LEN)?;
    let mut estimator = BlockEstimator::new(structure(&axis), options)?;
    let mut excited = 0;
    for (k, &(q, voltage)) in record.iter().enumerate() {
        let mut sample = JointSample::default();
        (sample.q[0], sample.input[0]) = (q, voltage);
        // a block has capacity for all its samples
        let _taken = block.push(k as u64 * 1_000_000, &sample);
        if (k + 1) % BLOCK_LEN == 0 {
            block.prepare(estimator.theta());
            excited += usize::from(estimator.update(&block).excited.len() == 4);
            block.clear();
        }
    }
    Ok((estimator.report().clone(), excited))
}

/// Relative difference of each parameter from the published value.
pub fn errors(report: &Report) -> [f64; 4] {
    std::array::from_fn(|i| report.theta[i] / PUBLISHED[i] - 1.0)
}

/// The table, or why there is none.
pub(super) fn section(recording: Option<&[(f64, f64)]>) -> Result<Section, CompareError> {
    let heading = "A real machine: EMPS".to_owned();
    let mut table = Table::new(&[
        "window",
        "input between samples",
        "noise levels",
        "mass",
        "viscous friction",
        "Coulomb friction",
        "offset",
    ]);
    let Some(record) = recording else {
        let text = "The recording was not at hand when this document was made (`--recording FILE`, columns `q_m` and `voltage_v`).";
        return Ok(Section {
            heading,
            text: vec![text.to_owned()],
            table,
        });
    };
    for window_s in [0.024, 0.04, 0.06, 0.08, 0.12] {
        for (timing, name) in [(InputTiming::Continuous, "continuous"), (InputTiming::Held, "held")] {
            for learn_noise in [false, true] {
                if learn_noise && (timing == InputTiming::Held || window_s != 0.04) {
                    continue;
                }
                let options = ProjectedOptions {
                    learn_noise,
                    ..rows(window_s, timing)
                };
                let (report, _) = pass(record, options, 1.0)?;
                let mut row = vec![
                    format!("{:.0} ms", 1e3 * window_s),
                    name.to_owned(),
                    if learn_noise { "learnt" } else { "known" }.to_owned(),
                ];
                for (i, error) in errors(&report).into_iter().enumerate() {
                    let deviation = 100.0 * (report.theta_std[i] / PUBLISHED[i]).abs();
                    row.push(format!("{:+.2} ± {} %", 100.0 * error, two_digits(deviation)));
                }
                table.push(row);
            }
        }
    }
    Ok(Section {
        heading,
        text: vec![
            "24.8 s of the carriage, encoder and drive voltage at 1 kHz, in one on-line pass of 13 blocks, λ = 1, with the rows of `config/servo_axis.toml`. The table has the \
             difference from the published values, which are off-line fits of the same record, ± one standard deviation. Six of the blocks contain motion in one direction only and \
             say nothing on some parameter."
                .to_owned(),
            "The estimates hardly depend on the window, so they are not tuned to the known answer. They do depend on the input between samples. The drive's voltage is continuous; \
             if it is treated as held, it acts half a sample late."
                .to_owned(),
        ],
        table,
    })
}
