//! Dense kernels for the small symmetric problems of the estimators, on slices, without allocation.
//!
//! Matrices are n × n, row-major. A symmetric matrix is always stored in full. Factoring is
//! column-scaled: with D = diag(1/√a_ii) the matrix D A D has a unit diagonal, so parameters of
//! very different units (jerk times 0.004, velocity times 23) are treated alike. This scaling is
//! nearly optimal (van der Sluis).

/// Scaled pivots below this are rounding, not information: with n ≤
/// [`MAX_PARAMS`](super::MAX_PARAMS) the rounding of a Gram matrix, (n + 1) · 1.1e-16 = 1.4e-14,
/// stays below it.
pub const RANK_TOLERANCE: f64 = 1e-13;

/// xᵀ y, summed in order: the vectors of the estimators are short. `rows/kernel.rs` has one for
/// windows, in eight running sums.
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(a, b)| a * b).sum()
}

/// out ← A x.
pub fn mul_vec(n: usize, a: &[f64], x: &[f64], out: &mut [f64]) {
    for i in 0..n {
        out[i] = dot(&a[i * n..(i + 1) * n], x);
    }
}

/// out ← A B.
pub fn mul(n: usize, a: &[f64], b: &[f64], out: &mut [f64]) {
    for i in 0..n {
        for j in 0..n {
            out[i * n + j] = (0..n).map(|k| a[i * n + k] * b[k * n + j]).sum();
        }
    }
}

/// A S Aᵀ for a positive semidefinite S, computed from S = G Gᵀ.
///
/// Multiplying the three matrices directly loses too many digits: if A maps a direction that S
/// knows to 1e-11 of its size onto an undetermined one, as after a block in which a joint stood
/// still, rounding leaves negative variances. (A G)(A G)ᵀ has none, and its error is that of G,
/// which is small beside S in every direction.
#[derive(Debug, Clone)]
pub struct Congruence {
    factor: Vec<f64>,
    product: Vec<f64>,
    scale: Vec<f64>,
    order: Vec<usize>,
}

impl Congruence {
    /// Workspace for n × n matrices.
    pub fn new(n: usize) -> Self {
        Self {
            factor: vec![0.0; n * n],
            product: vec![0.0; n * n],
            scale: vec![0.0; n],
            order: vec![0; n],
        }
    }

    /// out ← A S Aᵀ, symmetric by construction.
    pub fn apply(&mut self, n: usize, a: &[f64], s: &[f64], out: &mut [f64]) {
        let rank = self.split(n, s);
        for i in 0..n {
            for k in 0..rank {
                self.product[i * n + k] = (0..n).map(|j| a[i * n + j] * self.factor[j * n + k]).sum();
            }
        }
        for i in 0..n {
            for j in 0..=i {
                let v = dot(&self.product[i * n..i * n + rank], &self.product[j * n..j * n + rank]);
                out[i * n + j] = v;
                out[j * n + i] = v;
            }
        }
    }

    /// G of S = G Gᵀ: Cholesky's method with column scaling and complete pivoting, which ends when
    /// only rounding is left. Returns the number of its columns.
    fn split(&mut self, n: usize, s: &[f64]) -> usize {
        for i in 0..n {
            self.scale[i] = s[i * n + i].max(0.0).sqrt();
            self.order[i] = i;
        }
        self.factor[..n * n].fill(0.0);
        for k in 0..n {
            // the remainder of the unit diagonal
            let rest = |i: usize| -> f64 {
                let row = &self.factor[i * n..i * n + k];
                if self.scale[i] > 0.0 { 1.0 - dot(row, row) } else { 0.0 }
            };
            let mut best = k;
            for at in k + 1..n {
                if rest(self.order[at]) > rest(self.order[best]) {
                    best = at;
                }
            }
            self.order.swap(k, best);
            let pivot = self.order[k];
            let left = rest(pivot);
            if !(left > n as f64 * f64::EPSILON) {
                self.unscale(n);
                return k;
            }
            let root = left.sqrt();
            for at in k..n {
                let i = self.order[at];
                if self.scale[i] == 0.0 {
                    continue;
                }
                let v = if at == k {
                    root
                } else {
                    let done = dot(&self.factor[i * n..i * n + k], &self.factor[pivot * n..pivot * n + k]);
                    (s[i * n + pivot] / (self.scale[i] * self.scale[pivot]) - done) / root
                };
                self.factor[i * n + k] = v;
            }
        }
        self.unscale(n);
        n
    }

    fn unscale(&mut self, n: usize) {
        for i in 0..n {
            self.factor[i * n..(i + 1) * n]
                .iter_mut()
                .for_each(|v| *v *= self.scale[i]);
        }
    }
}

/// Copies the rows and columns of `a` that are not `dropped` to the head of `out`; returns their
/// number.
pub fn gather(n: usize, a: &[f64], dropped: &[bool], out: &mut [f64]) -> usize {
    let mut at = 0;
    for i in (0..n).filter(|&i| !dropped[i]) {
        for j in (0..n).filter(|&j| !dropped[j]) {
            out[at] = a[i * n + j];
            at += 1;
        }
    }
    dropped[..n].iter().filter(|&&d| !d).count()
}

