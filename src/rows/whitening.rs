//! Whitening of overlapping rows: r ← L⁻¹ r with R = L Lᵀ the covariance of their noise.
//!
//! Neighbouring windows share samples, so the noise of their rows is correlated; a least-squares
//! fit that assumes independence reports standard deviations that are too small. R is banded,
//! because windows that do not overlap share no samples, and known at least up to scale, like the
//! sensors' noise.
//!
//! Forward whitening makes row i of windows 0..=i, backward whitening of windows i..n (R = Uᵀ-type
//! factor of the reversed order); rᵀR⁻¹r is the same. Sums over the start of a block need the
//! former; the latter serves sums over its end, and so every fit.

/// Columns whitened in parallel.
const LANES: usize = 4;

/// Symmetric banded matrix, and its two factors.
#[derive(Debug, Clone)]
pub(super) struct Whitening {
    bandwidth: usize,
    rows: usize,
    /// R_{i, i−lag} at i (bandwidth + 1) + lag.
    band: Vec<f64>,
    forward: Vec<f64>,
    backward: Vec<f64>,
    /// Whether each row is left out, and whether any is.
    excluded: Vec<bool>,
    any_excluded: bool,
    /// Scratch: interleaved columns; R⁻¹ within the band, and one column of L with sums.
    beside: Vec<[f64; LANES]>,
    inverse: Vec<f64>,
    below: Vec<(f64, f64)>,
}

/// Which way the whitening runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    Forward,
    Backward,
}

impl Direction {
    /// Both, in the order of their numbers.
    pub const BOTH: [Self; 2] = [Self::Forward, Self::Backward];
}

impl Whitening {
    /// Workspace for `capacity` rows that correlate over at most `bandwidth` neighbours.
    pub fn new(capacity: usize, bandwidth: usize) -> Self {
        let room = capacity * (bandwidth + 1);
        Self {
            bandwidth,
            rows: 0,
            band: vec![0.0; room],
            forward: vec![0.0; room],
            backward: vec![0.0; room],
            excluded: vec![false; capacity],
            any_excluded: false,
            beside: vec![[0.0; LANES]; capacity],
            inverse: vec![0.0; room],
            below: vec![(0.0, 0.0); bandwidth + 1],
        }
    }

    /// Begins a matrix of `rows` rows, all zero.
    pub fn begin(&mut self, rows: usize) {
        self.rows = rows;
        self.band[..rows * (self.bandwidth + 1)].fill(0.0);
        self.excluded.fill(false);
        self.any_excluded = false;
    }

    /// Leaves a row out, after its entries were added and before [`factor`](Self::factor): the
    /// others are whitened as if it did not exist, and it becomes 0.
    pub fn exclude(&mut self, row: usize) {
        let width = self.bandwidth + 1;
        self.band[row * width..(row + 1) * width].fill(0.0);
        self.band[row * width] = 1.0;
        for lag in 1..width.min(self.rows - row) {
            self.band[(row + lag) * width + lag] = 0.0;
        }
        self.excluded[row] = true;
        self.any_excluded = true;
    }

    /// Adds to R_{i, i−lag}; ignored beyond the band.
    #[inline]
    pub fn add(&mut self, i: usize, lag: usize, value: f64) {
        if lag <= self.bandwidth && lag <= i {
            self.band[i * (self.bandwidth + 1) + lag] += value;
        }
    }

    /// R_ii; infinite for a row that is left out.
    pub fn variance(&self, i: usize) -> f64 {
        if self.excluded[i] {
            f64::INFINITY
        } else {
            self.band[i * (self.bandwidth + 1)]
        }
    }

