//! The step of a least squares problem with bounds.
//!
//! ```text
//! minimise ½ δᵀ H δ − gᵀ δ   subject to   lower ≤ δ ≤ upper,   lower ≤ 0 ≤ upper
//! ```
//!
//! by the primal active set method from δ = 0 (Nocedal and Wright, Numerical Optimization, 2nd ed.,
//! section 16.5), which for simple bounds only needs factors of the free submatrix. Every iterate
//! is feasible and lowers the cost, so the step is a descent step even if it stops early. The two
//! bounds of a fixed parameter coincide.
//!
//! If H is singular (neither data nor prior inform on some parameter or combination), the step of
//! least length in the scaled columns is taken: parameters without information do not move.

use super::linalg::{Cholesky, Eigen, RANK_TOLERANCE, dot};

/// Workspace of the constrained step.
#[derive(Debug, Clone)]
pub struct ConstrainedStep {
    cholesky: Cholesky,
    eigen: Eigen,
    matrix: Vec<f64>,
    scale: Vec<f64>,
    rhs: Vec<f64>,
    index: Vec<usize>,
    free: Vec<bool>,
    delta: Vec<f64>,
}

impl ConstrainedStep {
    /// Room for n parameters.
    pub fn new(n: usize) -> Self {
        Self {
            cholesky: Cholesky::new(n),
            eigen: Eigen::new(n),
            matrix: vec![0.0; n * n],
            scale: vec![0.0; n],
            rhs: vec![0.0; n],
            index: Vec::with_capacity(n),
            free: vec![true; n],
            delta: vec![0.0; n],
        }
    }

    /// The minimiser δ.
    pub fn delta(&self) -> &[f64] {
        &self.delta
    }

    /// Solves the problem; H is n × n, full and symmetric positive semidefinite.
    pub fn solve(&mut self, h: &[f64], g: &[f64], lower: &[f64], upper: &[f64]) {
        let n = g.len();
        self.delta.fill(0.0);
        for i in 0..n {
            // start with what can move downhill
            let (down, up) = (lower[i] < 0.0, upper[i] > 0.0);
            self.free[i] = if g[i] > 0.0 {
                up
            } else if g[i] < 0.0 {
                down
            } else {
                down && up
            };
        }
        // each round fixes or frees one parameter; a few rounds are usual, the limit prevents
        // cycling on rounding
        for _ in 0..4 * n + 4 {
            self.solve_free(h, g);
            let mut fraction = 1.0;
            let mut blocking = None;
            for (k, &i) in self.index.iter().enumerate() {
                let step = self.rhs[k];
                let room = if step > 0.0 {
                    upper[i] - self.delta[i]
                } else {
                    lower[i] - self.delta[i]
                };
                if step != 0.0 && room / step < fraction {
                    fraction = (room / step).max(0.0);
                    blocking = Some(i);
                }
            }
            for (k, &i) in self.index.iter().enumerate() {
                self.delta[i] = (self.delta[i] + fraction * self.rhs[k]).clamp(lower[i], upper[i]);
            }
            if let Some(i) = blocking {
                self.delta[i] = if self.rhs_of(i) > 0.0 { upper[i] } else { lower[i] };
                self.free[i] = false;
                continue;
            }
            // optimal in the free parameters: free the bound whose scaled multiplier violates its
            // sign most
            let mut worst = 0.0;
            let mut release = None;
            for i in 0..n {
                if self.free[i] || lower[i] >= upper[i] {
                    continue;
                }
                let slope = self.slope(h, g, i) / h[i * n + i].max(f64::MIN_POSITIVE).sqrt();
                let gain = if self.delta[i] >= upper[i] { -slope } else { slope };
                if gain > worst {
                    worst = gain;
                    release = Some(i);
                }
            }
            let Some(i) = release else { break };
            self.free[i] = true;
        }
    }

    /// −∂cost/∂δ_i.
    fn slope(&self, h: &[f64], g: &[f64], i: usize) -> f64 {
        let n = g.len();
        g[i] - dot(&h[i * n..(i + 1) * n], &self.delta)
    }

    fn rhs_of(&self, parameter: usize) -> f64 {
        self.index
            .iter()
            .position(|&i| i == parameter)
            .map_or(0.0, |k| self.rhs[k])
    }

