#![allow(missing_docs)]
use thetabus::estimator::Residuals;
use thetabus::model::*;
use thetabus::rows::*;
use thetabus::sim::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let get = |k: &str, d: f64| {
        a.iter()
            .find_map(|s| s.strip_prefix(&format!("{k}=")))
            .map_or(d, |v| v.parse().unwrap())
    };
    let analog = get("analog", 1.0) > 0.0;
    let mut bins = vec![[0.0f64; 4]; 24];
    let mut zs: Vec<[f64; 4]> = vec![];
    let mut prof = [0.0f64; 24];
    let mut profn = [0.0f64; 24];
    let mut ac = [[0.0f64; 8]; 2];
    for seed in 0..get("seeds", 40.0) as u64 {
        let mut sim = SimOptions::cedro2022();
        sim.duration_s = 19.0;
        sim.seed = seed + 1000;
        sim.mass_2 = MassSchedule::constant(150.0);
        let r = |l: f64| Setpoint::Random {
            min_rad: -l,
            max_rad: l,
            min_dwell_s: 1.0,
            max_dwell_s: 3.0,
        };
        sim.setpoint = [r(1.0), r(0.8)];
        if !analog {
            sim.controller.kind = ControllerKind::Sampled;
        }
        let exact: Vec<JointSample> = ArmSimulator::new(&sim).unwrap().take(19000).collect();
        sim.sensors = SensorOptions::encoder(get("bits", 20.0) as u32, get("volt", 0.0));
        let rows = ProjectedOptions {
            timing: if analog {
                InputTiming::Continuous
            } else {
                InputTiming::Held
            },
            noise: SensorNoise::encoder(get("told", 20.0) as u32, get("volt", 0.0)),
            velocity_half_width: get("vh", 5.0) as usize,
            ..ProjectedOptions::recommended()
        };
        let mut all: Vec<(f64, Vec<f64>, usize)> = vec![];
        let mut block = ProjectedBlock::new(Manipulator::default(), rows, 1900).unwrap();
        let truth = sim.true_theta(0.0).to_vec();
        for (k, s) in ArmSimulator::new(&sim).unwrap().take(19000).enumerate() {
            assert!(block.push(k as u64 * 1_000_000, &s));
            if k % 1900 == 1899 {
                block.prepare(&truth);
                // prepare fits the first block itself; weigh again at the truth
                block.prepare(&truth);
                let mut last = [[0.0; 8]; 2];
                for i in 0..block.len() {
                    let (t0, t1) = block.span(i);
                    let (k0, k1) = ((t0 / 1_000_000) as usize, (t1 / 1_000_000) as usize);
                    for e in 0..2 {
                        let v = (k0..=k1).map(|k| exact[k].dq[e].abs()).sum::<f64>() / (k1 - k0 + 1) as f64;
                        let n = if e == 0 { 5 } else { 4 };
                        let mut phi = vec![0.0; n];
                        let f = block.row(e, i, &truth, &mut phi);
                        let bin0 = (2.0 * (v.log10() + 7.0)).clamp(0.0, 23.0) as usize;
                        if e == 0 {
                            all.push((f, phi.clone(), bin0));
                        }
                        let bin = (2.0 * (v.log10() + 7.0)).clamp(0.0, 23.0) as usize;
                        bins[bin][2 * e] += f * f;
                        bins[bin][2 * e + 1] += 1.0;
                        if v > 1e-2 {
                            for l in 0..8 {
                                if i > l {
                                    ac[e][l] += f * if l == 0 { f } else { last[e][l - 1] }
                                }
                            }
                        }
                        for l in (1..8).rev() {
                            last[e][l] = last[e][l - 1];
                        }
                        last[e][0] = f;
                    }
                }
                block.clear();
            }
        }
        let mut g = nalgebra::DMatrix::<f64>::zeros(5, 5);
        for (_, p, _) in &all {
            for i in 0..5 {
                for j in 0..5 {
                    g[(i, j)] += p[i] * p[j];
                }
            }
        }
        let k = g.try_inverse().unwrap();
        let mut z = [0.0; 4];
        for (f, p, b) in &all {
            for (c, r) in [(0usize, 2usize), (2, 0)] {
                let w: f64 = (0..5).map(|j| k[(r, j)] * p[j]).sum::<f64>() / k[(r, r)].sqrt();
                z[c] += w * f;
                z[c + 1] += (w * f).powi(2);
                if r == 2 {
                    profn[*b] += w * w;
                    prof[*b] += (w * f).powi(2);
                }
            }
        }
        zs.push(z);
    }
    let n = zs.len() as f64;
    println!(
        "z3 rms {:.3} diag {:.3}  z1 rms {:.3} diag {:.3} n {}",
        (zs.iter().map(|z| z[0] * z[0]).sum::<f64>() / n).sqrt(),
        (zs.iter().map(|z| z[1]).sum::<f64>() / n).sqrt(),
        (zs.iter().map(|z| z[2] * z[2]).sum::<f64>() / n).sqrt(),
        (zs.iter().map(|z| z[3]).sum::<f64>() / n).sqrt(),
        n
    );
    for b in 0..24 {
        if profn[b] > 0.0 {
            println!(
                "bin 1e{:.1}: share of expected variance {:.3} actual {:.3}",
                b as f64 / 2.0 - 7.0,
                profn[b] / n,
                prof[b] / n
            );
        }
    }
    for (b, x) in bins.iter().enumerate() {
        println!(
            "|v| 1e{:.1}  eq1 {:.2} n {}   eq2 {:.2} n {}",
            b as f64 / 2.0 - 7.0,
            x[0] / x[1],
            x[1],
            x[2] / x[3],
            x[3]
        );
    }
    for e in 0..2 {
        println!(
            "autocorrelation {:?}",
            ac[e].map(|v| (1000.0 * v / ac[e][0]).round() / 1000.0)
        );
    }
}
