//! Finds which missing term of the model would explain the misfit: score tests, accumulated over
//! the blocks.
//!
//! ```text
//! U_gs = Σ_m λ^(M−m) u,  I_gs = Σ_m λ^(M−m) i     u, i of each block from considered.rs, in units of the noise
//! U_s = Σ_g U_gs/x_g,  I_s = Σ_g I_gs/x_g          over the groups g of equations
//! z_s² = U_s²/I_s,  â = U_s/I_s                   y_s² = U_s² / Σ_g Σ (u − i â)²/x_g²
//! ```
//!
//! x_g ≥ 1 is the ratio by which the residuals of a group exceed the noise after the term has
//! explained its share. It is kept for each group: a joint that does not fit must not hide what the
//! residuals of another one say. Σ (u − i â)², the scatter of the blocks about one amplitude, is
//! the score's variance if the residuals are correlated over a block, whatever their level (a
//! cluster-robust variance, K.-Y. Liang and S. L. Zeger 1986). With x = 1, U²/I is the χ² that the
//! term would take away (C. R. Rao's score test). It is reported as a share of the misfit of the
//! groups that the term is in: of χ² beyond the rows if the noise was specified, of all χ² if it
//! was learnt from the residuals themselves.
//!
//! A term is named if z exceeds [`NAMED`] and y [`REPEATED`]. With a dozen terms and about a
//! hundred blocks in memory, a right model has one named by chance once in 1e6 runs; the rest of
//! the margin is for errors of quadrature and filters. If several pass, the one that explains most
//! is the likeliest. A resonance delays slow motion by τ = 2ζ/ω, so it is named in place of the
//! delay if, with the part of the delay removed, it is beyond [`BESIDE`] standard deviations.
//!
//! **Posterior.** Even before a term is named, σ allows for the possible terms. With the prior N(0,
//! Σ), Σ = diag(σ_s²), U_g and I_g over all terms at once, and X_g the larger of x_g and the ratio
//! of the group's scatter to that of white noise,
//!
//! ```text
//! C = (Σ⁻¹ + Σ_g I_g/X_g)⁻¹,  m = C Σ_g U_g/X_g,  M = C + m mᵀ                (d) of considered.rs
//! ```
//!
//! A term whose column holds for slow motion only is also tested on sums of neighbouring rows
//! (`summed_rows.rs`), with scores and information in units of these sums' own scatter. If they
//! show an amplitude â that counts, of information I, M_ss is at least â² + 1/I, and the term may
//! be named by them.
//!
//! A term without a prior counts with its amplitude â once z exceeds [`BELIEVED`]. The estimate
//! itself is not corrected; for that, the term must be added to the model.

use super::considered::room_for;
use super::linalg::Cholesky;
use super::persist::{Visit, visit_symmetric};
use super::score_sums::{ENOUGH, GroupEvidence, GroupScores};
use super::summed_evidence::SummedEvidence;
use super::suspicion::{Judged, Suspicion};

/// Standard deviations above which a term is named.
const NAMED: f64 = 6.0;
/// Ratio of a term's sum to the scatter of the blocks about it above which it is a constant
/// amplitude, not an accident of some blocks.
const REPEATED: f64 = 3.0;
/// Standard deviations, and ratio as above, above which σ allows for a term.
const BELIEVED: f64 = 4.0;
const REPEATED_BELIEVED: f64 = 2.0;
/// Standard deviations of a resonance beside a delay above which the resonance is named. That one
/// of the two is there has been shown already, so this only chooses the name.
const BESIDE: f64 = 3.5;
/// A term with a prior is named only if its amplitude is known to within this many standard
/// deviations of the prior. If its column cannot show an error of the usual size, it is mostly
/// noise.
const KNOWN: f64 = 3.5;
/// χ² per row below which nothing is named: R is then too large, as while slow motion holds the
/// rounding error of a position for many samples. Smoothed signals keep a part of their noise
/// (`projected/errors_in_variables.rs`), which the columns share with the residuals, so scores have
/// a mean without any missing term.
const QUIET: f64 = 0.65;

