//! Checks whether the estimates of separate blocks agree as well as σ says, and widens σ if they do
//! not.
//!
//! ```text
//! d_m   = the move of θ̂ by a Kalman step in block m,   Var d_m = V_m from P and the block's information
//! t     = d_i/√V_ii                       N(0, 1) for each parameter i if the assumed noise is right
//! κ_i   = π/2 (Σ w |t|/Σ w)²              w: the share of a parameter's size that the block informs on
//! b_i   = Σ ρ^k d_i / Σ ρ^k g_i           g = V_ii/P_ii, the share of the way from θ̂ to what the block says
//! P_ij  ← √(κ_i κ_j) P_ij,  P_ii ← P_ii + b_i²
//! ```
//!
//! Residuals that are correlated over a second (position-dependent friction, a sensor that warms
//! up) make the information too large by up to the number of rows, and the rows of one block cannot
//! show it. Other blocks can: each block is one cluster, and its innovation, taken before the
//! update, needs no correction for the parameters that were fitted to it, unlike J′r r′J of
//! residuals (K.-Y. Liang and S. L. Zeger 1986; R. T. Birge's ratio of 1932 is the same for one
//! parameter). Magnitudes (C. A. F. Peters 1856) give one odd block among a dozen a third of the
//! weight that squares would. A parameter that moves within the memory of λ shows differently: all
//! d_m have the same sign. b_i is how far θ̂ lags behind, its mean over some five blocks.
//!
//! By chance κ differs from 1 and b from 0. P is widened only if they exceed what chance explains:
//! κ by more than four of its own standard deviations if the sensor noise is configured, two if it
//! is learnt from the residuals; b by three and a half. Learnt noise ignores correlation, so two
//! repeats are enough there, and two that agree are added to them.

use super::persist::Visit;

/// Mean of |t|: √(2/π).
const MEAN: f64 = 0.797_884_560_802_865_4;
/// ρ of the lag: five blocks.
const RECENT: f64 = 0.8;
/// Limits on chance, in standard deviations: κ with configured noise, κ with learnt noise, and the
/// lag.
const CHANCE: f64 = 4.0;
const CHANCE_LEARNT: f64 = 2.0;
const LAG: f64 = 3.5;
/// Smallest number of repeats for κ, and the number of agreeing repeats that are added.
const ENOUGH: f64 = 3.0;
const ENOUGH_LEARNT: f64 = 1.5;
const AGREED: f64 = 2.0;
/// Upper limit of the forgetting factor of κ per block.
const MEMORY: f64 = 0.98;

/// Statistics of a group's innovations so far.
#[derive(Debug, Clone)]
pub struct Clusters {
    /// d, V_ii and P_ii of the present block.
    moved: Vec<f64>,
    expected: Vec<f64>,
    known: Vec<f64>,
    pending: bool,
    // Σ w |t|, Σ w, Σ w² per parameter
    magnitude: Vec<f64>,
    weight: Vec<f64>,
    weight_square: Vec<f64>,
    // Σ ρ^k d, Σ ρ^2k V, Σ ρ^k g
    lag: Vec<f64>,
    lag_variance: Vec<f64>,
    lag_gain: Vec<f64>,
    noise_is_configured: bool,
}

impl Clusters {
    /// Workspace for n parameters.
    pub fn new(n: usize) -> Self {
        let zero = vec![0.0; n];
        Self {
            moved: zero.clone(),
            expected: zero.clone(),
            known: zero.clone(),
            pending: false,
            magnitude: zero.clone(),
            weight: zero.clone(),
            weight_square: zero.clone(),
            lag: zero.clone(),
            lag_variance: zero.clone(),
            lag_gain: zero,
            noise_is_configured: true,
        }
    }