    /// rhs ← H_FF⁻¹ (g − H δ)_F, F the free parameters.
    fn solve_free(&mut self, h: &[f64], g: &[f64]) {
        let n = g.len();
        self.index.clear();
        self.index.extend((0..n).filter(|&i| self.free[i]));
        let m = self.index.len();
        for a in 0..m {
            let i = self.index[a];
            self.rhs[a] = self.slope(h, g, i);
            for b in 0..m {
                self.matrix[a * m + b] = h[i * n + self.index[b]];
            }
        }
        if self.cholesky.factor(m, &self.matrix) {
            self.cholesky.solve(&mut self.rhs[..m]);
            return;
        }
        // pseudo-inverse of the scaled matrix
        for a in 0..m {
            let d = self.matrix[a * m + a];
            self.scale[a] = if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 };
        }
        for a in 0..m {
            self.rhs[a] *= self.scale[a];
            for b in 0..m {
                self.matrix[a * m + b] *= self.scale[a] * self.scale[b];
            }
        }
        self.eigen.decompose(m, &self.matrix);
        let largest = self.eigen.values[..m].iter().fold(0.0, |a: f64, &b| a.max(b));
        for k in 0..m {
            let value = self.eigen.values[k];
            let mut c = 0.0;
            if value > 10.0 * RANK_TOLERANCE * largest {
                c = (0..m).map(|a| self.eigen.vectors[a * m + k] * self.rhs[a]).sum::<f64>() / value;
            }
            self.matrix[k] = c;
        }
        for a in 0..m {
            self.rhs[a] = self.scale[a]
                * (0..m)
                    .map(|k| self.eigen.vectors[a * m + k] * self.matrix[k])
                    .sum::<f64>();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FREE: [f64; 3] = [f64::INFINITY; 3];

    #[test]
    fn val_without_bounds_the_step_is_newtons() {
        let h = [4.0, 1.0, 0.0, 1.0, 3.0, -1.0, 0.0, -1.0, 5.0];
        let want = [1.0, -2.0, 0.5];
        let g: Vec<f64> = (0..3).map(|i| (0..3).map(|j| h[i * 3 + j] * want[j]).sum()).collect();
        let mut step = ConstrainedStep::new(3);
        step.solve(&h, &g, &FREE.map(|v| -v), &FREE);
        for (got, want) in step.delta().iter().zip(want) {
            assert!((got - want).abs() < 1e-14);
        }
    }

    #[test]
    fn fault_a_singular_problem_moves_only_where_there_is_information() {
        // rank one along (1, 2), and a third parameter without any information
        let h = [1.0, 2.0, 0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 0.0];
        let mut step = ConstrainedStep::new(3);
        step.solve(&h, &[3.0, 6.0, 0.0], &FREE.map(|v| -v), &FREE);
        let d = step.delta();
        assert!(
            (d[0] + 2.0 * d[1] - 3.0).abs() < 1e-13,
            "the informed combination is met: {d:?}"
        );
        assert_eq!(d[2], 0.0);
    }

    proptest! {
        #[test]
        fn prop_the_step_satisfies_the_optimality_conditions(
            a in prop::collection::vec(-1.0..1.0f64, 16),
            g in prop::collection::vec(-3.0..3.0f64, 4),
            lower in prop::collection::vec(-1.0..0.0f64, 4),
            upper in prop::collection::vec(0.0..1.0f64, 4),
        ) {
            let n = 4;
            let mut h = vec![0.0; n * n];
            for i in 0..n {
                for j in 0..n {
                    h[i * n + j] = (0..n).map(|k| a[i * n + k] * a[j * n + k]).sum::<f64>() + if i == j { 0.1 } else { 0.0 };
                }
            }
            let mut step = ConstrainedStep::new(n);
            step.solve(&h, &g, &lower, &upper);
            for i in 0..n {
                let d = step.delta()[i];
                let slope = step.slope(&h, &g, i);
                prop_assert!(d >= lower[i] && d <= upper[i]);
                // H has eigenvalues of at least 0.1, so rounding of slopes below 10 stays below
                // 1e-12
                if d > lower[i] && d < upper[i] {
                    prop_assert!(slope.abs() < 1e-12, "slope {slope} in a free parameter");
                } else if d == upper[i] && lower[i] < upper[i] {
                    prop_assert!(slope > -1e-12);
                } else if d == lower[i] && lower[i] < upper[i] {
                    prop_assert!(slope < 1e-12);
                }
            }
        }
    }
}
