//! Which term that the model lacks would explain the misfit: score tests, added up over the blocks.
//!
//! ```text
//! U_s = Σ_m λ^(M−m) u,  I_s = Σ_m λ^(M−m) i        u, i of each block from considered.rs, in units of the noise
//! z_s² = U_s² / (I_s x),  â = U_s/I_s             y_s² = U_s² / Σ (u − i â)²
//! ```
//!
//! x ≥ 1 is what the residuals are larger than the noise after the term has explained its share. Σ (u − i â)², the scatter of the blocks about one amplitude,
//! is the score's variance where the residuals are correlated over a block, whatever their level (a cluster-robust variance, K.-Y. Liang and S. L. Zeger 1986).
//! U²/I is the χ² that the term would take away (C. R. Rao's score test). It is told as a share of the misfit: of χ² beyond the rows
//! where the noise was told, of all χ² where it was learnt from the residuals themselves.
//!
//! A term is named where z exceeds [`NAMED`] and y [`REPEATED`]. With eleven terms and some hundred blocks in memory a right model names one once in 1e6
//! runs by chance; the room is for what is left of quadrature and filters. Of several that pass, the one that explains most is the likeliest.
//!
//! σ believes them sooner: from [`BELIEVED`] on â is a considered error of standard deviation |â|, each of the terms on its own. The estimate is not corrected by it, for
//! that is what a term of the model is for.

use super::considered::room_for;
use super::persist::Visit;

/// Standard deviations from which on a term is named.
const NAMED: f64 = 6.0;
/// Ratio of a term's sum to the scatter of the blocks about it from which on it is one amplitude and no accident of some blocks.
const REPEATED: f64 = 3.0;
/// Standard deviations, and that ratio, from which on σ allows for a term.
const BELIEVED: f64 = 4.0;
const REPEATED_BELIEVED: f64 = 2.0;
/// Share of all χ² that a term must explain where the noise was learnt.
const OF_ALL: f64 = 0.2;
/// Blocks that a scatter needs.
const ENOUGH: f64 = 2.5;
/// λ per block: what a term was thirty blocks ago still tells what it is.
const MEMORY: f64 = 0.98;

/// A term that the model lacks, by its evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suspicion {
    /// Which error of [`Residuals::suspects`](super::Residuals::suspects).
    pub suspect: usize,
    /// Its amplitude, were it there and alone.
    pub amplitude: f64,
    /// |z|: standard deviations that the amplitude is from 0.
    pub deviations: f64,
    /// Share of the misfit that it would explain, 0 to 1.
    pub share: f64,
}

/// Forgotten sums of one term.
#[derive(Debug, Clone, Copy, Default)]
struct Term {
    score: f64,
    information: f64,
    score_square: f64,
    score_information: f64,
    information_square: f64,
    blocks: f64,
}

/// The sums of every term.
#[derive(Debug, Clone)]
pub struct ScoreTest {
    terms: Vec<Term>,
    pending: Vec<(f64, f64)>,
    /// χ² of the residuals and its degrees of freedom.
    misfit: f64,
    freedom: f64,
    told: bool,
}

