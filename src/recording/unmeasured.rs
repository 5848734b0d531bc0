//! Unmeasured signals are NaN in recordings, where 0 would look like a value; on the bus they may
//! have any value, usually 0.

use crate::messages::{SIGNALS, Sample};

/// The sample as in a recording.
pub(super) fn marked(sample: &Sample) -> Sample {
    let mut marked = *sample;
    fill(&mut marked, f64::NAN);
    marked
}

/// Converts back to the form on the bus, with 0 for unmeasured signals.
pub(super) fn clear(sample: &mut Sample) {
    fill(sample, 0.0);
}

#[inline]
fn fill(sample: &mut Sample, value: f64) {
    let measured = sample.signals;
    for (signal, values) in SIGNALS.iter().zip(sample.arrays_mut()) {
        if measured & signal.flag == 0 {
            values.fill(value);
        }
    }
}