    /// Factors R in both directions. If it is not positive definite, only its diagonal is used; a
    /// row without noise stays unchanged.
    pub fn factor(&mut self) {
        let (n, width) = (self.rows, self.bandwidth + 1);
        let forward = |i: usize, lag: usize| self.band[i * width + lag];
        // pair (i, i + lag) of the reversed order
        let backward = |i: usize, lag: usize| self.band[(n - 1 - i + lag) * width + lag];
        if !(cholesky(n, self.bandwidth, forward, &mut self.forward)
            && cholesky(n, self.bandwidth, backward, &mut self.backward))
        {
            let diagonal = |target: &mut Vec<f64>, at: &dyn Fn(usize) -> f64| {
                target[..n * width].fill(0.0);
                for i in 0..n {
                    let variance = at(i);
                    target[i * width] = if variance > 0.0 && variance.is_finite() {
                        variance.sqrt()
                    } else {
                        1.0
                    };
                }
            };
            let band = &self.band;
            diagonal(&mut self.forward, &|i| band[i * width]);
            diagonal(&mut self.backward, &|i| band[(n - 1 - i) * width]);
        }
    }

    /// Whitens a column of `rows` values in place.
    pub fn apply(&self, direction: Direction, column: &mut [f64]) {
        if self.any_excluded {
            for (value, _) in column.iter_mut().zip(&self.excluded).filter(|(_, out)| **out) {
                *value = 0.0;
            }
        }
        let (column, _) = column.as_chunks_mut::<1>();
        match direction {
            Direction::Forward => substitute(&self.forward, self.bandwidth, column),
            Direction::Backward => {
                column.reverse();
                substitute(&self.backward, self.bandwidth, column);
                column.reverse();
            }
        }
    }

    /// Whitens columns of `rows` values in place, several at a time: within a column each value
    /// depends on the one before, so several columns together take hardly longer.
    pub fn apply_all<'a>(&mut self, direction: Direction, mut columns: impl Iterator<Item = &'a mut [f64]>) {
        let rows = &mut self.beside[..self.rows];
        loop {
            let mut group: [&mut [f64]; LANES] = std::array::from_fn(|_| columns.next().unwrap_or_default());
            if group[0].is_empty() {
                return;
            }
            rows.fill([0.0; LANES]);
            for (lane, column) in group.iter().enumerate() {
                let put = |(row, value): (&mut [f64; LANES], &f64)| row[lane] = *value;
                rows.iter_mut().zip(column.iter()).for_each(put);
            }
            for (row, _) in rows.iter_mut().zip(&self.excluded).filter(|(_, out)| **out) {
                *row = [0.0; LANES];
            }
            match direction {
                Direction::Forward => substitute(&self.forward, self.bandwidth, rows),
                Direction::Backward => {
                    rows.reverse();
                    substitute(&self.backward, self.bandwidth, rows);
                    rows.reverse();
                }
            }
            for (lane, column) in group.iter_mut().enumerate() {
                column
                    .iter_mut()
                    .zip(rows.iter())
                    .for_each(|(value, row)| *value = row[lane]);
            }
        }
    }

    /// tr(R⁻¹ B) over the rows that are not left out, with `entry`(i, j) = B_ij = B_ji for j ≤ i, 0
    /// beyond the band. R⁻¹ = Z within the band follows from L alone (K. Takahashi 1973):
    ///
    /// ```text
    /// Z_ij = −Σ_{k>j} Z_ik L_kj / L_jj,   Z_jj = 1/L_jj² − Σ_{k>j} Z_kj L_kj / L_jj
    /// ```
    pub fn trace_of_inverse(&mut self, entry: impl Fn(usize, usize) -> f64) -> f64 {
        let (n, width) = (self.rows, self.bandwidth + 1);
        let mut trace = 0.0;
        for j in (0..n).rev() {
            let inverse = 1.0 / self.forward[j * width];
            let below = &mut self.below[..width.min(n - j)];
            for (lag, (l, sum)) in below.iter_mut().enumerate() {
                (*l, *sum) = (self.forward[(j + lag) * width + lag], 0.0);
            }
            // Σ_k Z_ik L_kj of all i together, from one half of Z
            for i in 1..below.len() {
                let row = &self.inverse[(j + i) * width..(j + i) * width + i];
                let (before, own) = below.split_at_mut(i);
                let (l_i, sum_i) = &mut own[0];
                *sum_i += row[0] * *l_i;
                for ((l, sum), z) in before[1..].iter_mut().zip(row[1..].iter().rev()) {
                    *sum += z * *l_i;
                    *sum_i += z * *l;
                }
            }
            let mut pivot = inverse;
            for (lag, (l, sum)) in below.iter().enumerate().skip(1) {
                let z = -sum * inverse;
                self.inverse[(j + lag) * width + lag] = z;
                pivot -= z * l;
                if !self.excluded[j] && !self.excluded[j + lag] {
                    trace += 2.0 * z * entry(j + lag, j);
                }
            }
            self.inverse[j * width] = pivot * inverse;
            if !self.excluded[j] {
                trace += pivot * inverse * entry(j, j);
            }
        }
        trace
    }

    /// Turns a column that was whitened forwards, L⁻¹ x, into R⁻¹ x = L⁻ᵀ L⁻¹ x, in place.
    pub fn apply_transposed(&self, column: &mut [f64]) {
        let (n, width) = (self.rows, self.bandwidth + 1);
        for i in (0..n).rev() {
            let l = &self.forward[i * width..(i + 1) * width];
            let v = column[i] / l[0];
            column[i] = v;
            for lag in 1..width.min(i + 1) {
                column[i - lag] -= l[lag] * v;
            }
        }
    }
}

