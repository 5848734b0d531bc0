"""Makes docs/speed.md from the medians of `cargo bench --bench stages`: `table.py [TARGET_DIRECTORY]` prints it."""

import csv
import json
import pathlib
import re
import sys

INSTRUCTIONS = pathlib.Path(__file__).resolve().parent.parent / "instructions.csv"
# What each stage is, and the target for one piece, if there is one: the most that it may take [ns].
STAGES = {
    "rows/pointwise/sample": ("a sample into pointwise rows, two joints", 12),
    "rows/projected/sample": ("a sample into projected rows, two joints", 120),
    "rows/projected/whitening": ("the weights of a projected block of 1900 samples", None),
    "rows/projected/block": ("the end of a projected block: its weights, and the update with them", 0.4e6),
    "block/p9/n475/iterations3": ("the update alone, 9 parameters, pointwise rows, by length of the block and largest number of iterations", None),
    "block/p9/n1900/iterations1": ("", None),
    "block/p9/n1900/iterations3": ("", None),
    "block/p9/n1900/iterations10": ("", None),
    "block/p9/n7600/iterations3": ("", None),
    "alarm/quiet": ("a settled block of 1900 without a change", None),
    "alarm/jump": ("the same with a change of the payload: alarm, location, fits of the parts", None),
    "alarm/worst": ("the same with four changes, one more than are looked for in a block", None),
    "axis/projected/sample": ("servo axis, 4 parameters: a sample into projected rows", None),
    "axis/projected/block": ("and the end of its block of 1900", None),
    "robot/regressors": ("six-axis robot: the regressors of momentum and energy at one state", None),
    "robot/sample": ("six-axis robot at 1 kHz, 70 parameters: a sample", 1.5e3),
    "robot/block": ("and the end of its block of 1000", 1.5e6),
    "robot/payload/block": ("the same with the watch over payload and friction, and its look at the last slice", 1.5e6),
    "recording/write": ("a sample into an MCAP recording", None),
    "recording/read": ("a sample out of an MCAP recording", None),
    "recording/identify": ("a sample off line: out of MCAP, into projected rows, and its share of ten settled blocks", 1e9 / 1.5e6),
}

HEAD = """# The time of each stage

This page lists the time and the instructions of each stage from a sample to an estimate.

Made by `cargo bench --no-default-features --features recording,robot,sim --bench stages -- --warm-up-time 0.3 --measurement-time 1.5` and
`python3 benches/stages/table.py > docs/speed.md`; do not edit.

Criterion on {machine}, one thread, f64; {load} before the table was made. Everything before the stage is prepared anew
for each measurement, so that memory is as cold as after other work.

- A piece is a sample or a block.
- If the fastest of the {count} measurements and their median are far apart, the machine was busy with other work.
- The instructions, from `benches/instructions.csv`, do not depend on other work; `.ci/instructions.py` checks them.
- The target is an upper limit for the median.

| stage | what it is | pieces | median of one | fastest | instructions | target | median ÷ target | fastest ÷ target |
|:--|:--|--:|--:|--:|--:|--:|--:|--:|"""


def shown(nanoseconds):
    for limit, size, unit in ((1e3, 1, "ns"), (1e6, 1e3, "µs"), (1e99, 1e6, "ms")):
        if nanoseconds < limit:
            return f"{nanoseconds / size:.3g} {unit}"


def machine():
    text = pathlib.Path("/proc/cpuinfo").read_text()
    name = re.search(r"^model name\s*: (.*)$", text, re.M)
    return f"{name[1] if name else 'an unknown processor'} (virtual machine, {len(re.findall(r'^processor', text, re.M))} cores)"


def load():
    return f"load {pathlib.Path('/proc/loadavg').read_text().split()[0]}"


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "target") / "criterion" / "stages"
    measured, count = {}, 0
    for file in root.glob("*/new/estimates.json"):
        about = json.loads((file.parent / "benchmark.json").read_text())
        pieces = about["throughput"]["Elements"]
        sample = json.loads((file.parent / "sample.json").read_text())
        count = len(sample["times"])
        fastest = min(time / iterations for time, iterations in zip(sample["times"], sample["iters"]))
        median = json.loads(file.read_text())["median"]["point_estimate"]
        measured[about["function_id"]] = (pieces, median / pieces, fastest / pieces)
    unknown = set(measured) ^ set(STAGES)
    if unknown:
        sys.exit(f"expected a median and a description of each stage, got one of them for {', '.join(sorted(unknown))}")
    with INSTRUCTIONS.open(newline="") as file:
        instructions = {row["stage"]: int(row["instructions"]) / int(row["pieces"]) for row in csv.DictReader(file)}
    print(HEAD.format(machine=machine(), load=load(), count=count))
    missed = {"median": [], "fastest": []}
    for name, (words, target) in STAGES.items():
        pieces, *times = measured[name]
        over = [f"{time / target:.2g}" if target else "–" for time in times]
        for which, time in zip(missed, times):
            if target and time > target:
                missed[which].append(f"`{name}` by {time / target:.2g} ×")
        cells = [f"`{name}`", words, pieces, *map(shown, times), f"{instructions[name]:.0f}", shown(target) if target else "–", *over]
        print("| " + " | ".join(map(str, cells)) + " |")
    for which, names in missed.items():
        print(f"\nTargets missed by the {which}: {', '.join(names) or 'none'}.")
    rates = {name: [1e3 / time for time in measured[f"recording/{name}"][1:]] for name in ("identify", "read")}
    for name, words in (("identify", "Off line from MCAP on one core"), ("read", "Reading alone")):
        print(f"\n{words}: {rates[name][0]:.2g} million samples a second by the median, {rates[name][1]:.2g} million by the fastest.")


if __name__ == "__main__":
    main()