    /// State kept from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        for list in [
            &mut self.magnitude,
            &mut self.weight,
            &mut self.weight_square,
            &mut self.lag,
            &mut self.lag_variance,
            &mut self.lag_gain,
        ] {
            v.reals(list);
        }
        v.flag(&mut self.noise_is_configured);
    }

    /// Forgets the statistics of parameter i.
    pub fn forget_parameter(&mut self, i: usize) {
        for list in [&mut self.magnitude, &mut self.weight, &mut self.weight_square] {
            list[i] = 0.0;
        }
        self.forget_lag(i);
    }

    fn forget_lag(&mut self, i: usize) {
        (self.lag[i], self.lag_variance[i], self.lag_gain[i]) = (0.0, 0.0, 0.0);
    }

    /// Begins the innovation of a block.
    pub fn begin(&mut self) {
        self.moved.fill(0.0);
        self.expected.fill(0.0);
        self.known.fill(0.0);
        self.pending = true;
    }

    /// Adds a direction with entries `along`(i), scaled so that P is 1 along it: `b` is the block's
    /// information on it, `c` its score.
    pub fn add(&mut self, b: f64, c: f64, along: impl Fn(usize) -> f64) {
        for i in 0..self.moved.len() {
            let x = along(i);
            self.moved[i] += x * c / (1.0 + b);
            self.expected[i] += x * x * b / (1.0 + b);
            self.known[i] += x * x;
        }
    }

    /// Ends a block. `changed`: the plant changed, so the block is no repeat; `share`: the share of
    /// each parameter's size that it informed on.
    pub fn end(&mut self, changed: bool, noise_is_configured: bool, share: impl Fn(usize) -> f64) {
        self.noise_is_configured = noise_is_configured;
        let pending = std::mem::take(&mut self.pending);
        for i in 0..self.moved.len() {
            if changed {
                self.forget_lag(i);
                continue;
            }
            let (d, v, p) = (self.moved[i], self.expected[i], self.known[i]);
            if !(pending && v > 0.0 && p > 0.0 && d.is_finite()) {
                continue;
            }
            let w = share(i);
            self.magnitude[i] = MEMORY * self.magnitude[i] + w * d.abs() / v.sqrt();
            self.weight[i] = MEMORY * self.weight[i] + w;
            self.weight_square[i] = MEMORY * MEMORY * self.weight_square[i] + w * w;
            self.lag[i] = RECENT * self.lag[i] + d;
            self.lag_variance[i] = RECENT * RECENT * self.lag_variance[i] + v;
            self.lag_gain[i] = RECENT * self.lag_gain[i] + v / p;
        }
    }

    /// κ_i: the factor by which P_ii is too small.
    pub fn ratio(&self, i: usize) -> f64 {
        let (magnitude, weight) = (self.magnitude[i], self.weight[i]);
        if self.weight_square[i] <= 0.0 {
            return 1.0;
        }
        let (chance, enough, agreed) = match self.noise_is_configured {
            true => (CHANCE, ENOUGH, 0.0),
            false => (CHANCE_LEARNT, ENOUGH_LEARNT, AGREED),
        };
        let repeats = weight * weight / self.weight_square[i];
        // the standard deviation of |t| is √(1 − 2/π), 0.756 of its mean
        if repeats >= enough && magnitude / weight / MEAN > 1.0 + chance * 0.756 / repeats.sqrt() {
            ((magnitude + agreed * MEAN) / (weight + agreed) / MEAN).powi(2)
        } else {
            1.0
        }
    }

    /// b_i: how far the estimate lags behind, 0 if chance explains it.
    pub fn lag(&self, i: usize) -> f64 {
        let chance = if self.noise_is_configured { 1.0 } else { self.ratio(i) };
        if self.lag_gain[i] > 0.0 && self.lag[i] * self.lag[i] > LAG * LAG * chance * self.lag_variance[i] {
            self.lag[i] / self.lag_gain[i]
        } else {
            0.0
        }
    }

    /// Widens P by both.
    pub fn widen(&self, covariance: &mut [f64]) {
        let n = self.moved.len();
        for i in 0..n {
            let factor = self.ratio(i).sqrt();
            for j in 0..n {
                covariance[i * n + j] *= factor;
                covariance[j * n + i] *= factor;
            }
        }
        for i in 0..n {
            if covariance[i * n + i] > 0.0 {
                covariance[i * n + i] += self.lag(i).powi(2);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One parameter; each block carries as much information as all before it together.
    fn after(blocks: &[f64], noise_is_configured: bool) -> Clusters {
        let mut clusters = Clusters::new(1);
        for c in blocks {
            clusters.begin();
            // b = 1: Var c = b (1 + b) = 2, P = 1
            clusters.add(1.0, c * 2f64.sqrt(), |_| 1.0);
            clusters.end(false, noise_is_configured, |_| 1.0);
        }
        clusters
    }

    #[test]
    fn prop_repeats_that_agree_leave_sigma_alone_and_others_widen_it() {
        let agreeing = [0.3, -1.2, 1.1, -0.4, 0.9, -1.6, 0.2, -0.7];
        assert_eq!(after(&agreeing, true).ratio(0), 1.0);
        let apart: Vec<f64> = agreeing.iter().map(|c| 10.0 * c).collect();
        let clusters = after(&apart, true);
        // the mean magnitude of the eight is 0.8, so tenfold it is 8 with some per cent for the
        // later ones that count more: κ = 64 π/2
        assert!((90.0..115.0).contains(&clusters.ratio(0)), "{}", clusters.ratio(0));
        let clusters = after(&apart, false);
        assert_eq!(clusters.lag(0), 0.0, "signs alternate, and the noise is learnt");
        let mut covariance = [2.0];
        clusters.widen(&mut covariance);
        assert!((covariance[0] / (2.0 * clusters.ratio(0)) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn prop_one_sign_is_a_lag_of_its_own_size() {
        let clusters = after(&[3.0; 12], true);
        // x̂ = c/(1 + b) = 3 √2/2 with gain ½: the lag is 3 √2
        assert!((clusters.lag(0) / (3.0 * 2f64.sqrt()) - 1.0).abs() < 1e-12);
        let mut quiet = clusters;
        quiet.begin();
        quiet.end(true, true, |_| 1.0);
        assert_eq!(quiet.lag(0), 0.0, "what was before a change says nothing on what comes");
    }
}
