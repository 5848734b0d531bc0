//! Scheduled faults of sensors and of their transport, between the simulated machine and its
//! consumers.
//!
//! A fault changes what is published, never the machine or its controller. Faults act in the order
//! of the list, each on the result of the one before; a sample lost by one of them is lost. Each
//! fault has its own random stream, so adding a fault at the end of the list does not change the
//! others.

use super::fault::{Fault, FaultKind, FaultSignal};
use super::noise::Noise;
use crate::messages::{Passage, Sample, nanoseconds};
use std::collections::VecDeque;

/// A running schedule, which processes every sample of a stream in turn.
#[derive(Debug, Clone)]
pub struct Faults {
    active: Vec<Active>,
}

impl Faults {
    /// The faults of a run with this sample period \[s\] and seed; the list must be
    /// [valid](Fault::validate).
    pub fn new(list: &[Fault], sample_period_s: f64, seed: u64) -> Self {
        let new = |(index, &fault): (usize, &Fault)| Active {
            noise: Noise::new(seed, Noise::FAULTS + index as u64),
            from_ns: nanoseconds(fault.from_s),
            to_ns: nanoseconds(fault.to_s),
            period: match fault.kind {
                FaultKind::Slow { period_s } | FaultKind::Intermittent { period_s, .. } => {
                    samples(period_s, sample_period_s)
                }
                FaultKind::Delayed { delay_s } => samples(delay_s, sample_period_s),
                _ => 1,
            },
            held: None,
            past: VecDeque::new(),
            count: 0,
            off: false,
            fault,
        };
        Self {
            active: list.iter().enumerate().map(new).collect(),
        }
    }

    /// Applies the schedule to a sample; call it with each sample of the stream once, in order.
    pub fn apply(&mut self, sample: &mut Sample) -> Passage {
        let t_ns = sample.t_ns;
        let mut passage = Passage::default();
        for active in &mut self.active {
            let one = active.apply(t_ns, sample);
            passage.lost |= one.lost;
            passage.late_ns = passage.late_ns.saturating_add(one.late_ns);
        }
        passage
    }
}

#[derive(Debug, Clone)]
struct Active {
    fault: Fault,
    noise: Noise,
    from_ns: u64,
    to_ns: u64,
    /// Samples per period, or of delay.
    period: u64,
    /// The value at which a signal is stuck.
    held: Option<Sample>,
    /// Samples within the delay.
    past: VecDeque<Sample>,
    /// Samples since the fault began.
    count: u64,
    /// Off in this period.
    off: bool,
}

impl Active {
    fn apply(&mut self, t_ns: u64, sample: &mut Sample) -> Passage {
        let delayed = matches!(self.fault.kind, FaultKind::Delayed { .. }) && self.fault.signal != FaultSignal::Sample;
        if delayed {
            self.past.push_back(*sample);
            if self.past.len() as u64 > self.period + 1 {
                self.past.pop_front();
            }
        }
        if t_ns < self.from_ns || t_ns >= self.to_ns {
            return Passage::default();
        }
        let first_of_period = self.count.is_multiple_of(self.period);
        self.count += 1;
        let whole = self.fault.signal == FaultSignal::Sample;
        match self.fault.kind {
            FaultKind::Off => return self.switch_off(sample),
            FaultKind::Stuck => self.hold(sample, false),
            FaultKind::Slow { .. } if whole => return Passage::lost_if(!first_of_period),
            FaultKind::Slow { .. } => self.hold(sample, first_of_period),
            FaultKind::Garbage => self.garble(sample),
            FaultKind::Wrong { gain, offset } => self.distort(sample, gain, offset),
            FaultKind::Delayed { delay_s } if whole => {
                return Passage {
                    lost: false,
                    late_ns: nanoseconds(delay_s),
                };
            }
            FaultKind::Delayed { .. } => {
                if let Some(past) = self.past.front().copied() {
                    self.copy(&past, sample);
                }
            }
            FaultKind::Intermittent { share, .. } => {
                if first_of_period {
                    self.off = self.noise.uniform() < share;
                }
                if self.off {
                    return self.switch_off(sample);
                }
            }
        }
        Passage::default()
    }

    fn switch_off(&self, sample: &mut Sample) -> Passage {
        let signal = self.fault.signal;
        if signal == FaultSignal::Sample {
            return Passage::lost_if(true);
        }
        if self.fault.joint.is_none() {
            sample.signals &= !signal.bit();
        }
        let value = if self.fault.joint.is_none() { 0.0 } else { f64::NAN };
        self.each(signal, sample, |x| *x = value);
        Passage::default()
    }