/// The reverse of [`gather`]: the rest of `out` becomes zero.
pub fn scatter(n: usize, a: &[f64], dropped: &[bool], out: &mut [f64]) {
    out[..n * n].fill(0.0);
    let mut at = 0;
    for i in (0..n).filter(|&i| !dropped[i]) {
        for j in (0..n).filter(|&j| !dropped[j]) {
            out[i * n + j] = a[at];
            at += 1;
        }
    }
}

/// Lower Cholesky factor with column scaling of a symmetric positive (semi)definite matrix.
#[derive(Debug, Clone)]
pub struct Cholesky {
    n: usize,
    lower: Vec<f64>,
    scale: Vec<f64>,
    smallest_pivot: f64,
}

impl Cholesky {
    /// Workspace for matrices up to n × n.
    pub fn new(n: usize) -> Self {
        Self {
            n,
            lower: vec![0.0; n * n],
            scale: vec![0.0; n],
            smallest_pivot: 0.0,
        }
    }

    /// Factors the leading n × n problem `a`; false if it is not positive definite beyond
    /// rounding.
    pub fn factor(&mut self, n: usize, a: &[f64]) -> bool {
        self.n = n;
        self.smallest_pivot = f64::INFINITY;
        for i in 0..n {
            let d = a[i * n + i];
            if !(d > 0.0 && d.is_finite()) {
                self.smallest_pivot = 0.0;
                return false;
            }
            self.scale[i] = 1.0 / d.sqrt();
        }
        for i in 0..n {
            for j in 0..=i {
                let mut v = a[i * n + j] * self.scale[i] * self.scale[j];
                v -= dot(&self.lower[i * n..i * n + j], &self.lower[j * n..j * n + j]);
                if i == j {
                    self.smallest_pivot = self.smallest_pivot.min(v);
                    // NaN fails, too
                    if !(v > RANK_TOLERANCE) {
                        return false;
                    }
                    self.lower[i * n + i] = v.sqrt();
                } else {
                    self.lower[i * n + j] = v / self.lower[j * n + j];
                }
            }
        }
        true
    }

    /// ln det A of the matrix factored last.
    #[cfg(feature = "robot")]
    pub fn log_determinant(&self) -> f64 {
        let n = self.n;
        (0..n).map(|i| 2.0 * (self.lower[i * n + i] / self.scale[i]).ln()).sum()
    }

    /// x ← F⁻¹ x with A = F Fᵀ: half of [`solve`](Self::solve), so that yᵀ A⁻¹ x is the product of
    /// two halves.
    pub fn solve_half(&self, x: &mut [f64]) {
        let n = self.n;
        for i in 0..n {
            let v = x[i] * self.scale[i] - dot(&self.lower[i * n..i * n + i], &x[..i]);
            x[i] = v / self.lower[i * n + i];
        }
    }

    /// x ← A⁻¹ x.
    pub fn solve(&self, x: &mut [f64]) {
        let n = self.n;
        self.solve_half(x);
        for i in (0..n).rev() {
            let mut v = x[i];
            for k in i + 1..n {
                v -= self.lower[k * n + i] * x[k];
            }
            x[i] = v / self.lower[i * n + i];
        }
        for i in 0..n {
            x[i] *= self.scale[i];
        }
    }

    /// out ← A⁻¹ = D L⁻ᵀ L⁻¹ D, symmetric by construction. Takes a third of the time of solving for
    /// each column of the unit matrix.
    pub fn inverse(&self, out: &mut [f64]) {
        let n = self.n;
        // L⁻¹, its columns as the rows of the upper triangle: L (L⁻¹)_j = e_j
        for j in 0..n {
            for i in j..n {
                let unit = if i == j { 1.0 } else { 0.0 };
                let done = dot(&self.lower[i * n + j..i * n + i], &out[j * n + j..j * n + i]);
                out[j * n + i] = (unit - done) / self.lower[i * n + i];
            }
        }
        // products of its columns into the lower triangle; the diagonal entry comes last, because
        // no later row needs the old value
        for i in 0..n {
            for j in 0..=i {
                let v = dot(&out[i * n + i..(i + 1) * n], &out[j * n + i..(j + 1) * n]);
                out[i * n + j] = v * self.scale[i] * self.scale[j];
            }
        }
        for i in 0..n {
            for j in 0..i {
                out[j * n + i] = out[i * n + j];
            }
        }
    }
}

/// Eigenvalues and eigenvectors of a symmetric matrix by cyclic Jacobi rotations: slow for large n,
/// exact to rounding, and without allocation.
#[derive(Debug, Clone)]
pub struct Eigen {
    /// Eigenvalues, unordered.
    pub values: Vec<f64>,
    /// Eigenvectors: column k of the row-major matrix belongs to `values[k]`.
    pub vectors: Vec<f64>,
    work: Vec<f64>,
}