impl ScoreTest {
    /// Room for a plant of `equations` equations.
    pub fn new(equations: usize) -> Self {
        Self {
            terms: vec![Term::default(); room_for(equations)],
            pending: vec![(0.0, 0.0); room_for(equations)],
            misfit: 0.0,
            freedom: 0.0,
            told: true,
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.terms.fill(Term::default());
        (self.misfit, self.freedom, self.told) = (0.0, 0.0, true);
    }

    /// What goes from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        for term in &mut self.terms {
            let Term {
                score,
                information,
                score_square,
                score_information,
                information_square,
                blocks,
            } = term;
            for number in [
                score,
                information,
                score_square,
                score_information,
                information_square,
                blocks,
            ] {
                v.real(number);
            }
        }
        v.real(&mut self.misfit);
        v.real(&mut self.freedom);
        v.flag(&mut self.told);
    }

    /// Begins a block.
    pub fn begin(&mut self) {
        self.pending.fill((0.0, 0.0));
        self.misfit *= MEMORY;
        self.freedom *= MEMORY;
        self.told = true;
    }

    /// Adds what a group says: (u, i) per term with noise of `variance`, and the χ² of its residuals with its degrees of freedom; `told` where the
    /// variance is not learnt from these residuals.
    pub fn take(&mut self, scores: &[(f64, f64)], variance: f64, misfit: f64, freedom: f64, told: bool) {
        for (sum, (u, i)) in self.pending.iter_mut().zip(scores) {
            sum.0 += u / variance;
            sum.1 += i / variance;
        }
        self.misfit += misfit;
        self.freedom += freedom;
        self.told &= told;
    }

    /// Ends a block.
    pub fn end(&mut self) {
        for (term, (u, i)) in self.terms.iter_mut().zip(&self.pending) {
            for sum in [
                &mut term.score,
                &mut term.information,
                &mut term.score_square,
                &mut term.score_information,
                &mut term.information_square,
                &mut term.blocks,
            ] {
                *sum *= MEMORY;
            }
            if *i > 0.0 && u.is_finite() && i.is_finite() {
                term.score += u;
                term.information += i;
                term.score_square += u * u;
                term.score_information += u * i;
                term.information_square += i * i;
                term.blocks += 1.0;
            }
        }
    }

    /// The likeliest term, if any is significant.
    pub fn likeliest(&self) -> Option<Suspicion> {
        let named = (0..self.terms.len())
            .filter_map(|s| self.judge(s))
            .filter(|j| j.blocks >= ENOUGH && j.suspicion.deviations > NAMED && j.repeated > REPEATED)
            .filter(|j| self.counts(&j.suspicion));
        named
            .max_by(|a, b| a.explained.total_cmp(&b.explained))
            .map(|judged| judged.suspicion)
    }

    /// |â| of a term that σ must allow for, 0 for others.
    pub fn believed(&self, suspect: usize) -> f64 {
        let judged = self.judge(suspect);
        judged.map_or(0.0, |j| {
            // where the noise was told, the first block may speak for itself
            let one = j.repeated > REPEATED_BELIEVED || self.told && j.blocks < ENOUGH;
            match j.suspicion.deviations > BELIEVED && one && self.counts(&j.suspicion) {
                true => j.suspicion.amplitude.abs(),
                false => 0.0,
            }
        })
    }

    /// Residuals that taught the noise level hold all sorts of things: a term that explains little of them is one of many.
    fn counts(&self, suspicion: &Suspicion) -> bool {
        self.told || suspicion.share > OF_ALL
    }

    fn judge(&self, suspect: usize) -> Option<Judged> {
        let term = self.terms.get(suspect)?;
        if !(term.information > 0.0) {
            return None;
        }
        let amplitude = term.score / term.information;
        let explained = term.score * amplitude;
        let scatter = term.score_square - 2.0 * amplitude * term.score_information
            + amplitude * amplitude * term.information_square;
        let scatter = scatter.max(1e-12 * term.score_square) * term.blocks / (term.blocks - 1.0).max(0.1);
        let excess = ((self.misfit - explained) / self.freedom.max(1.0)).max(1.0);
        let misfit = if self.told {
            self.misfit - self.freedom
        } else {
            self.misfit
        };
        let judged = Judged {
            explained,
            blocks: term.blocks,
            repeated: term.score.abs() / scatter.sqrt(),
            suspicion: Suspicion {
                suspect,
                amplitude,
                deviations: term.score.abs() / (term.information * excess).sqrt(),
                share: (explained / misfit.max(explained)).clamp(0.0, 1.0),
            },
        };
        (amplitude.is_finite() && scatter > 0.0).then_some(judged)
    }
}

/// The evidence for one term.
struct Judged {
    /// χ² that it would take away.
    explained: f64,
    /// Blocks that spoke, forgotten.
    blocks: f64,
    /// y.
    repeated: f64,
    suspicion: Suspicion,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(blocks: &[(f64, f64)], misfit: f64) -> ScoreTest {
        let mut test = ScoreTest::new(1);
        let mut scores = [(0.0, 0.0); 6];
        for &block in blocks {
            scores[2] = block;
            test.begin();
            test.take(&scores, 1.0, 100.0 + misfit, 100.0, true);
            test.end();
        }
        test
    }

    #[test]
    fn prop_one_amplitude_over_the_blocks_is_named_with_its_share() {
        // amplitude 2, information 10 a block: each block is 6.3 deviations and explains 40 of χ²
        let test = after(&[(20.0, 10.0), (21.0, 10.0), (19.0, 10.0), (20.0, 10.0)], 50.0);
        let suspicion = test.likeliest().expect("four blocks of one kind");
        assert_eq!(suspicion.suspect, 2);
        assert!((suspicion.amplitude - 2.0).abs() < 0.01 && (suspicion.share - 0.8).abs() < 0.01);
        assert_eq!(test.believed(2), suspicion.amplitude);
        assert_eq!(test.believed(1), 0.0);
    }

    #[test]
    fn prop_blocks_that_disagree_or_chance_name_nothing() {
        // as large, but of either sign
        assert_eq!(
            after(&[(80.0, 10.0), (-60.0, 10.0), (70.0, 10.0), (-40.0, 10.0)], 50.0).likeliest(),
            None
        );
        assert_eq!(
            after(&[(3.0, 10.0), (4.0, 10.0), (2.0, 10.0), (3.0, 10.0)], 0.0).likeliest(),
            None
        );
    }
}
