//! `thetabus bench`: latencies of the bus and the identifier on this machine, compared with
//! iceoryx2 alone and the kernel alone.
//!
//! ```text
//! iceoryx2 alone      ping ──▶ process ──▶ pong                 one hop: from sending to the woken reader
//! publish→receive     plant at 1 kHz ──▶ this process            the same with the topic `sample`
//! sample→estimate     plant ──▶ identifier ──▶ this process      from a block's last sample to its estimate
//! jitter              a thread that sleeps to the next millisecond, and cyclictest if it is installed
//! ```

use super::{Exit, Failure, LogFormat, logging, usage};
use crate::bus::{BareLink, Bus, Domain, End, SampleSubscriber, Subscriber, monotonic_ns};
use crate::messages::{Estimate, Sample, Status};
use crate::runner::Shutdown;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Sample period \[ns\].
const PERIOD_NS: u64 = 1_000_000;
/// Samples per block: few, so that there are many estimates.
const BLOCK_LEN: u64 = 100;
/// How long a process may take to appear.
const PATIENCE: Duration = Duration::from_secs(20);

/// Command line of `bench`.
#[derive(Debug, Clone, clap::Args)]
pub struct BenchArgs {
    /// How long each stage is measured, in seconds
    #[arg(long = "duration", alias = "duration-s", value_name = "S", default_value_t = 20)]
    pub duration_s: u64,
    /// Write the page there as well as to standard output
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// The other end of the ping-pong, in this domain
    #[arg(long, hide = true)]
    pub echo: Option<String>,
    /// Log format on standard error
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,
}

/// Measures all stages and prints a page.
///
/// # Errors
/// If the bus fails or a process does not appear.
pub fn run(args: &BenchArgs, shutdown: &Shutdown) -> Result<Exit, Failure> {
    if let Some(domain) = &args.echo {
        return echo(domain, shutdown);
    }
    let domain = Domain::new(&format!("bench-{}", std::process::id()))?;
    let duration = Duration::from_secs(args.duration_s.max(1));
    let mut stages = Vec::new();
    let hop = ping_pong(&domain, duration, shutdown)?;
    let live = live(&domain, duration, shutdown)?;
    stages.push(("iceoryx2 alone, one hop", hop));
    stages.push(("publish→receive, topic `sample`", live.receive));
    stages.push(("sample→estimate, block included", live.estimate));
    stages.push(("jitter of a thread that sleeps", sleeper(duration, shutdown)));
    let page = page(&mut stages, &live.identifier, cyclictest(duration).as_ref());
    let _ = std::fs::remove_dir_all(domain.root());
    logging::result(page.trim_end())?;
    if let Some(path) = &args.out {
        std::fs::write(path, &page).map_err(|e| Failure::Failed(format!("cannot write {}: {e}", path.display())))?;
    }
    Ok(Exit::Done)
}

/// A child process that ends with this program.
struct Part(Child);

impl Part {
    fn start(args: &[&str]) -> Result<Self, Failure> {
        let failed = |e: std::io::Error| Failure::Failed(format!("cannot start {}: {e}", args[0]));
        let program = std::env::current_exe().map_err(failed)?;
        let mut command = Command::new(program);
        command
            .args(args)
            .env("RUST_LOG", "error")
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        Ok(Self(command.spawn().map_err(failed)?))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        let pid = nix::unistd::Pid::from_raw(self.0.id().cast_signed());
        let _ = nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGTERM);
        let _ = self.0.wait();
    }
}

/// One-way times of a message over iceoryx2 alone to another process and back, a thousand times a
/// second \[ns\].
fn ping_pong(domain: &Domain, duration: Duration, shutdown: &Shutdown) -> Result<Vec<u64>, Failure> {
    let bus = Bus::join(domain, "bare", "bench")?;
    let mut link = BareLink::new(&bus, End::Near)?;
    let _echo = Part::start(&["bench", "--echo", domain.name()])?;
    let mut times = Vec::new();
    let start = Instant::now();
    // The first answer shows that the other end exists.
    while link.receive(Duration::from_millis(20))?.is_none() {
        if start.elapsed() > PATIENCE {
            return Err(Failure::Failed("the other end of the ping-pong has not come".into()));
        }
        link.send(&Sample::EMPTY)?;
    }
    while link.receive(Duration::from_millis(100))?.is_some() {}
    let start = Instant::now();
    for seq in 0_u64.. {
        let due = Duration::from_nanos(seq * PERIOD_NS);
        if due > duration || shutdown.requested() {
            break;
        }
        std::thread::sleep(due.saturating_sub(start.elapsed()));
        link.send(&Sample { seq, ..Sample::EMPTY })?;
        if let Some((answer, back)) = link.receive(PATIENCE)? {
            times.extend([answer.t_ns, back]);
        }
    }
    Ok(times)
}

