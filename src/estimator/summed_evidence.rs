//! Scores of terms on sums of neighbouring rows (`summed_rows.rs`), accumulated over the blocks.
//!
//! ```text
//! U_s = Σ_m λ^(M−m) u,  I_s = Σ_m λ^(M−m) i      u, i of each block in units of the sums' own scatter
//! ```

use super::persist::Visit;
use super::score_sums::{MEMORY, Term};
use super::summed_rows::SummedScore;
use super::suspicion::{Judged, Suspicion};

/// The sums of every term.
#[derive(Debug, Clone)]
pub struct SummedEvidence {
    terms: Vec<Term>,
    /// χ² of the summed rows, for each term.
    misfit: Vec<f64>,
    pending: Vec<SummedScore>,
}

impl SummedEvidence {
    /// Workspace for `count` terms.
    pub fn new(count: usize) -> Self {
        Self {
            terms: vec![Term::default(); count],
            misfit: vec![0.0; count],
            pending: vec![SummedScore::default(); count],
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.terms.fill(Term::default());
        self.misfit.fill(0.0);
    }

    /// What goes from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.terms.iter_mut().for_each(|term| term.visit(v));
        v.reals(&mut self.misfit);
    }

    /// Begins a block.
    pub fn begin(&mut self) {
        self.pending.fill(SummedScore::default());
    }

    /// Adds the scores of a group of equations.
    pub fn take(&mut self, scores: &[SummedScore]) {
        let pending = self.pending.iter_mut().zip(scores);
        // the rows of an equation belong to one group
        let informs = |(_, new): &(&mut SummedScore, &SummedScore)| new.information > 0.0;
        pending.filter(informs).for_each(|(pending, new)| *pending = *new);
    }

    /// Ends a block.
    pub fn end(&mut self) {
        let terms = self.terms.iter_mut().zip(&mut self.misfit);
        for ((term, misfit), new) in terms.zip(&self.pending) {
            term.take(new.score, new.information);
            *misfit = MEMORY * *misfit + if new.misfit.is_finite() { new.misfit } else { 0.0 };
        }
    }

    /// Number of terms.
    pub fn len(&self) -> usize {
        self.terms.len()
    }

    /// I of a term.
    pub fn information(&self, suspect: usize) -> f64 {
        self.terms[suspect].information
    }

    /// What the sums of rows say of a term, whose scatter is their noise; `None` if nothing.
    pub fn judge(&self, suspect: usize) -> Option<Judged> {
        let (term, misfit) = (self.terms.get(suspect)?, *self.misfit.get(suspect)?);
        let amplitude = term.score / term.information;
        let explained = term.score * amplitude;
        let scatter = term.scatter(amplitude).max(1e-12 * term.score_square);
        let judged = Judged {
            explained,
            // sums of rows are in units of their own scatter
            level: 1.0,
            blocks: term.blocks(),
            repeated: term.score.abs() / scatter.sqrt(),
            noise_is_configured: false,
            suspicion: Suspicion {
                suspect,
                drifting: None,
                amplitude,
                deviations: term.score.abs() / term.information.sqrt(),
                share: (explained / misfit.max(explained)).clamp(0.0, 1.0),
            },
        };
        (term.information > 0.0 && amplitude.is_finite() && scatter > 0.0).then_some(judged)
    }
}