    /// Outputs the kept sample, after keeping this one if there is none yet or a fresh one is due.
    fn hold(&mut self, sample: &mut Sample, fresh: bool) {
        if fresh || self.held.is_none() {
            self.held = Some(*sample);
        }
        if let Some(held) = self.held {
            self.copy(&held, sample);
        }
    }

    /// Copies the fault's signal from another sample.
    fn copy(&self, from: &Sample, to: &mut Sample) {
        match self.fault.signal {
            FaultSignal::Time => to.t_ns = from.t_ns,
            FaultSignal::Sample => FaultSignal::PARTS
                .iter()
                .for_each(|&part| self.copy_part(part, from, to)),
            signal => self.copy_part(signal, from, to),
        }
    }

    fn copy_part(&self, part: FaultSignal, from: &Sample, to: &mut Sample) {
        let mut from = *from;
        let Some(values) = part.of(&mut from) else { return };
        let wanted = self.fault.joint;
        for (joint, x) in part.of(to).into_iter().flatten().enumerate() {
            if wanted.is_none_or(|wanted| wanted == joint) {
                *x = values[joint];
            }
        }
    }

    fn garble(&mut self, sample: &mut Sample) {
        let mut noise = self.noise.clone();
        let mut random = |x: &mut f64| *x = garbage(&mut noise);
        if self.fault.signal == FaultSignal::Sample {
            FaultSignal::PARTS
                .iter()
                .for_each(|&part| self.each(part, sample, &mut random));
            sample.joints = noise.between(0.0, 256.0) as u32;
            sample.signals = noise.between(0.0, f64::from(u32::MAX)) as u32;
        } else {
            self.each(self.fault.signal, sample, &mut random);
        }
        self.noise = noise;
    }

    fn distort(&self, sample: &mut Sample, gain: f64, offset: f64) {
        if self.fault.signal == FaultSignal::Time {
            let since_ns = sample.t_ns.saturating_sub(self.from_ns) as f64;
            let t_ns = self.from_ns as f64 + gain * since_ns + offset * 1e9;
            // The conversion saturates.
            sample.t_ns = t_ns as u64;
        } else {
            self.each(self.fault.signal, sample, |x| *x = gain * *x + offset);
        }
    }

    /// Calls `change` for every affected value of a signal.
    fn each(&self, signal: FaultSignal, sample: &mut Sample, mut change: impl FnMut(&mut f64)) {
        for (joint, x) in signal.of(sample).into_iter().flatten().enumerate() {
            if self.fault.joint.is_none_or(|wanted| wanted == joint) {
                change(x);
            }
        }
    }
}

/// A quarter NaN, a quarter infinite, half of any sign and magnitude.
fn garbage(noise: &mut Noise) -> f64 {
    let (what, sign) = (noise.uniform(), if noise.uniform() < 0.5 { -1.0 } else { 1.0 });
    let size = 10f64.powf(noise.between(-300.0, 300.0));
    match what {
        x if x < 0.25 => f64::NAN,
        x if x < 0.5 => sign * f64::INFINITY,
        _ => sign * size,
    }
}