/// Sends back each message with its transit time.
fn echo(domain: &str, shutdown: &Shutdown) -> Result<Exit, Failure> {
    let bus = Bus::join(&Domain::new(domain)?, "bare", "bench_echo")?;
    let mut link = BareLink::new(&bus, End::Far)?;
    while !shutdown.requested() {
        if let Some((message, under_way)) = link.receive(Duration::from_millis(100))? {
            link.send(&Sample {
                t_ns: under_way,
                ..message
            })?;
        }
    }
    Ok(Exit::Done)
}

/// Results with a plant at 1 kHz, its identifier and a reader.
struct Live {
    receive: Vec<u64>,
    estimate: Vec<u64>,
    identifier: Identifier,
}

/// Resources used by the identifier.
#[derive(Default)]
struct Identifier {
    start_ms: f64,
    cpu_percent: f64,
    memory_mib: f64,
    sample_mean_ns: u64,
    block_mean_ns: u64,
    lost: u64,
}

fn live(domain: &Domain, duration: Duration, shutdown: &Shutdown) -> Result<Live, Failure> {
    let bus = Bus::join(domain, "arm", "bench")?;
    let mut samples = SampleSubscriber::new(&bus)?;
    let mut statuses = Subscriber::<Status>::new(&bus)?;
    let block_len = format!("estimator.block_len={BLOCK_LEN}");
    let common = [
        "--domain",
        domain.name(),
        "--set",
        "plant.speed=1",
        "--set",
        "bus.delivery=realtime",
        "--set",
    ];
    let length = format!("plant.duration_s={}", duration.as_secs() + 30);
    let started = Instant::now();
    let identifier = Part::start(&[&["identifier"], &common[..], &[&block_len]].concat())?;
    let mut live = Live {
        receive: Vec::new(),
        estimate: Vec::new(),
        identifier: Identifier::default(),
    };
    if statuses.next(PATIENCE)?.is_none() {
        return Err(Failure::Failed("the identifier has not come".into()));
    }
    live.identifier.start_ms = started.elapsed().as_secs_f64() * 1e3;
    let _plant = Part::start(&[&["plant"], &common[..], &[&length]].concat())?;
    if samples.next(PATIENCE)?.is_none() {
        return Err(Failure::Failed("the plant has not come".into()));
    }
    // The first blocks allocate and iterate.
    std::thread::sleep(Duration::from_secs(2));
    samples.drain(usize::MAX, |_| {})?;
    let done = Shutdown::new();
    let reader = estimates(domain.clone(), done.clone());
    let pid = identifier.0.id();
    let cpu_s = || usage::of(pid).map_or(0.0, |(seconds, _)| seconds);
    let (cpu, start) = (cpu_s(), Instant::now());
    let mut sent = BTreeMap::new();
    while start.elapsed() < duration && !shutdown.requested() {
        samples.wait(Duration::from_millis(20))?;
        samples.drain_timed(usize::MAX, |sample, sent_ns| {
            live.receive.push(monotonic_ns().saturating_sub(sent_ns));
            sent.insert(sample.t_ns, sent_ns);
        })?;
        statuses.drain(|status| {
            live.identifier.sample_mean_ns = status.step.mean_ns;
            live.identifier.block_mean_ns = status.block.mean_ns;
            live.identifier.memory_mib = status.process.resident_bytes as f64 / f64::from(1 << 20);
            live.identifier.lost = status.missing;
        })?;
    }
    done.request();
    let received = reader
        .join()
        .map_err(|_| Failure::Failed("the reader of estimates has ended".into()))??;
    live.estimate = received
        .iter()
        .filter_map(|(t_last_ns, received_ns)| Some(received_ns.saturating_sub(*sent.get(t_last_ns)?)))
        .collect();
    live.identifier.cpu_percent = (cpu_s() - cpu) / start.elapsed().as_secs_f64() * 100.0;
    Ok(live)
}

/// Receives estimates on a separate thread, as a controller does: stream time of the last sample,
/// and arrival time of the estimate \[ns\].
fn estimates(domain: Domain, done: Shutdown) -> JoinHandle<Result<Vec<(u64, u64)>, Failure>> {
    std::thread::spawn(move || {
        let bus = Bus::join(&domain, "arm", "bench_estimates")?;
        let mut estimates = Subscriber::<Estimate>::new(&bus)?;
        let mut received = Vec::new();
        while !done.requested() {
            if let Some((estimate, _)) = estimates.next(Duration::from_millis(50))? {
                received.push((estimate.t_last_ns, monotonic_ns()));
            }
        }
        Ok(received)
    })
}

