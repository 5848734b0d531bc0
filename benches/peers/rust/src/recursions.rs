//! Recursive least squares on given rows: θ₁ … θ₅ from the first equation, θ₆, θ₇, θ₈, θ₆θ₉ and
//! θ₇θ₉ from the second.

use crate::report::report;
use flight_solver::rls::{CovarianceGuards, InverseQrRls, Rls};
use nalgebra_034::SVector;
use thetabus::estimator::Wrls;

/// A row of each equation with its right side.
pub type Rows = [([f64; 5], f64); 2];

/// Variance of each parameter at the start, its unit squared; θ starts from 0.
const START_VARIANCE: f64 = 10.0;

fn theta_of(one: &[f64], two: &[f64]) -> Vec<f64> {
    [one, &[two[0], two[1], two[2], two[4] / two[1]]].concat()
}

/// Prints the lines of all.
pub fn run(rows: &[Rows], truth: &[f64]) {
    let count = rows.len();
    report("rows", "thetabus Wrls", count, truth, || {
        let new = || Wrls::new(&[0.0; 5], 1.0, 1.0 / START_VARIANCE);
        let (Ok(mut one), Ok(mut two)) = (new(), new()) else {
            return vec![f64::NAN; 9];
        };
        for [(a, y), (b, z)] in rows {
            let _ = one.update(a, *y);
            let _ = two.update(b, *z);
        }
        theta_of(one.theta(), two.theta())
    });
    report("rows", "oxictl Rls f64", count, truth, || {
        let new = || oxictl::adaptive::rls::Rls::<f64, 5>::new(1.0, START_VARIANCE);
        let (mut one, mut two) = (new(), new());
        for [(a, y), (b, z)] in rows {
            one.update(a, *y);
            two.update(b, *z);
        }
        theta_of(&one.theta, &two.theta)
    });
    let narrow: Vec<[(SVector<f32, 5>, f32); 2]> = rows
        .iter()
        .map(|row| row.map(|(a, y)| (SVector::from(a.map(|x| x as f32)), y as f32)))
        .collect();
    let wide = |x: &SVector<f32, 5>| -> Vec<f64> { x.iter().map(|&x| f64::from(x)).collect() };
    report("rows", "flight-solver Rls f32", count, truth, || {
        let new = || Rls::<5, 1>::new(START_VARIANCE as f32, 1.0, CovarianceGuards::default());
        let (mut one, mut two) = (new(), new());
        for [(a, y), (b, z)] in &narrow {
            one.update(a, &SVector::from([*y]));
            two.update(b, &SVector::from([*z]));
        }
        theta_of(&wide(one.params()), &wide(two.params()))
    });
    report("rows", "flight-solver InverseQrRls f32", count, truth, || {
        let new = || InverseQrRls::<5, 1>::new(START_VARIANCE as f32, 1.0);
        let (mut one, mut two) = (new(), new());
        for [(a, y), (b, z)] in &narrow {
            one.update(a, &SVector::from([*y]));
            two.update(b, &SVector::from([*z]));
        }
        theta_of(&wide(one.params()), &wide(two.params()))
    });
}