/// The sums of every term.
#[derive(Debug, Clone)]
pub struct ScoreTest {
    groups: Vec<GroupScores>,
    summed: SummedEvidence,
    /// Index of the first drift.
    drifts: usize,
    /// σ_s and M.
    std: Vec<f64>,
    moments: Vec<f64>,
    // scratch
    factor: Cholesky,
    matrix: Vec<f64>,
    mean: Vec<f64>,
}

impl ScoreTest {
    /// Workspace for a plant of `equations` equations in `groups` groups and the drifts of `drifts`
    /// parameters.
    pub fn new(equations: usize, groups: usize, drifts: usize) -> Self {
        let first = room_for(equations);
        let room = first + drifts;
        Self {
            groups: vec![GroupScores::new(room); groups],
            drifts: first,
            summed: SummedEvidence::new(first),
            std: vec![0.0; room],
            moments: vec![0.0; room * room],
            factor: Cholesky::new(room),
            matrix: vec![0.0; room * room],
            mean: vec![0.0; room],
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.groups.iter_mut().for_each(GroupScores::reset);
        self.summed.reset();
        self.moments.fill(0.0);
    }

    /// What goes from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.groups.iter_mut().for_each(|group| group.visit(v));
        self.summed.visit(v);
        visit_symmetric(v, &mut self.moments, self.std.len());
    }

    /// M for the next block: the prior `std(s)` of an error, and `drift(i)` of a parameter, until a
    /// block has been seen. Returns it, room × room.
    pub fn prepare(&mut self, count: usize, std: impl Fn(usize) -> f64, drift: impl Fn(usize) -> f64) -> &[f64] {
        let room = self.std.len();
        for s in 0..room {
            self.std[s] = match s.checked_sub(self.drifts) {
                Some(parameter) => drift(parameter),
                None if s < count => std(s),
                None => 0.0,
            };
            let moment = &mut self.moments[s * room + s];
            if *moment == 0.0 {
                *moment = self.std[s] * self.std[s];
            }
        }
        &self.moments
    }

    /// Begins a block.
    pub fn begin(&mut self) {
        self.groups.iter_mut().for_each(GroupScores::begin);
        self.summed.begin();
    }

    /// Adds the evidence of a group.
    pub fn take(&mut self, group: usize, evidence: &GroupEvidence<'_>) {
        self.groups[group].take(evidence);
        let (_, _, summed) = evidence.scores;
        self.summed.take(summed);
    }

    /// Ends a block.
    pub fn end(&mut self) {
        self.groups.iter_mut().for_each(GroupScores::end);
        self.summed.end();
        self.learn();
    }

    /// M, room × room.
    pub fn moments(&self) -> &[f64] {
        &self.moments
    }

    /// X and M at the head of this file.
    fn learn(&mut self) {
        self.moments.fill(0.0);
        let begin = |group: &mut GroupScores| group.begin_excess(&self.std, self.drifts);
        self.groups.iter_mut().for_each(begin);
        // twice, because m depends on X, and X on what m explains
        for _ in 0..2 {
            if !self.solve_posterior() {
                break;
            }
            let considered = (0..self.std.len()).filter(|&s| self.std[s] > 0.0);
            for group in &mut self.groups {
                let amplitudes = considered.clone().zip(&self.mean);
                let explained = amplitudes
                    .map(|(s, mean)| mean * self.std[s] * group.terms[s].score)
                    .sum();
                group.learn_excess(explained);
            }
        }
        for s in 0..self.std.len() {
            let believed = self.believed(s).powi(2).max(self.seen_in_sums(s));
            let moment = &mut self.moments[s * self.std.len() + s];
            // a posterior that could not be factored leaves the prior
            let least = if *moment > 0.0 { 0.0 } else { self.std[s] * self.std[s] };
            *moment = moment.max(believed).max(least);
        }
    }