/// A time in whole samples, at least one.
fn samples(time_s: f64, sample_period_s: f64) -> u64 {
    ((time_s / sample_period_s).round() as u64).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::signals;
    use crate::model::JointSample;
    use crate::sim::ARM_JOINTS;

    const MS: u64 = 1_000_000;

    fn fault(kind: FaultKind, signal: FaultSignal, joint: Option<usize>) -> Fault {
        Fault {
            kind,
            signal,
            joint,
            from_s: 0.010,
            to_s: 0.020,
        }
    }

    /// 30 samples at 1 kHz, with every signal of joint j equal to 1 + seq + 100 j, and the outcome
    /// of each.
    fn emitted(fault: Fault) -> Vec<(Passage, Sample)> {
        fault.validate(ARM_JOINTS).expect("valid");
        let mut faults = Faults::new(&[fault], 1e-3, 5);
        (0..30)
            .map(|seq| {
                let mut sample = original(seq);
                (faults.apply(&mut sample), sample)
            })
            .collect()
    }

    fn original(seq: u64) -> Sample {
        let mut joints = JointSample::default();
        for joint in 0..ARM_JOINTS {
            let x = 1.0 + seq as f64 + 100.0 * joint as f64;
            joints.q[joint] = x;
            joints.dq[joint] = x;
            joints.ddq[joint] = x;
            joints.dddq[joint] = x;
            joints.setpoint[joint] = x;
            joints.input[joint] = x;
        }
        Sample::new(3, seq, seq * MS, ARM_JOINTS, signals::ALL, &joints)
    }

    /// Outside its time a fault changes no bit.
    fn rest_is_untouched(samples: &[(Passage, Sample)]) {
        for (seq, (passage, sample)) in samples.iter().enumerate() {
            if !(10..20).contains(&seq) {
                assert_eq!((*passage, *sample), (Passage::default(), original(seq as u64)));
            }
        }
    }

    #[test]
    fn fault_off_loses_samples_blanks_signals_and_marks_single_joints() {
        let lost = emitted(fault(FaultKind::Off, FaultSignal::Sample, None));
        rest_is_untouched(&lost);
        assert!(lost[10..20].iter().all(|(passage, _)| passage.lost));

        let blank = emitted(fault(FaultKind::Off, FaultSignal::Input, None));
        rest_is_untouched(&blank);
        for (_, sample) in &blank[10..20] {
            assert_eq!(sample.signals, signals::ALL & !signals::INPUT);
            assert_eq!((sample.input[0], sample.input[1]), (0.0, 0.0));
        }

        let joint = emitted(fault(FaultKind::Off, FaultSignal::Q, Some(1)));
        rest_is_untouched(&joint);
        for (seq, (_, sample)) in joint.iter().enumerate().take(20).skip(10) {
            assert_eq!(sample.signals, signals::ALL);
            assert!(sample.q[1].is_nan() && sample.q[0] == 1.0 + seq as f64);
        }
    }

    #[test]
    fn fault_stuck_keeps_the_value_at_its_beginning() {
        let samples = emitted(fault(FaultKind::Stuck, FaultSignal::Q, Some(0)));
        rest_is_untouched(&samples);
        for (seq, (_, sample)) in samples.iter().enumerate().take(20).skip(10) {
            assert_eq!((sample.q[0], sample.q[1]), (11.0, 101.0 + seq as f64));
            assert_eq!(sample.dq[0], 1.0 + seq as f64);
        }
        let whole = emitted(fault(FaultKind::Stuck, FaultSignal::Sample, None));
        assert!(whole[10..20].iter().all(|(_, s)| s.q[1] == 111.0 && s.input[0] == 11.0));
        assert_eq!(whole[15].1.t_ns, 15 * MS, "seq and time go on");
        let clock = emitted(fault(FaultKind::Stuck, FaultSignal::Time, None));
        assert!(clock[10..20].iter().all(|(_, s)| s.t_ns == 10 * MS));
    }

    #[test]
    fn fault_garbage_is_not_finite_half_of_the_time_and_seeded() {
        let mut long = fault(FaultKind::Garbage, FaultSignal::Input, Some(0));
        long.to_s = f64::INFINITY;
        let values = |seed| {
            let mut faults = Faults::new(&[long], 1e-3, seed);
            (0..4_010)
                .map(|seq| {
                    let mut sample = original(seq);
                    faults.apply(&mut sample);
                    assert_eq!(sample.input[1], 101.0 + seq as f64);
                    sample.input[0]
                })
                .skip(10)
                .collect::<Vec<f64>>()
        };
        let first = values(1);
        let finite = first.iter().filter(|x| x.is_finite()).count() as f64;
        // Half of 4000 with a standard deviation of 32; the tolerance is five of these.
        assert!((finite - 2_000.0).abs() < 160.0, "{finite} finite ones");
        let bits = |values: Vec<f64>| values.into_iter().map(f64::to_bits).collect::<Vec<_>>();
        let first = bits(first);
        assert_eq!(first, bits(values(1)));
        assert_ne!(first, bits(values(2)));
        let whole = emitted(fault(FaultKind::Garbage, FaultSignal::Sample, None));
        rest_is_untouched(&whole);
        assert!(
            whole[10..20]
                .iter()
                .any(|(_, s)| s.joints != 2 && s.signals != signals::ALL)
        );
    }

    #[test]
    fn fault_wrong_scales_and_shifts_signals_and_clocks() {
        let wrong = FaultKind::Wrong {
            gain: 2.0,
            offset: -3.0,
        };
        let samples = emitted(fault(wrong, FaultSignal::Dq, None));
        rest_is_untouched(&samples);
        for (seq, (_, sample)) in samples.iter().enumerate().take(20).skip(10) {
            let x = 1.0 + seq as f64;
            assert_eq!((sample.dq[0], sample.dq[1]), (2.0 * x - 3.0, 2.0 * (x + 100.0) - 3.0));
        }
        let jump = FaultKind::Wrong { gain: 1.0, offset: 5.0 };
        let clock = emitted(fault(jump, FaultSignal::Time, None));
        rest_is_untouched(&clock);
        assert_eq!(clock[12].1.t_ns, 5_012 * MS);
    }

    #[test]
    fn fault_slow_renews_once_per_period() {
        let slow = FaultKind::Slow { period_s: 0.004 };
        let held = emitted(fault(slow, FaultSignal::Q, None));
        rest_is_untouched(&held);
        let q: Vec<f64> = held[10..20].iter().map(|(_, s)| s.q[0]).collect();
        assert_eq!(q, [11.0, 11.0, 11.0, 11.0, 15.0, 15.0, 15.0, 15.0, 19.0, 19.0]);
        let sent = emitted(fault(slow, FaultSignal::Sample, None));
        let seqs: Vec<u64> = sent[10..20]
            .iter()
            .filter(|(p, _)| !p.lost)
            .map(|(_, s)| s.seq)
            .collect();
        assert_eq!(seqs, [10, 14, 18]);
    }

    #[test]
    fn fault_delayed_shows_old_values_and_holds_samples_back() {
        let delayed = FaultKind::Delayed { delay_s: 0.003 };
        let old = emitted(fault(delayed, FaultSignal::Input, Some(0)));
        rest_is_untouched(&old);
        for (seq, (_, sample)) in old.iter().enumerate().take(20).skip(10) {
            assert_eq!((sample.input[0], sample.q[0]), (seq as f64 - 2.0, 1.0 + seq as f64));
        }
        let late = emitted(fault(delayed, FaultSignal::Sample, None));
        assert!(
            late[10..20]
                .iter()
                .all(|(passage, _)| passage.late_ns == 3 * MS && !passage.lost)
        );
        assert_eq!(late[20].0, Passage::default());
    }

    #[test]
    fn fault_intermittent_is_off_for_its_share_in_whole_periods() {
        let mut now_and_then = fault(
            FaultKind::Intermittent {
                share: 0.3,
                period_s: 0.005,
            },
            FaultSignal::Sample,
            None,
        );
        now_and_then.to_s = f64::INFINITY;
        let mut faults = Faults::new(&[now_and_then], 1e-3, 11);
        let lost: Vec<bool> = (0..50_010).map(|seq| faults.apply(&mut original(seq)).lost).collect();
        assert!(lost[..10].iter().all(|lost| !lost));
        assert!(
            lost[10..]
                .chunks(5)
                .all(|period| period.iter().all(|lost| *lost == period[0]))
        );
        let share = lost[10..].iter().filter(|lost| **lost).count() as f64 / 50_000.0;
        // 10 000 periods: a standard deviation of 0.0046.
        assert!((share - 0.3).abs() < 0.025, "{share}");
    }

    #[test]
    fn regress_a_fault_strikes_the_joints_of_a_robot_beyond_the_second() {
        let double = FaultKind::Wrong { gain: 2.0, offset: 0.0 };
        let joints = JointSample {
            q: [1.0; crate::model::MAX_JOINTS],
            ..JointSample::default()
        };
        for (joint, expected) in [(Some(2), [1.0, 1.0, 2.0, 1.0]), (None, [2.0, 2.0, 2.0, 1.0])] {
            let mut faults = Faults::new(&[fault(double, FaultSignal::Q, joint)], 1e-3, 5);
            let mut sample = Sample::new(3, 15, 15 * MS, 3, signals::ALL, &joints);
            faults.apply(&mut sample);
            assert_eq!(sample.q[..4], expected);
        }
    }

    #[test]
    fn fault_schedules_that_make_no_sense_are_refused_by_name() {
        let base = fault(FaultKind::Off, FaultSignal::Q, None);
        let cases = [
            (Fault { to_s: 0.01, ..base }, "faults.to_s"),
            (Fault { to_s: f64::NAN, ..base }, "faults.to_s"),
            (Fault { from_s: -1.0, ..base }, "faults.from_s"),
            (Fault { joint: Some(2), ..base }, "faults.joint"),
            (fault(FaultKind::Stuck, FaultSignal::Sample, Some(0)), "faults.joint"),
            (fault(FaultKind::Off, FaultSignal::Time, None), "faults.kind"),
            (
                fault(FaultKind::Wrong { gain: 1.0, offset: 0.0 }, FaultSignal::Sample, None),
                "faults.signal",
            ),
            (
                fault(FaultKind::Delayed { delay_s: 0.0 }, FaultSignal::Q, None),
                "faults.delay_s",
            ),
            (
                fault(
                    FaultKind::Intermittent {
                        share: 1.5,
                        period_s: 0.0,
                    },
                    FaultSignal::Q,
                    None,
                ),
                "faults.share",
            ),
        ];
        // The third joint of a robot may also fail.
        assert!(Fault { joint: Some(2), ..base }.validate(3).is_ok());
        for (fault, field) in cases {
            assert_eq!(fault.validate(ARM_JOINTS).expect_err(field).field, field);
        }
    }
}