/// Delay with which a thread wakes that sleeps until each next millisecond \[ns\].
fn sleeper(duration: Duration, shutdown: &Shutdown) -> Vec<u64> {
    let mut late = Vec::new();
    let start = Instant::now();
    for count in 1_u64.. {
        let due = Duration::from_nanos(count * PERIOD_NS);
        if due > duration || shutdown.requested() {
            break;
        }
        let left = due.saturating_sub(start.elapsed());
        if !left.is_zero() {
            std::thread::sleep(left);
            late.push((start.elapsed().saturating_sub(due)).as_nanos() as u64);
        }
    }
    late
}

/// Latencies of a thread of normal priority by cyclictest, from its histogram \[ns\]; `None` if it
/// is not installed.
fn cyclictest(duration: Duration) -> Option<Vec<u64>> {
    let loops = duration.as_millis().to_string();
    let output = Command::new("cyclictest")
        .args(["-q", "-i", "1000", "-h", "100000", "-l", &loops])
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout)
        .ok()
        .filter(|_| output.status.success())?;
    let mut times = Vec::new();
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let mut words = line.split_whitespace().map_while(|word| word.parse::<u64>().ok());
        if let (Some(us), Some(count)) = (words.next(), words.next()) {
            times.extend(std::iter::repeat_n(us * 1000, usize::try_from(count).unwrap_or(0)));
        }
    }
    Some(times)
}

/// Quantile of sorted times \[µs\].
fn quantile_us(sorted: &[u64], share: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    let index = ((sorted.len() as f64 * share).ceil() as usize)
        .saturating_sub(1)
        .min(last);
    sorted.get(index).map_or(f64::NAN, |&ns| ns as f64 / 1e3)
}

fn page(stages: &mut [(&str, Vec<u64>)], identifier: &Identifier, cyclictest: Option<&Vec<u64>>) -> String {
    let mut text =
        String::from("| stage | count | p50 [µs] | p99 [µs] | p99.9 [µs] | max [µs] |\n|---|--:|--:|--:|--:|--:|\n");
    let mut line = |name: &str, times: &mut Vec<u64>| {
        times.sort_unstable();
        let _ = write!(text, "| {name} | {} |", times.len());
        for share in [0.5, 0.99, 0.999, 1.0] {
            let _ = write!(text, " {:.1} |", quantile_us(times, share));
        }
        text.push('\n');
    };
    for (name, times) in stages.iter_mut() {
        line(name, times);
    }
    if let Some(times) = cyclictest {
        line("jitter, cyclictest", &mut times.clone());
    }
    if cyclictest.is_none() {
        text.push_str("\ncyclictest is not installed.\n");
    }
    let hop = stages.first().map_or(f64::NAN, |(_, times)| quantile_us(times, 0.5));
    let estimate = stages.get(2).map_or(f64::NAN, |(_, times)| quantile_us(times, 0.5));
    let block = identifier.block_mean_ns as f64 / 1e3;
    let _ = writeln!(
        text,
        "\nThe identifier, two joints at 1 kHz in blocks of {BLOCK_LEN}: first status {:.0} ms after its start, {:.2} % of a core, {:.1} MiB, {} ns a sample, {block:.1} µs a block, {} samples \
         lost. sample→estimate p50 is {:.2} × two hops and the block.",
        identifier.start_ms,
        identifier.cpu_percent,
        identifier.memory_mib,
        identifier.sample_mean_ns,
        identifier.lost,
        estimate / (2.0 * hop + block),
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_quantiles_are_times_that_were_measured() {
        let times: Vec<u64> = (1..=1000).map(|us| us * 1000).collect();
        for (share, us) in [(0.5, 500.0), (0.99, 990.0), (0.999, 999.0), (1.0, 1000.0)] {
            assert_eq!(quantile_us(&times, share), us);
        }
        assert!(quantile_us(&[], 0.5).is_nan());
    }

    #[test]
    fn prop_the_page_has_a_line_for_each_stage() {
        let mut stages = vec![
            ("hop", vec![2000, 1000]),
            ("receive", vec![3000]),
            ("estimate", vec![9000]),
        ];
        let identifier = Identifier {
            block_mean_ns: 3000,
            ..Identifier::default()
        };
        let page = page(&mut stages, &identifier, None);
        assert!(page.contains("| hop | 2 | 1.0 | 2.0 | 2.0 | 2.0 |\n"), "{page}");
        assert!(page.contains("1.80 × two hops and the block"), "{page}");
        assert!(page.contains("cyclictest is not installed"), "{page}");
    }
}
