//! The window length recommended for a motion.

use std::f64::consts::TAU;
use thetabus::rows::{window_advice, window_advice_at};

const H: f64 = 1e-3;
const COUNT: f64 = TAU / 65536.0;

fn rounded(q: f64) -> f64 {
    (q / COUNT).round() * COUNT
}

/// 64-bit linear congruential generator, uniform in [0, 1).
fn uniform(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[test]
fn fault_steps_of_the_setpoint_advise_no_window_of_a_few_samples() {
    // a critically damped axis, 40 rad/s, under steps of 3 rad each second: its acceleration jumps
    let q: Vec<f64> = (0..20_000)
        .map(|k| {
            let sign = if (k / 1000) % 2 == 0 { 1.0 } else { -1.0 };
            let t = 40.0 * H * (k % 1000) as f64;
            rounded(sign * (1.5 - 3.0 * (1.0 + t) * (-t).exp()))
        })
        .collect();
    let advice = window_advice(&q, H).unwrap();
    // 1.3/f_b would be less than 20 samples; those of 8 samples put an offset 10 % off
    assert!(advice.bandwidth_hz > 65.0, "{advice:?}");
    assert!((advice.window_s / H - 20.0).abs() < 1e-9, "{advice:?}");
}

#[test]
fn fault_lost_samples_are_no_fast_motion() {
    let motion = |t: f64| (TAU * 0.4 * t).sin() + 0.12 * (TAU * 2.7 * t + 1.0).sin();
    let all: Vec<(u64, f64)> = (0..20_000_u64)
        .map(|k| (1_000_000 * k, rounded(motion(H * k as f64))))
        .collect();
    let whole = window_advice_at(&all, H).unwrap();
    assert!((whole.bandwidth_hz / 2.7 - 1.0).abs() < 0.2, "{whole:?}");
    let signal: Vec<f64> = all.iter().map(|sample| sample.1).collect();
    assert_eq!(window_advice(&signal, H), Some(whole));

    for share in [0.01, 0.05, 0.2] {
        let mut random = uniform(7);
        let kept: Vec<_> = all.iter().copied().filter(|_| random() > share).collect();
        let advice = window_advice_at(&kept, H).unwrap();
        // the taper's main lobe, and a twentieth of e to a step
        assert!((advice.bandwidth_hz / 2.7 - 1.0).abs() < 0.2, "{share}: {advice:?}");
        // put one behind the other they jump
        let signal: Vec<f64> = kept.iter().map(|sample| sample.1).collect();
        assert!(window_advice(&signal, H).unwrap().bandwidth_hz > 50.0, "{share}");
    }
    // a hole that no window bridges; time that goes back; stamps as a driver reads them
    let hole: Vec<_> = all[..9000].iter().chain(&all[9300..]).copied().collect();
    let back: Vec<_> = all[..9000].iter().chain(&all[8000..]).copied().collect();
    let mut random = uniform(3);
    let irregular: Vec<(u64, f64)> = (0..20_000_u64)
        .map(|k| {
            let t_ns = 1_000_000 * k + (3e5 * random()) as u64;
            (t_ns, rounded(motion(1e-9 * t_ns as f64)))
        })
        .collect();
    for samples in [hole, back, irregular] {
        let advice = window_advice_at(&samples, H).unwrap();
        assert!((advice.bandwidth_hz / 2.7 - 1.0).abs() < 0.2, "{advice:?}");
    }
    assert_eq!(window_advice_at(&[], H), None);
    assert_eq!(window_advice_at(&all[..3], H), None);
    assert_eq!(
        window_advice_at(&[(5, 1.0), (5, 2.0), (u64::MAX, 1.0), (0, 1.0)], H),
        None
    );
}
