//! The cost of an estimate: taking samples in, a block update, and the worst block there is.
//!
//! Nine parameters, two equations, N = 1900, one thread. Figures in docs/results.md.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use thetabus::estimator::{BlockEstimator, EstimatorOptions};
use thetabus::model::{JointSample, Manipulator};
use thetabus::rows::{
    InputSource, InputTiming, PointwiseBlock, ProjectedBlock, ProjectedOptions, SampleBlock, structure,
};
use thetabus::sim::{ArmSimulator, Interpolation, MassSchedule, SensorOptions, SimOptions};

const BLOCK: usize = 1900;

/// Blocks of the paper's scenario with 0.05 V of noise, starting where both joints move.
fn blocks(count: usize, mass: MassSchedule) -> Vec<PointwiseBlock<Manipulator>> {
    let sim = SimOptions {
        mass_2: mass,
        sensors: SensorOptions {
            input_noise_v: 0.05,
            ..SensorOptions::exact()
        },
        ..SimOptions::cedro2022()
    };
    let samples: Vec<JointSample> = ArmSimulator::new(&sim)
        .expect("valid options")
        .skip(BLOCK)
        .take(count * BLOCK)
        .collect();
    samples
        .chunks_exact(BLOCK)
        .map(|chunk| {
            let mut block = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, BLOCK);
            for (k, sample) in chunk.iter().enumerate() {
                assert!(block.push(k as u64 * 1_000_000, sample));
            }
            block
        })
        .collect()
}

fn options() -> EstimatorOptions {
    let truth = SimOptions::cedro2022().true_theta(0.0);
    let start = truth
        .iter()
        .enumerate()
        .map(|(i, t)| if i % 2 == 0 { t * 2.5 } else { t / 2.5 })
        .collect();
    EstimatorOptions {
        lower: vec![0.0; 9],
        ..EstimatorOptions::recommended(start, 2)
    }
}

fn estimator(options: EstimatorOptions) -> BlockEstimator {
    BlockEstimator::new(structure(&Manipulator::default()), options).expect("valid options")
}

fn identifier(c: &mut Criterion) {
    let sim = SimOptions::cedro2022();
    let samples: Vec<JointSample> = ArmSimulator::new(&sim).expect("valid options").take(BLOCK).collect();
    let mut block = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, BLOCK);
    let mut k = 0;
    c.bench_function("identifier/sample/p9", |b| {
        b.iter(|| {
            if k == BLOCK {
                block.clear();
                k = 0;
            }
            let taken = block.push(k as u64, black_box(&samples[k]));
            k += 1;
            taken
        });
    });

    let steady = blocks(6, MassSchedule::constant(150.0));
    let three = estimator(EstimatorOptions {
        max_iterations: 3,
        ..options()
    });
    assert_eq!(three.clone().update(&steady[0]).iterations, 3);
    c.bench_function("identifier/update/p9", |b| {
        b.iter_batched_ref(
            || three.clone(),
            |e| e.update(black_box(&steady[0])).iterations,
            BatchSize::SmallInput,
        );
    });

    let mut settled = estimator(options());
    for block in &steady[..5] {
        settled.update(block);
    }
    println!("settled: {} iterations", settled.clone().update(&steady[5]).iterations);
    c.bench_function("identifier/update_settled/p9", |b| {
        b.iter_batched_ref(
            || settled.clone(),
            |e| e.update(black_box(&steady[5])).iterations,
            BatchSize::SmallInput,
        );
    });

    // one change in the block: alarm, location, fits of the parts
    let at = |s: f64| (BLOCK as f64 * 6.0 + s * BLOCK as f64) * 1e-3;
    let step = Interpolation::Step;
    let jump = MassSchedule {
        points: vec![(0.0, 150.0), (at(0.4), 170.0)],
        interpolation: step,
    };
    let jumping = blocks(6, jump);
    println!("jump: {:?}", settled.clone().update(&jumping[5]).change);
    c.bench_function("identifier/update_jump/p9", |b| {
        b.iter_batched_ref(
            || settled.clone(),
            |e| e.update(black_box(&jumping[5])).iterations,
            BatchSize::SmallInput,
        );
    });

    // the most that a block can ask for: three changes, each to be located, and every fit to the
    // last iteration
    let points = vec![
        (0.0, 150.0),
        (at(0.2), 250.0),
        (at(0.45), 90.0),
        (at(0.7), 200.0),
        (at(0.85), 120.0),
    ];
    let wild = blocks(
        6,
        MassSchedule {
            points,
            interpolation: step,
        },
    );
    println!("worst: {:?}", settled.clone().update(&wild[5]).change);
    c.bench_function("identifier/update_worst/p9", |b| {
        b.iter_batched_ref(
            || settled.clone(),
            |e| e.update(black_box(&wild[5])).iterations,
            BatchSize::SmallInput,
        );
    });
}

/// Projected rows with automatic differentiation: taking samples in, making the rows of a block
/// with their weights, and the update.
fn projected(c: &mut Criterion) {
    let sim = SimOptions {
        sensors: SensorOptions::encoder(16, 0.05),
        ..SimOptions::cedro2022()
    };
    let samples: Vec<JointSample> = ArmSimulator::new(&sim)
        .expect("valid options")
        .take(4 * BLOCK)
        .collect();
    let options = EstimatorOptions {
        noise_floor: vec![1.0; 2],
        ..options()
    };
    let rows = ProjectedOptions {
        timing: InputTiming::Continuous,
        ..ProjectedOptions::recommended()
    };
    let mut block = ProjectedBlock::new(Manipulator::default(), rows, BLOCK)
        .and_then(|block| block.starting_at(&options.theta_start))
        .expect("valid options");
    let mut settled = estimator(options.clone());
    for (k, sample) in samples[..3 * BLOCK].iter().enumerate() {
        assert!(block.push(k as u64 * 1_000_000, sample));
        if (k + 1) % BLOCK == 0 {
            block.prepare(settled.theta());
            settled.update(&block);
            block.clear();
        }
    }
    let empty = block.clone();
    let last: Vec<(u64, &JointSample)> = (3 * BLOCK as u64..).zip(&samples[3 * BLOCK..]).collect();
    c.bench_function("identifier/projected/samples/p9", |b| {
        b.iter_batched_ref(
            || empty.clone(),
            |block| {
                for &(k, sample) in &last {
                    assert!(block.push(k * 1_000_000, black_box(sample)));
                }
            },
            BatchSize::LargeInput,
        );
    });
    for &(k, sample) in &last {
        assert!(block.push(k * 1_000_000, sample));
    }
    c.bench_function("identifier/projected/whitening/p9", |b| {
        b.iter_batched_ref(
            || block.clone(),
            |block| block.prepare(black_box(settled.theta())),
            BatchSize::LargeInput,
        );
    });
    block.prepare(settled.theta());
    let three = estimator(EstimatorOptions {
        max_iterations: 3,
        ..options
    });
    assert_eq!(three.clone().update(&block).iterations, 3);
    c.bench_function("identifier/projected/update/p9", |b| {
        b.iter_batched_ref(
            || three.clone(),
            |e| e.update(black_box(&block)).iterations,
            BatchSize::SmallInput,
        );
    });
}

criterion_group!(benches, identifier, projected);
criterion_main!(benches);
