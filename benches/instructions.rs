//! One stage under valgrind, which counts its instructions: `instructions STAGE`, or `instructions
//! --list`.
//!
//! `.ci/instructions.py` runs it for every stage and holds the counts against
//! benches/instructions.csv. Nothing here measures time, so that what other programs do on the
//! machine does not count.

#[path = "stages/all.rs"]
mod all;

/// Callgrind collects inside this function alone.
#[inline(never)]
fn counted_work(work: &mut all::Work) {
    work();
}

fn main() {
    // cargo bench passes --bench
    let argument = std::env::args().skip(1).find(|argument| argument != "--bench");
    match argument.as_deref() {
        Some("--list") | None => {
            for stage in all::stages("") {
                println!("{} {}", stage.name, stage.pieces);
            }
        }
        Some(name) => {
            let stages = all::stages(name);
            let Some(stage) = stages.iter().find(|stage| stage.name == name) else {
                eprintln!("expected a stage that --list names, got {name}");
                std::process::exit(2);
            };
            counted_work(&mut (stage.ready)());
        }
    }
}
