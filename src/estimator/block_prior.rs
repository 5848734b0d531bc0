//! What is known of a group before its block: Λ around θ̄, in the coordinates of `curvature.rs`.
//!
//! ```text
//! dᵀ Λ d = (θ − θ̄)ᵀ Λ (θ − θ̄)      if the rows contain no products of parameters
//! ```
//!
//! Every θ here is that of the group.

use super::curvature::Curvature;
use super::forgetting::Excitation;
use super::information::Information;
use super::linalg::{dot, mul_vec};
use super::workspace::Workspace;

/// The prior of the present fit.
#[derive(Debug, Clone)]
pub struct BlockPrior {
    n: usize,
    /// Λ, n × n.
    information: Vec<f64>,
    /// θ̄.
    centre: Vec<f64>,
    /// The coordinates in which Λ holds around θ̄.
    pub curvature: Curvature,
}

impl BlockPrior {
    /// Nothing is known of n parameters.
    pub fn new(n: usize) -> Self {
        Self {
            n,
            information: vec![0.0; n * n],
            centre: vec![0.0; n],
            curvature: Curvature::new(n),
        }
    }

    /// θ̄.
    pub fn centre(&self) -> &[f64] {
        &self.centre
    }

    /// Λ, n × n.
    pub fn information(&self) -> &[f64] {
        &self.information
    }

    /// Moves θ̄ to `theta`, with the same Λ.
    pub fn centre_at(&mut self, theta: &[f64]) {
        self.centre.copy_from_slice(theta);
    }

    /// Λ as forgetting makes it from Γ⁻¹.
    pub fn forget(&mut self, information: &mut Information, excitation: &Excitation) {
        information.carry(excitation, &mut self.information);
    }

    /// A weak Λ, for a fit to the rows alone: 100 % of each parameter, where `variance` is σ².
    pub fn weaken(&mut self, variance: f64) {
        self.information.fill(0.0);
        for i in 0..self.n {
            let size = self.centre[i].abs();
            let size = if size > 0.0 { size } else { 1.0 };
            self.information[i * self.n + i] = variance / (size * size);
        }
    }

    /// Λ = σ² P⁻¹, where `variance` is σ². A fixed parameter keeps what it has in Γ⁻¹.
    pub fn trust(&mut self, covariance: &[f64], variance: f64, fixed: &[bool], known: &[f64], room: &mut Workspace) {
        self.information.copy_from_slice(covariance);
        room.invert(&mut self.information, fixed);
        self.information.iter_mut().for_each(|v| *v *= variance);
        for i in (0..self.n).filter(|&i| fixed[i]) {
            self.information[i * self.n + i] = known[i * self.n + i];
        }
    }

    /// Λ/σ², where `variance` is σ².
    pub fn divide(&mut self, variance: f64) {
        self.information.iter_mut().for_each(|v| *v /= variance);
    }

    /// dᵀ Λ d, and (e) of `curvature.rs`.
    pub fn cost(&self, theta: &[f64]) -> f64 {
        let n = self.n;
        let d = |i: usize| self.curvature.displacement(i, theta, &self.centre);
        (0..n)
            .map(|i| d(i) * (0..n).map(|j| self.information[i * n + j] * d(j)).sum::<f64>())
            .sum::<f64>()
            + self.curvature.holding_cost(theta)
    }

    /// Writes the quadratic model of the cost at θ: Tᵀ Λ T to `total`, −Tᵀ Λ d to `gradient`.
    pub fn expand(&mut self, theta: &[f64], room: &mut Workspace) {
        self.curvature.turn(theta, &self.centre);
        room.total.copy_from_slice(&self.information);
        self.curvature.turn_information(&mut room.total);
        for i in 0..self.n {
            room.offset[i] = -self.curvature.displacement(i, theta, &self.centre);
        }
        mul_vec(self.n, &self.information, &room.offset, &mut room.gradient);
        self.curvature.turn_slope(&mut room.gradient);
        self.curvature.add_holding(theta, &mut room.total, &mut room.gradient);
    }

    /// Adds A d to the slope in `gradient`, A in `total`, and refers both from θ to θ̄.
    pub fn refer_back(&mut self, theta: &[f64], room: &mut Workspace) {
        let n = self.n;
        self.curvature.turn(theta, &self.centre);
        self.curvature.moved(theta, &self.centre, &mut room.offset);
        for i in 0..n {
            room.gradient[i] += dot(&room.total[i * n..(i + 1) * n], &room.offset);
        }
        self.curvature.turn_information_back(&mut room.total);
        self.curvature.turn_slope_back(&mut room.gradient);
    }

    /// Refers Λ at θ̄ to θ: (d) of `curvature.rs`. False if that changes nothing.
    pub fn turn(&mut self, theta: &[f64]) -> bool {
        if self.curvature.is_flat() {
            return false;
        }
        self.curvature.turn(theta, &self.centre);
        self.curvature.turn_information(&mut self.information);
        true
    }

    /// Writes how far θ is from θ̄ to `moved`, in the coordinates around θ; after
    /// [`turn`](Self::turn).
    pub fn moved(&self, theta: &[f64], moved: &mut [f64]) {
        self.curvature.moved(theta, &self.centre, moved);
    }
}
