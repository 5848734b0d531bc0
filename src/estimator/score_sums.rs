//! Scores and information of the terms that a model may lack, summed over the blocks: those of one
//! group of equations.
//!
//! ```text
//! U ← λ U + u,  I ← λ I + i                        u, i of a block from considered.rs                         (1)
//! Σ (u − i â)² = Σ u² − 2 â Σ u i + â² Σ i²        scatter of the blocks about one amplitude                  (2)
//! X = max((Σ χ² − explained)/Σ ν, scatter ratio)   how far the residuals exceed the noise                     (3)
//! m = I²/Σ i²                                      number of blocks, if all had the same information          (4)
//! ```

use super::persist::Visit;
use super::summed_rows::SummedScore;
use std::ops::Range;

/// λ per block: a memory of about fifty blocks.
pub const MEMORY: f64 = 0.98;
/// Number of blocks that the scatter needs.
pub const ENOUGH: f64 = 2.5;

/// The evidence of a group in one block.
pub struct GroupEvidence<'a> {
    /// u (one per term) and i (square matrix) of the rows, and the evidence of their sums.
    pub scores: (&'a [f64], &'a [f64], &'a [SummedScore]),
    /// Variance of the noise that they are divided by.
    pub variance: f64,
    /// χ² of the residuals with this noise, and its degrees of freedom.
    pub misfit: f64,
    pub freedom: f64,
    /// True if the variance is not learnt from these residuals.
    pub noise_is_configured: bool,
}

/// Exponentially weighted sums of one term.
#[derive(Debug, Clone, Copy, Default)]
pub struct Term {
    pub score: f64,
    pub information: f64,
    pub score_square: f64,
    score_information: f64,
    information_square: f64,
}

impl Term {
    /// Adds a block.
    pub fn take(&mut self, score: f64, information: f64) {
        let informs = score.is_finite() && information.is_finite() && information > 0.0;
        let (u, i) = if informs { (score, information) } else { (0.0, 0.0) };
        let new = [u, i, u * u, u * i, i * i];
        for (sum, new) in self.sums_mut().into_iter().zip(new) {
            *sum = MEMORY * *sum + new;
        }
    }

    pub fn visit(&mut self, v: &mut impl Visit) {
        self.sums_mut().into_iter().for_each(|number| v.real(number));
    }

    fn sums_mut(&mut self) -> [&mut f64; 5] {
        [
            &mut self.score,
            &mut self.information,
            &mut self.score_square,
            &mut self.score_information,
            &mut self.information_square,
        ]
    }

    /// m. The first block may be four times as long as the others, so a mere count is too large.
    pub fn blocks(&self) -> f64 {
        if self.information > 0.0 {
            self.information * self.information / self.information_square // (4)
        } else {
            0.0
        }
    }

    /// Σ (u − i â)² with one degree of freedom taken by â: its mean is I (1 − 1/m).
    pub fn scatter(&self, amplitude: f64) -> f64 {
        let sum = self.score_square - 2.0 * amplitude * self.score_information
            + amplitude * amplitude * self.information_square;
        let blocks = self.blocks();
        sum * blocks / (blocks - 1.0).max(0.1)
    }
}

/// The sums of a group.
#[derive(Debug, Clone)]
pub struct GroupScores {
    pub terms: Vec<Term>,
    /// I over the blocks, room × room.
    pub information: Vec<f64>,
    /// χ² of the residuals and its degrees of freedom.
    pub misfit: f64,
    pub freedom: f64,
    /// The noise of the last block was specified.
    pub noise_is_configured: bool,
    /// X of (3), and its part that is the scatter ratio.
    pub excess: f64,
    scatter_ratio: f64,
    /// U and I of the block.
    pending: Vec<f64>,
    pending_information: Vec<f64>,
}

impl GroupScores {
    /// Workspace for `room` terms.
    pub fn new(room: usize) -> Self {
        Self {
            terms: vec![Term::default(); room],
            information: vec![0.0; room * room],
            misfit: 0.0,
            freedom: 0.0,
            noise_is_configured: true,
            excess: 1.0,
            scatter_ratio: 1.0,
            pending: vec![0.0; room],
            pending_information: vec![0.0; room * room],
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.terms.fill(Term::default());
        self.information.fill(0.0);
        (self.misfit, self.freedom, self.noise_is_configured) = (0.0, 0.0, true);
    }

    /// What goes from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.terms.iter_mut().for_each(|term| term.visit(v));
        v.reals(&mut self.information);
        v.real(&mut self.misfit);
        v.real(&mut self.freedom);
        v.flag(&mut self.noise_is_configured);
    }

    /// Begins a block.
    pub fn begin(&mut self) {
        self.pending.fill(0.0);
        self.pending_information.fill(0.0);
        self.misfit *= MEMORY;
        self.freedom *= MEMORY;
    }

    /// Takes the evidence of a block.
    pub fn take(&mut self, evidence: &GroupEvidence<'_>) {
        let (scores, information, _) = evidence.scores;
        let divide = |sums: &mut [f64], values: &[f64]| {
            sums.iter_mut()
                .zip(values)
                .for_each(|(sum, v)| *sum = v / evidence.variance);
        };
        divide(&mut self.pending, scores);
        divide(&mut self.pending_information, information);
        self.misfit += evidence.misfit;
        self.freedom += evidence.freedom;
        self.noise_is_configured = evidence.noise_is_configured;
    }

    /// (1).
    pub fn end(&mut self) {
        let room = self.terms.len();
        let mut numbers = self.pending.iter().chain(&self.pending_information);
        if !numbers.all(|v| v.is_finite()) {
            self.pending.fill(0.0);
            self.pending_information.fill(0.0);
        }
        for (sum, i) in self.information.iter_mut().zip(&self.pending_information) {
            *sum = MEMORY * *sum + i; // (1)
        }
        for (s, (term, u)) in self.terms.iter_mut().zip(&self.pending).enumerate() {
            term.take(*u, self.pending_information[s * room + s]);
        }
    }

    /// X before anything is explained; the terms with a `std` count, and those from `drifts` on are
    /// averaged separately, because many that agree would hide others that do not.
    pub fn begin_excess(&mut self, std: &[f64], drifts: usize) {
        let room = self.terms.len();
        self.scatter_ratio = self
            .mean_scatter_ratio(std, 0..drifts)
            .max(self.mean_scatter_ratio(std, drifts..room));
        self.excess = self.scatter_ratio;
    }

    /// X if the terms explain `explained` of χ².
    pub fn learn_excess(&mut self, explained: f64) {
        self.excess = ((self.misfit - explained) / self.freedom.max(1.0)).max(self.scatter_ratio); // (3)
    }

    /// The same if a single term explains what it can; at least 1.
    pub fn excess_with(&self, suspect: usize) -> f64 {
        let term = &self.terms[suspect];
        let explained = term.score * term.score / term.information;
        ((self.misfit - explained) / self.freedom.max(1.0)).max(1.0)
    }

    /// Scatter (2) of the blocks' scores over what white noise would give, averaged over the terms;
    /// at least 1.
    fn mean_scatter_ratio(&self, std: &[f64], terms: Range<usize>) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (term, std) in self.terms[terms.clone()].iter().zip(&std[terms]) {
            if *std > 0.0 && term.blocks() >= ENOUGH && term.information > 0.0 {
                let amplitude = term.score / term.information;
                sum += term.scatter(amplitude) / term.information;
                count += 1.0;
            }
        }
        if count > 0.0 { (sum / count).max(1.0) } else { 1.0 }
    }
}
