//! The cost of identifying a six-axis robot with 70 parameters on line, one thread: a sample, and
//! the end of a block.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use thetabus::robot::{
    EnergyRegressors, IdentifyOptions, JointFriction, Robot, RobotIdentifier, RobotModel, RobotSample, Selection,
};

fn sample(t_s: f64) -> RobotSample {
    let mut sample = RobotSample {
        t_s,
        ..RobotSample::default()
    };
    for i in 0..6 {
        let w = 1.0 + 0.3 * i as f64;
        (sample.q[i], sample.dq[i], sample.tau[i]) = ((w * t_s).sin(), w * (w * t_s).cos(), 10.0 * (w * t_s).cos());
    }
    sample
}

fn robot(c: &mut Criterion) {
    let urdf = include_str!("../config/robots/six_axis.urdf");
    let robot = Robot::from_urdf(urdf, &Selection::default()).expect("a sound URDF");
    let mut regressors = EnergyRegressors::new(6);
    let state = sample(0.7);
    c.bench_function("robot/regressors/6", |b| {
        b.iter(|| regressors.evaluate(black_box(&robot), black_box(&state.q[..6]), black_box(&state.dq[..6])));
    });
    let model = RobotModel::new(robot, true, vec![JointFriction::default(); 6]).expect("sound friction");
    let options = IdentifyOptions {
        block_s: 1e9,
        ..IdentifyOptions::default()
    };
    let mut endless = RobotIdentifier::new(model.clone(), options).expect("sound options");
    let motion: Vec<RobotSample> = (0..1000).map(|k| sample(0.001 * f64::from(k))).collect();
    let mut k = 0_u32;
    c.bench_function("robot/sample/p70", |b| {
        b.iter(|| {
            k += 1;
            let sample = RobotSample {
                t_s: 0.001 * f64::from(k),
                ..motion[k as usize % motion.len()]
            };
            endless.push(black_box(&sample))
        });
    });
    // 40 blocks in, one sample before the end of the next.
    for (name, settle_blocks) in [("robot/block/settling/p70", 60), ("robot/block/walking/p70", 5)] {
        let options = IdentifyOptions {
            settle_blocks,
            ..IdentifyOptions::default()
        };
        let mut ready = RobotIdentifier::new(model.clone(), options).expect("sound options");
        let mut k = 0_u32;
        while ready.blocks() < 40 || !k.is_multiple_of(100) {
            let _ = ready.push(&sample(0.01 * f64::from(k)));
            k += 1;
        }
        c.bench_function(name, |b| {
            b.iter_batched(
                || ready.clone(),
                |mut ready| ready.end_of_recording(),
                BatchSize::LargeInput,
            );
        });
    }
}

criterion_group!(benches, robot);
criterion_main!(benches);
