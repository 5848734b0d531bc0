//! A node off line, with its results: table, advice, files.

use super::advice::Advisor;
use super::monitor::{ESTIMATES_CSV, unwritable, write_summary};
use super::ticker::Ticker;
use super::wiring::{identifier_node, input_prediction};
use super::{Exit, Failure, IdentifyArgs, logging, out_dir, report, warm};
use crate::config::Config;
use crate::messages::{ErrorCode, Sample, Status};
use crate::node::identifier::Identifier;
use crate::node::monitor::MonitorNode;
use crate::recording::{EstimatesCsv, Loss, RunInfo};
use crate::report::RunData;
use crate::runner::Shutdown;
use std::fs::File;
use std::path::Path;
use std::time::Instant;

/// A node without a bus, and the collection of its estimates.
pub(super) struct OfflineRun<'a> {
    args: &'a IdentifyArgs,
    pub(super) node: Box<dyn Identifier>,
    run: RunData,
    advisor: Advisor,
    /// Samples in a block.
    block_len: usize,
    csv: Option<EstimatesCsv<File>>,
    start: Instant,
    ticker: Ticker,
    /// True if a signal arrived before the end of the input.
    stopped: bool,
}

impl<'a> OfflineRun<'a> {
    /// A node with a cold start, or a warm start if the command line requests it.
    ///
    /// # Errors
    /// If results would be overwritten, the configuration gives no node, or a checkpoint cannot be
    /// read.
    pub(super) fn new(
        args: &'a IdentifyArgs,
        config: &Config,
        info: RunInfo,
        monitor: MonitorNode,
        start: Instant,
    ) -> Result<Self, Failure> {
        if let Some(dir) = &args.out {
            out_dir::check(dir)?;
        }
        let mut node = identifier_node(config)?;
        if args.warm {
            warm::start(config, &mut *node, None)?;
        } else if let Some(dir) = &config.checkpoint.dir {
            tracing::info!(
                "checkpoint.dir is \"{}\", but identify writes no checkpoint, and begins from one only with --warm",
                dir.display()
            );
        }
        let joints = info.joints;
        // A prediction is only shown in a report.
        let prediction = args.out.as_ref().map(|_| input_prediction(config));
        let notes = report::notes(&info, Some(config));
        let mut run = RunData::new(info, monitor).predicting(prediction);
        run.notes = notes;
        Ok(Self {
            args,
            node,
            run,
            advisor: Advisor::new(config, joints),
            block_len: config.estimator.block_len,
            csv: None,
            start,
            ticker: Ticker::start(&format!("identifying from {}", args.input.display())),
            stopped: false,
        })
    }

    /// Sets the share of the input that has been read, 0 to 1.
    pub(super) fn at(&self, share: f64) {
        self.ticker.at(share);
    }

    /// True if the rest of the input should not be read.
    pub(super) fn is_stopped(&mut self, shutdown: &Shutdown) -> bool {
        self.stopped = shutdown.requested();
        self.stopped
    }

    /// Passes a sample to the node and keeps its estimates.
    pub(super) fn take(&mut self, sample: &Sample) -> Result<(), Failure> {
        // Without any sample, no files are created.
        if let (0, Some(dir)) = (self.run.samples, &self.args.out) {
            out_dir::create(dir)?;
            let (monitor, equations) = (&self.run.monitor, self.run.info.equations.len());
            let path = dir.join(ESTIMATES_CSV);
            let csv = File::create_new(&path)
                .and_then(|file| EstimatesCsv::new(file, monitor.parameters(), equations, monitor.derived()));
            self.csv = Some(csv.map_err(|e| unwritable(&path, &e))?);
        }
        self.run.sample(sample, 0);
        self.advisor.take(sample);
        let (run, csv) = (&mut self.run, &mut self.csv);
        let mut written = Ok(());
        self.node.on_sample(sample, &mut |estimate| {
            tracing::debug!("{}", run.monitor.line(estimate));
            run.estimate(estimate, 0);
            if let (Some(csv), Ok(())) = (csv.as_mut(), &written) {
                written = csv.write(estimate);
            }
        });
        written.map_err(|e| match &self.args.out {
            Some(dir) => unwritable(&dir.join(ESTIMATES_CSV), &e),
            None => unwritable(Path::new(ESTIMATES_CSV), &e),
        })
    }

    /// The last estimates with their standard deviations; none without a block.
    pub(super) fn estimates(&self) -> impl Iterator<Item = [f64; 2]> {
        let last = self.run.estimates.last().into_iter();
        last.flat_map(|e| {
            e.theta
                .iter()
                .zip(&e.theta_std)
                .take(e.params as usize)
                .map(|(theta, std)| [*theta, *std])
        })
    }

    /// Writes table, advice and files; `about_input` is an additional line about the input.
    pub(super) fn finish(mut self, loss: Loss, about_input: Option<&str>) -> Result<Exit, Failure> {
        let (args, format) = (self.args, self.args.format);
        if self.run.samples == 0 && loss.is_none() {
            return Err(args.span.nothing(&args.input));
        }
        let status = self.node.status();
        self.run.status(&status);
        self.run.loss = loss;
        let mut summary = self.run.summary().of_blocks(self.block_len);
        summary.wall_s = Some((self.start.elapsed().as_secs_f64() * 1e3).round() / 1e3);
        // Files first, so that a full standard output does not prevent them.
        if let Some(dir) = &args.out {
            out_dir::create(dir)?;
            write_summary(dir, &summary)?;
            report::write(dir, &self.run, &summary, &self.ticker)?;
        }
        drop(self.ticker);
        if status.rejected > 0 {
            let all = status.accepted.saturating_add(status.rejected);
            // the text names the signal and the joint
            let last = match ErrorCode::from_wire(status.error.code) {
                Some(ErrorCode::WrongSignals | ErrorCode::NotFinite) => format!("; the last: {}", status.error.words()),
                _ => String::new(),
            };
            tracing::warn!(
                "{} of {all} samples were rejected: {}{last}",
                status.rejected,
                status.faults
            );
        }
        logging::table(&summary, format)?;
        if let Some(line) = self.advisor.line(self.node.window_s()) {
            logging::note(format, &line)?;
        }
        if let Some(line) = about_input {
            logging::note(format, line)?;
        }
        if let Some(dir) = &args.out {
            logging::note(format, &format!("results in {}", dir.display()))?;
        }
        if self.stopped {
            tell_stopped(&args.input);
        }
        // A gap is lost data, whether the recorder or the node counts it.
        match self.stopped || status.missing > 0 || lost_by_rejection(&status) {
            true => Ok(Exit::DataLoss),
            false => match summary.no_estimate.filter(|_| summary.blocks == 0) {
                Some(why) => Err(Failure::Usage(format!("{}: no estimate: {why}", args.input.display()))),
                None => Ok(Exit::Done),
            },
        }
    }
}

/// Reports that a signal arrived before the end of an input.
pub(super) fn tell_stopped(input: &Path) {
    tracing::warn!(
        "stopped by a signal: the rest of {} is not in the result",
        input.display()
    );
}

/// True if the samples that the node rejected count as lost data.
///
/// Occasional saturation of a drive is normal: these samples are left out on purpose, and count
/// only if they are most of the run.
fn lost_by_rejection(status: &Status) -> bool {
    let beyond_saturation = status.rejected.saturating_sub(status.faults.saturated);
    beyond_saturation > 0 || status.rejected > status.accepted
}