    /// C, m and M of the terms with a prior, C and m in units of its standard deviations; false if
    /// there are none, or C⁻¹ cannot be factored.
    fn solve_posterior(&mut self) -> bool {
        let (std, room) = (&self.std, self.std.len());
        let considered = || (0..room).filter(|&s| std[s] > 0.0);
        let count = considered().count();
        for (row, s) in considered().enumerate() {
            self.mean[row] = std[s] * self.groups.iter().map(|g| g.terms[s].score / g.excess).sum::<f64>();
            for (column, r) in considered().enumerate() {
                let unit = if s == r { 1.0 } else { 0.0 };
                let information = |g: &GroupScores| g.information[s * room + r] / g.excess;
                let information: f64 = self.groups.iter().map(information).sum();
                self.matrix[row * count + column] = unit + std[s] * std[r] * information;
            }
        }
        if count == 0 || !self.factor.factor(count, &self.matrix[..count * count]) {
            return false;
        }
        self.factor.solve(&mut self.mean[..count]);
        self.factor.inverse(&mut self.matrix[..count * count]);
        for (row, s) in considered().enumerate() {
            for (column, r) in considered().enumerate() {
                let second = self.matrix[row * count + column] + self.mean[row] * self.mean[column];
                self.moments[s * room + r] = std[s] * std[r] * second;
            }
        }
        true
    }

    /// The likeliest term, if any is significant; `lags_as(s)` is the delay that term s looks like
    /// in slow motion, and `is_named(s)` is false for terms that are only allowed for.
    pub fn likeliest(
        &self,
        lags_as: impl Fn(usize) -> Option<usize>,
        is_named: impl Fn(usize) -> bool,
    ) -> Option<Suspicion> {
        let is_known = |s: &Suspicion| {
            let prior = self.std[s.suspect];
            prior == 0.0 || s.amplitude.abs() <= KNOWN * prior * s.deviations
        };
        let significant = |j: &Judged| {
            j.blocks >= ENOUGH && j.is_beyond(NAMED, REPEATED) && j.level > QUIET && is_known(&j.suspicion)
        };
        let largest = |judged: &mut dyn Iterator<Item = Judged>| {
            let likeliest = judged.max_by(|a, b| a.explained.total_cmp(&b.explained));
            likeliest.map(|judged| judged.suspicion)
        };
        let named = (0..self.std.len()).filter(|&s| is_named(s));
        let all = named.filter_map(|s| self.judge(s)).filter(significant);
        let in_sums = (0..self.summed.len()).filter_map(|s| self.summed.judge(s));
        let likeliest = largest(&mut all.filter(Judged::counts)).map(|likeliest| {
            let terms = (0..self.summed.len()).filter(|&s| lags_as(s) == Some(likeliest.suspect));
            let beside = terms.filter_map(|s| self.resonance_beside(s, &likeliest));
            let named = beside.filter(|resonance| resonance.deviations > BESIDE);
            named
                .max_by(|a, b| a.deviations.total_cmp(&b.deviations))
                .unwrap_or(likeliest)
        });
        likeliest.or_else(|| largest(&mut in_sums.filter(significant).filter(Judged::explains_much)))
    }

    /// â² + 1/I of a term that sums of rows show, 0 for others.
    fn seen_in_sums(&self, suspect: usize) -> f64 {
        let judged = self.summed.judge(suspect);
        let counts = |j: &Judged| j.is_beyond(BELIEVED, REPEATED_BELIEVED) && j.explains_much();
        judged.filter(counts).map_or(0.0, |j| {
            j.suspicion.amplitude.powi(2) + 1.0 / self.summed.information(suspect)
        })
    }