impl Eigen {
    /// Workspace for matrices up to n × n.
    pub fn new(n: usize) -> Self {
        Self {
            values: vec![0.0; n],
            vectors: vec![0.0; n * n],
            work: vec![0.0; n * n],
        }
    }

    /// Decomposes the n × n matrix `a`. A matrix that is not finite gives eigenvalues that are not
    /// finite.
    pub fn decompose(&mut self, n: usize, a: &[f64]) {
        let w = &mut self.work[..n * n];
        let v = &mut self.vectors[..n * n];
        w.copy_from_slice(&a[..n * n]);
        v.fill(0.0);
        for i in 0..n {
            v[i * n + i] = 1.0;
        }
        // quadratic convergence: 6 to 10 sweeps reach rounding
        for _ in 0..30 {
            let mut off = 0.0;
            let mut diagonal = 0.0;
            for i in 0..n {
                diagonal += w[i * n + i] * w[i * n + i];
                for j in 0..i {
                    off += w[i * n + j] * w[i * n + j];
                }
            }
            // NaN ends the loop, too
            if !(off > 1e-34 * diagonal) {
                break;
            }
            for p in 0..n {
                for q in p + 1..n {
                    let apq = w[p * n + q];
                    if apq == 0.0 {
                        continue;
                    }
                    let tau = (w[q * n + q] - w[p * n + p]) / (2.0 * apq);
                    let t = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
                    let c = 1.0 / (1.0 + t * t).sqrt();
                    let s = t * c;
                    for k in 0..n {
                        let (x, y) = (w[k * n + p], w[k * n + q]);
                        w[k * n + p] = c * x - s * y;
                        w[k * n + q] = s * x + c * y;
                    }
                    for k in 0..n {
                        let (x, y) = (w[p * n + k], w[q * n + k]);
                        w[p * n + k] = c * x - s * y;
                        w[q * n + k] = s * x + c * y;
                    }
                    // 0 but for rounding, which would keep the sweeps from ending
                    (w[p * n + q], w[q * n + p]) = (0.0, 0.0);
                    for k in 0..n {
                        let (x, y) = (v[k * n + p], v[k * n + q]);
                        v[k * n + p] = c * x - s * y;
                        v[k * n + q] = s * x + c * y;
                    }
                }
            }
        }
        for i in 0..n {
            self.values[i] = w[i * n + i];
        }
    }

    /// out ← V f(values) Vᵀ, symmetric by construction.
    pub fn rebuild(&self, n: usize, out: &mut [f64], f: impl Fn(f64) -> f64) {
        for i in 0..n {
            for j in 0..=i {
                let v: f64 = (0..n)
                    .map(|k| self.vectors[i * n + k] * f(self.values[k]) * self.vectors[j * n + k])
                    .sum();
                out[i * n + j] = v;
                out[j * n + i] = v;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // a matrix with the spread of units of the arm: entries from 1e-6 to 1e9
    fn spread() -> Vec<f64> {
        let s = [1e-3, 3e4, 1.0];
        let c = [[1.0, 0.5, 0.2], [0.5, 1.0, -0.3], [0.2, -0.3, 1.0]];
        (0..9).map(|k| c[k / 3][k % 3] * s[k / 3] * s[k % 3]).collect()
    }

    #[test]
    fn val_cholesky_solves_a_badly_scaled_problem() {
        let a = spread();
        let mut factor = Cholesky::new(3);
        assert!(factor.factor(3, &a));
        let x = [2e3, -1.0 / 3e4, 0.7]; // each of the size of its unit
        let mut b = [0.0; 3];
        mul_vec(3, &a, &x, &mut b);
        factor.solve(&mut b);
        for (got, want) in b.iter().zip(x) {
            // the scaled matrix has a condition number below 10
            assert!((got - want).abs() <= 1e-13 * want.abs(), "{got} {want}");
        }
    }

    #[test]
    fn val_eigen_rebuilds_the_matrix() {
        let a = [4.0, 1.0, -2.0, 1.0, 2.0, 0.5, -2.0, 0.5, 3.0];
        let mut eigen = Eigen::new(3);
        eigen.decompose(3, &a);
        for i in 0..3 {
            for j in 0..3 {
                let v: f64 = (0..3)
                    .map(|k| eigen.vectors[i * 3 + k] * eigen.values[k] * eigen.vectors[j * 3 + k])
                    .sum();
                assert!((v - a[i * 3 + j]).abs() < 1e-14, "{i} {j} {v}");
            }
        }
    }

    #[test]
    fn fault_cholesky_refuses_what_is_not_positive_definite() {
        let mut factor = Cholesky::new(2);
        assert!(!factor.factor(2, &[1.0, 1.0, 1.0, 1.0]));
        assert!(!factor.factor(2, &[1.0, 0.0, 0.0, 0.0]));
        assert!(!factor.factor(2, &[1.0, f64::NAN, f64::NAN, 1.0]));
    }
}