/// x ← L⁻¹ x for N interleaved columns.
#[inline]
fn substitute<const N: usize>(factor: &[f64], bandwidth: usize, x: &mut [[f64; N]]) {
    for (i, l) in (0..x.len()).zip(factor.chunks_exact(bandwidth + 1)) {
        let (done, rest) = x.split_at_mut(i);
        let mut v = rest[0];
        for (l, x) in l[1..].iter().zip(done.iter().rev()) {
            for lane in 0..N {
                v[lane] -= l * x[lane];
            }
        }
        rest[0] = v.map(|v| v / l[0]);
    }
}

/// Banded Cholesky factor; false if a pivot is not positive beyond rounding.
fn cholesky(n: usize, bandwidth: usize, matrix: impl Fn(usize, usize) -> f64, factor: &mut [f64]) -> bool {
    let width = bandwidth + 1;
    for i in 0..n {
        let (done, rest) = factor.split_at_mut(i * width);
        let row = &mut rest[..width];
        for lag in (1..=bandwidth.min(i)).rev() {
            let j = i - lag;
            let other = &done[j * width..i * width];
            // Σ_k L_ik L_jk over the k < j that both reach
            let both = (bandwidth - lag).min(j);
            let products = row[lag + 1..=lag + both].iter().zip(&other[1..=both]);
            let v = products.rev().fold(matrix(i, lag), |v, (a, b)| v - a * b);
            row[lag] = v / other[0];
        }
        let own = matrix(i, 0);
        let v = row[1..=bandwidth.min(i)].iter().rev().fold(own, |v, l| v - l * l);
        if !(v > 1e-13 * own) {
            return false;
        }
        row[0] = v.sqrt();
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_both_directions_give_the_generalised_sum_of_squares() {
        let n = 12;
        let mut whitening = Whitening::new(n, 3);
        whitening.begin(n);
        let r = |i: usize, j: usize| match i.abs_diff(j) {
            0 => 2.0 + 0.1 * i as f64,
            1 => -0.7,
            2 => 0.3,
            3 => 0.1,
            _ => 0.0,
        };
        for i in 0..n {
            for lag in 0..=3.min(i) {
                whitening.add(i, lag, r(i, i - lag));
            }
        }
        whitening.factor();
        let x: Vec<f64> = (0..n).map(|i| (i as f64 * 1.3).sin()).collect();
        let matrix = nalgebra::DMatrix::from_fn(n, n, r);
        let vector = nalgebra::DVector::from_column_slice(&x);
        let wanted = vector.dot(&matrix.clone().lu().solve(&vector).unwrap());
        for direction in Direction::BOTH {
            let mut y = x.clone();
            whitening.apply(direction, &mut y);
            let sum: f64 = y.iter().map(|v| v * v).sum();
            // a dozen rows of a well-conditioned matrix
            assert!((sum / wanted - 1.0).abs() < 1e-13, "{direction:?}");
            // more columns than lanes
            let mut columns: Vec<Vec<f64>> = (0..6).map(|k| x.iter().map(|v| v * f64::from(k)).collect()).collect();
            whitening.apply_all(direction, columns.iter_mut().map(Vec::as_mut_slice));
            for (k, column) in columns.iter().enumerate() {
                let mut alone: Vec<f64> = x.iter().map(|v| v * k as f64).collect();
                whitening.apply(direction, &mut alone);
                assert_eq!(*column, alone, "{direction:?} {k}");
            }
        }
        let other = |i: usize, j: usize| r(i, j) * (1.0 + 0.1 * (i + j) as f64);
        let wanted = matrix
            .try_inverse()
            .unwrap()
            .component_mul(&nalgebra::DMatrix::from_fn(n, n, other))
            .sum();
        // rounding of a few hundred products, ten times as far as above because terms cancel
        assert!((whitening.trace_of_inverse(other) / wanted - 1.0).abs() < 1e-12);
        // a change of the last value changes only the last forward row, and no backward row but all
        // before it
        let mut changed = x.clone();
        changed[n - 1] += 1.0;
        let (mut a, mut b) = (x, changed);
        whitening.apply(Direction::Forward, &mut a);
        whitening.apply(Direction::Forward, &mut b);
        assert_eq!(a[..n - 1], b[..n - 1]);
    }

    #[test]
    fn prop_rows_that_are_left_out_might_as_well_not_exist() {
        let (n, out) = (9, [0usize, 3, 4]);
        let r = |i: usize, j: usize| [2.0, -0.7, 0.3].get(i.abs_diff(j)).copied().unwrap_or(0.0);
        let mut whitening = Whitening::new(n, 2);
        whitening.begin(n);
        for i in 0..n {
            for lag in 0..=2.min(i) {
                whitening.add(i, lag, r(i, i - lag));
            }
        }
        out.iter().for_each(|&row| whitening.exclude(row));
        whitening.factor();
        let x: Vec<f64> = (0..n).map(|i| (i as f64 * 1.3).sin()).collect();
        let kept: Vec<usize> = (0..n).filter(|i| !out.contains(i)).collect();
        let matrix = nalgebra::DMatrix::from_fn(kept.len(), kept.len(), |i, j| r(kept[i], kept[j]));
        let trace = matrix.clone().try_inverse().unwrap().component_mul(&matrix).sum();
        // as above
        assert!((whitening.trace_of_inverse(r) / trace - 1.0).abs() < 1e-12);
        let vector = nalgebra::DVector::from_fn(kept.len(), |i, _| x[kept[i]]);
        let wanted = vector.dot(&matrix.lu().solve(&vector).unwrap());
        for direction in Direction::BOTH {
            let mut y = x.clone();
            whitening.apply(direction, &mut y);
            assert!(out.iter().all(|&row| y[row] == 0.0));
            let sum: f64 = y.iter().map(|v| v * v).sum();
            // a handful of rows of a well-conditioned matrix
            assert!((sum / wanted - 1.0).abs() < 1e-13, "{direction:?}");
        }
    }

    #[test]
    fn fault_a_matrix_that_is_not_positive_definite_falls_back_to_its_diagonal() {
        let mut whitening = Whitening::new(2, 1);
        whitening.begin(2);
        whitening.add(0, 0, 4.0);
        whitening.add(1, 0, 0.0);
        whitening.add(1, 1, 9.0);
        whitening.factor();
        let mut column = [2.0, 5.0];
        whitening.apply(Direction::Forward, &mut column);
        assert_eq!(column, [1.0, 5.0]);
    }
}
