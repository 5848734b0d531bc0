//! Messages with arbitrary content.

use super::mutate::Random;
use crate::config::Config;
use crate::messages::{Command, Estimate, ParameterSet, Request, Sample, sample_flags};
use crate::recording::RunInfo;

pub(super) fn hostile_info(random: &mut Random, info: &mut RunInfo) {
    for _ in 0..random.below(4) {
        match random.below(9) {
            0 => info.joints = random.below(9),
            1 => info.simulated = !info.simulated,
            2 => info.parameters.truncate(random.below(10)),
            3 => info.derived = info.parameters.iter().take(random.below(9)).cloned().collect(),
            4 => info.equations = vec!["e".repeat(random.below(200)); random.below(9)],
            5 => info.input_unit = random.number(),
            6 => info.model = "m\u{1b}[2J".repeat(random.below(30)),
            7 => info.robot = random.pick(&["", "../..", "arm", "a b", "θ"]).to_owned(),
            _ => {
                let mut bytes = std::mem::take(&mut info.config_toml).into_bytes();
                random.mutate(&mut bytes);
                info.config_toml = String::from_utf8_lossy(&bytes).into_owned();
            }
        }
    }
}

pub(super) fn hostile_sample(random: &mut Random, sample: &mut Sample) {
    for _ in 0..=random.below(3) {
        let (whole, real, joint) = (random.whole(), random.real(), random.below(8));
        match random.below(12) {
            0 => sample.stream_id = whole,
            1 => sample.seq = whole,
            2 => sample.t_ns = whole,
            3 => sample.flags = whole as u32,
            4 => sample.flags |= sample_flags::END,
            5 => sample.joints = whole as u32,
            6 => sample.signals = whole as u32,
            7 => sample.q[joint] = real,
            8 => sample.dq[joint] = real,
            9 => sample.setpoint[joint] = real,
            10 => sample.input[joint] = real,
            _ => (sample.ddq[joint], sample.dddq[joint]) = (real, real),
        }
    }
}

pub(super) fn hostile_estimate(random: &mut Random, block: u64) -> Estimate {
    let reals: [f64; crate::model::MAX_PARAMS] = std::array::from_fn(|_| random.real());
    let mut wholes = || random.whole();
    Estimate {
        stream_id: 7,
        block: if wholes() % 2 == 0 { block } else { wholes() },
        t_first_ns: wholes(),
        t_last_ns: wholes(),
        model_hash: wholes(),
        config_hash: wholes(),
        accepted: wholes(),
        missing: wholes(),
        rejected: wholes(),
        excited: ParameterSet::from_bits(u128::from(wholes()) << 31),
        usable: ParameterSet::from_bits(u128::from(wholes())),
        fixed: ParameterSet::from_bits(u128::from(wholes()) << 64),
        t_change_ns: wholes(),
        state: wholes() as u32,
        use_ok: wholes() as u32,
        flags: wholes() as u32,
        params: wholes() as u32,
        equations: wholes() as u32,
        derived_len: wholes() as u32,
        iterations: wholes() as u32,
        outliers: wholes() as u32,
        condition: reals[0],
        theta: reals,
        theta_std: reals,
        ..crate::node::monitor::tests::estimate(1, reals[1])
    }
}

pub(super) fn hostile_request(random: &mut Random, config: &Config) -> Request {
    let mut request = Request::new(Command::Pause);
    request.command = match random.below(8) {
        0 => random.whole() as u32,
        _ => 1 + random.below(10) as u32,
    };
    let parameter = config.model.parameters()[random.below(config.model.parameters().len())]
        .name
        .as_ref();
    let names = [
        parameter,
        "forgetting_factor",
        "max_iterations",
        "change_margin_s",
        "gate_limit",
        "noise_floor_relative",
    ];
    request = request.named(random.pick(&names));
    if random.once_in(10) {
        request.name = std::array::from_fn(|_| random.next() as u8);
    }
    if random.once_in(2) {
        request = request.with_value(random.real());
    }
    request.flags = if random.once_in(10) {
        random.whole() as u32
    } else {
        request.flags
    };
    request.from_seq = if random.once_in(2) { 0 } else { random.whole() };
    if random.once_in(3) {
        (request.part, request.parts) = (random.below(3) as u32, random.below(4) as u32);
        request.data_len = random.whole() as u32;
        request.data.fill_with(|| random.next() as u8);
    }
    request
}
