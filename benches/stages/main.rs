//! Times of every stage from a sample to an estimate; `table.py` makes a table of their medians.
//!
//! `cargo bench --bench stages` runs them all; `THETABUS_STAGE=block/` those with this in their
//! name.

mod all;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};

fn times(c: &mut Criterion) {
    let only = std::env::var("THETABUS_STAGE").unwrap_or_default();
    for stage in all::stages(&only) {
        let mut group = c.benchmark_group("stages");
        group.sample_size(30);
        group.throughput(Throughput::Elements(stage.pieces));
        group.bench_function(stage.name, |b| {
            let once = |mut work: all::Work| {
                work();
                work
            };
            b.iter_batched(|| (stage.ready)(), once, BatchSize::PerIteration);
        });
        group.finish();
    }
}

criterion_group!(benches, times);
criterion_main!(benches);