    /// |â| of a term that σ must allow for, 0 for others.
    fn believed(&self, suspect: usize) -> f64 {
        let judged = self.judge(suspect);
        judged.map_or(0.0, |j| {
            // if the noise was specified, the first block alone may count
            let one = j.repeated > REPEATED_BELIEVED || j.noise_is_configured && j.blocks < ENOUGH;
            match j.suspicion.deviations > BELIEVED && one && j.counts() {
                true => j.suspicion.amplitude.abs(),
                false => 0.0,
            }
        })
    }

    fn judge(&self, suspect: usize) -> Option<Judged> {
        let informed = || self.groups.iter().filter(|g| g.terms[suspect].information > 0.0);
        let (mut score, mut information) = (0.0, 0.0);
        for group in informed() {
            let (term, x) = (&group.terms[suspect], group.excess_with(suspect));
            score += term.score / x;
            information += term.information / x;
        }
        let amplitude = score / information;
        let (mut scatter, mut explained, mut misfit, mut level) = (0.0, 0.0, 0.0, 0.0);
        let (mut blocks, mut noise_is_configured) = (0.0_f64, true);
        for group in informed() {
            let (term, x) = (&group.terms[suspect], group.excess_with(suspect));
            scatter += term.scatter(amplitude).max(1e-12 * term.score_square) / (x * x);
            explained += amplitude * (2.0 * term.score - amplitude * term.information);
            misfit += group.misfit - if group.noise_is_configured { group.freedom } else { 0.0 };
            level += term.information / x / information * group.misfit / group.freedom.max(1.0);
            blocks = blocks.max(term.blocks());
            noise_is_configured &= group.noise_is_configured;
        }
        let judged = Judged {
            explained,
            level,
            blocks,
            repeated: score.abs() / scatter.sqrt(),
            noise_is_configured,
            suspicion: Suspicion {
                suspect,
                drifting: suspect.checked_sub(self.drifts),
                amplitude,
                deviations: score.abs() / information.sqrt(),
                share: (explained / misfit.max(explained)).clamp(0.0, 1.0),
            },
        };
        (amplitude.is_finite() && scatter > 0.0).then_some(judged)
    }

    /// A resonance beside the delay, which explains the same in slow motion. `None` if the two
    /// together are no resonance of damping ratio ζ below a half: â = 1/ω², τ = 2 ζ/ω.
    fn resonance_beside(&self, suspect: usize, delay: &Suspicion) -> Option<Suspicion> {
        let (room, lag) = (self.std.len(), delay.suspect);
        let [mut score, mut information, mut both, mut score_lag, mut information_lag] = [0.0; 5];
        for group in &self.groups {
            score += group.terms[suspect].score / group.excess;
            information += group.terms[suspect].information / group.excess;
            both += group.information[suspect * room + lag] / group.excess;
            score_lag += group.terms[lag].score / group.excess;
            information_lag += group.terms[lag].information / group.excess;
        }
        score -= both / information_lag * score_lag;
        information -= both / information_lag * both;
        let amplitude = score / information;
        let resonance = Suspicion {
            suspect,
            amplitude,
            deviations: score / information.sqrt(),
            ..*delay
        };
        (information > 0.0 && amplitude > delay.amplitude.powi(2)).then_some(resonance)
    }
}

#[cfg(test)]
mod tests {
    use super::super::score_sums::MEMORY;
    use super::super::summed_rows::SummedScore;
    use super::*;

    fn evidence<'a>(
        scores: (&'a [f64], &'a [f64], &'a [SummedScore]),
        misfit: f64,
        noise_is_configured: bool,
    ) -> GroupEvidence<'a> {
        GroupEvidence {
            scores,
            variance: 1.0,
            misfit,
            freedom: 100.0,
            noise_is_configured,
        }
    }

    fn after(blocks: &[(f64, f64)], misfit: f64, std: f64) -> ScoreTest {
        let mut test = ScoreTest::new(1, 1, 0);
        let room = room_for(1);
        let (mut scores, mut information) = (vec![0.0; room], vec![0.0; room * room]);
        test.prepare(room, |_| std, |_| 0.0);
        for &(score, own) in blocks {
            scores[2] = score;
            information[2 * room + 2] = own;
            test.begin();
            test.take(0, &evidence((&scores, &information, &[]), 100.0 + misfit, true));
            test.end();
        }
        test
    }

    #[test]
    fn prop_one_amplitude_over_the_blocks_is_named_with_its_share() {
        // amplitude 2, information 10 a block: each block is 6.3 standard deviations and explains
        // 40 of χ²
        let test = after(&[(20.0, 10.0), (21.0, 10.0), (19.0, 10.0), (20.0, 10.0)], 50.0, 0.0);
        let suspicion = test.likeliest(|_| None, |_| true).expect("four blocks of one kind");
        assert_eq!(suspicion.suspect, 2);
        assert!((suspicion.amplitude - 2.0).abs() < 0.01 && (suspicion.share - 0.8).abs() < 0.01);
        assert_eq!(test.likeliest(|_| None, |s| s != 2), None, "only allowed for");
        assert_eq!(test.believed(2), suspicion.amplitude);
        assert_eq!(test.believed(1), 0.0);
    }

    #[test]
    fn prop_a_term_that_only_sums_of_rows_show_is_named_and_allowed_for() {
        let room = room_for(1);
        let (scores, information) = (vec![0.0; room], vec![0.0; room * room]);
        let named = |misfit: f64| {
            let mut test = ScoreTest::new(1, 1, 0);
            let mut summed = vec![SummedScore::default(); room];
            test.prepare(room, |_| 1.0, |_| 0.0);
            // amplitude 3, 13 standard deviations a block, which explain 180 of the misfit
            summed[4] = SummedScore {
                score: 60.0,
                information: 20.0,
                misfit,
            };
            for _ in 0..4 {
                test.begin();
                test.take(0, &evidence((&scores, &information, &summed), 100.0, false));
                test.end();
            }
            (test.likeliest(|_| None, |_| true), test.moments()[4 * room + 4])
        };
        let (suspicion, moment) = named(220.0);
        assert!(suspicion.is_some_and(|s| s.suspect == 4 && (s.amplitude - 3.0).abs() < 1e-9));
        assert!((9.0..9.1).contains(&moment), "{moment}");
        // a tenth of what the parameters leave of the sums is not enough
        let (suspicion, moment) = named(1800.0);
        assert!(suspicion.is_none() && moment < 1.1, "{moment}");
    }

    /// A second group whose residuals are a hundred times the noise.
    #[test]
    fn regress_a_group_that_does_not_fit_hides_nothing_in_another() {
        let room = room_for(2);
        let mut test = ScoreTest::new(2, 2, 0);
        test.prepare(room, |_| 0.125, |_| 0.0);
        let (mut scores, mut information) = (vec![0.0; room], vec![0.0; room * room]);
        (scores[2], information[2 * room + 2]) = (20.0, 10.0);
        let (other, nothing) = (vec![0.0; room], vec![0.0; room * room]);
        for _ in 0..4 {
            test.begin();
            test.take(0, &evidence((&scores, &information, &[]), 150.0, true));
            test.take(1, &evidence((&other, &nothing, &[]), 1e6, true));
            test.end();
        }
        // 40 of the group's χ² of 50 beyond its rows
        let suspicion = test
            .likeliest(|_| None, |_| true)
            .expect("one amplitude in every block");
        assert!(suspicion.suspect == 2 && (suspicion.share - 0.8).abs() < 1e-9);
        // the posterior: 39 units of information against a prior of 64, excess 1.1
        let information = 10.0 * (1.0 + MEMORY + MEMORY.powi(2) + MEMORY.powi(3));
        let mean = 2.0 * information / (information + 64.0);
        assert!(test.moments()[2 * room + 2] > (0.9 * mean).powi(2));
    }

    /// Delay 0 and resonance 4, whose columns have a correlation of 0.37.
    #[test]
    fn prop_a_resonance_is_not_called_a_delay_but_a_delay_is() {
        let room = room_for(1);
        let named = |delay: f64, square: f64| {
            let mut test = ScoreTest::new(1, 1, 0);
            test.prepare(room, |_| 1.0, |_| 0.0);
            let (mut scores, mut information) = (vec![0.0; room], vec![0.0; room * room]);
            (information[0], information[4 * room + 4]) = (100.0, 30.0);
            (information[4], information[4 * room]) = (20.0, 20.0);
            scores[0] = 100.0 * delay + 20.0 * square;
            scores[4] = 20.0 * delay + 30.0 * square;
            for _ in 0..4 {
                test.begin();
                test.take(0, &evidence((&scores, &information, &[]), 150.0, true));
                test.end();
            }
            let named = test.likeliest(|s| (s == 4).then_some(0), |_| true);
            named.expect("5 standard deviations a block, four blocks of one kind")
        };
        // 2.5 standard deviations a block beside the delay
        let resonance = named(0.4, 0.5);
        assert!(resonance.suspect == 4 && (resonance.amplitude - 0.5).abs() < 1e-9);
        assert_eq!(named(0.4, 0.0).suspect, 0);
        // damping ratio 0.53, and an amplitude of the wrong sign
        assert_eq!(named(0.8, 0.57).suspect, 0);
        assert_eq!(named(0.8, -0.6).suspect, 0);
    }

    #[test]
    fn prop_a_column_that_could_show_no_usual_error_names_nothing() {
        // amplitude 2, known to 0.16: as well as the prior, and ten times worse
        let blocks = [(20.0, 10.0), (21.0, 10.0), (19.0, 10.0), (20.0, 10.0)];
        assert!(after(&blocks, 50.0, 0.16).likeliest(|_| None, |_| true).is_some());
        assert_eq!(after(&blocks, 50.0, 0.016).likeliest(|_| None, |_| true), None);
    }

    #[test]
    fn prop_residuals_far_below_the_noise_name_nothing() {
        let scores = [(20.0, 10.0), (21.0, 10.0), (19.0, 10.0), (20.0, 10.0)];
        // χ² of 70 and of 60 in 100 rows a block
        assert!(after(&scores, -30.0, 0.0).likeliest(|_| None, |_| true).is_some());
        assert_eq!(after(&scores, -40.0, 0.0).likeliest(|_| None, |_| true), None);
    }

    #[test]
    fn prop_blocks_that_disagree_or_chance_name_nothing() {
        // as large, but of alternating sign
        assert_eq!(
            after(&[(80.0, 10.0), (-60.0, 10.0), (70.0, 10.0), (-40.0, 10.0)], 50.0, 0.0).likeliest(|_| None, |_| true),
            None
        );
        assert_eq!(
            after(&[(3.0, 10.0), (4.0, 10.0), (2.0, 10.0), (3.0, 10.0)], 0.0, 0.0).likeliest(|_| None, |_| true),
            None
        );
    }

    #[test]
    fn val_moments_are_those_of_the_normal_posterior() {
        // prior N(0, 3²), information 10 a block with one memory: scalar case of C = 1/(1/σ² + I),
        // m = C U
        let blocks = [(1.0, 10.0), (-2.0, 10.0), (3.0, 10.0)];
        let test = after(&blocks, 0.0, 3.0);
        let (score, information) = blocks
            .iter()
            .rev()
            .zip([1.0, MEMORY, MEMORY * MEMORY])
            .fold((0.0, 0.0), |(u, i), (b, w)| (u + w * b.0, i + w * b.1));
        let variance = 1.0 / (1.0 / 9.0 + information);
        let mean = variance * score;
        let room = room_for(1);
        let moment = test.moments()[2 * room + 2];
        assert!((moment - (variance + mean * mean)).abs() < 1e-12, "{moment}");
        // an error that no block informs on keeps its prior
        assert!((test.moments()[0] - 9.0).abs() < 1e-12);
        assert_eq!(test.moments()[2], 0.0);
    }
}
