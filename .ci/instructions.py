#!/usr/bin/env python3
"""Holds the instructions of each stage from a sample to an estimate against stored counts.

  .ci/instructions.py            compares with benches/instructions.csv; more than 5 % above is an error
  .ci/instructions.py --write    stores what is counted now

Callgrind counts, so that neither the machine's speed nor what else it does plays a part. Counts of the same program differ by
1e-4 at most (hash maps have random seeds). libc chooses its memset and its sine by the processor, which makes 8 % of a
pointwise sample and a factor of 3 of a projected one (valgrind counts each byte of a `rep stosb`); it is told here to take
the plain ones. Tried on one machine alone. With another compiler, target or libc than the stored counts were made with, the
comparison is printed and not judged. A stage without a count, or a count without its stage, is an error everywhere. Without
valgrind the check says so and ends with 0, with 1 if THETABUS_REQUIRE_PEERS=1.
"""

import concurrent.futures
import csv
import json
import os
import pathlib
import platform
import re
import shutil
import subprocess
import sys

# The compiler inlines and lays out differently when other code changes; that stays below.
SLACK = 0.05
ROOT = pathlib.Path(__file__).resolve().parent.parent
STORED = ROOT / "benches" / "instructions.csv"
# The default features, because the gate has built the library with them, and always the same, because what a crate contains
# changes how its functions are inlined.
BUILD = [
    *"cargo build --release --locked --bench instructions".split(),
    "--message-format=json-render-diagnostics",
]
PLAIN = "glibc.cpu.hwcaps=-AVX,-AVX2,-AVX512F,-AVX512VL,-BMI1,-BMI2,-ERMS,-FMA,-FMA4,-FSRM,-LZCNT,-RTM"


def program():
    """The path of the bench, built as the gate builds."""
    environment = {**os.environ, "CARGO_INCREMENTAL": "0"}
    environment.pop("CARGO_PROFILE_RELEASE_INCREMENTAL", None)
    built = subprocess.run(BUILD, cwd=ROOT, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout
    for line in built.splitlines():
        message = json.loads(line)
        if message.get("executable") and message["target"]["name"] == "instructions":
            return message["executable"]
    sys.exit("cargo built no bench called instructions")


def version():
    """The compiler, the target and the libc that counts belong to."""
    lines = subprocess.run(["rustc", "-vV"], check=True, stdout=subprocess.PIPE, text=True).stdout
    release, host = (re.search(rf"^{key}: (.*)$", lines, re.M)[1] for key in ("release", "host"))
    return f"rustc {release} {host} {' '.join(platform.libc_ver())}"


def count(path, stage):
    """Instructions inside `counted_work`."""
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", "--toggle-collect=*counted_work*", path, stage]
    environment = {**os.environ, "LC_ALL": "C", "GLIBC_TUNABLES": PLAIN}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    found = re.search(r"Collected : (\d+)", done.stderr)
    if done.returncode != 0 or found is None or int(found[1]) == 0:
        sys.exit(f"{stage}: valgrind counted nothing\n{done.stderr}")
    return int(found[1])


def main():
    if shutil.which("valgrind") is None:
        print("instructions: not counted, valgrind is missing: apt-get install valgrind", file=sys.stderr)
        sys.exit(os.environ.get("THETABUS_REQUIRE_PEERS") == "1")
    path = program()
    listed = subprocess.run([path, "--list"], check=True, stdout=subprocess.PIPE, text=True).stdout
    stages = [(name, int(pieces)) for name, pieces in (line.split() for line in listed.splitlines())]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        counts = dict(zip(dict(stages), pool.map(lambda stage: count(path, stage[0]), stages)))
    if "--write" in sys.argv[1:]:
        with STORED.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["stage", "pieces", "instructions", "with"])
            writer.writerows([name, pieces, counts[name], version()] for name, pieces in stages)
        print(f"{STORED.relative_to(ROOT)}: written")
        return
    if not STORED.exists():
        sys.exit(f"{STORED.relative_to(ROOT)}: expected stored counts, got none: .ci/instructions.py --write")
    with STORED.open(newline="") as file:
        stored = {row["stage"]: row for row in csv.DictReader(file)}
    faults = [f"{name}: expected a count in {STORED.relative_to(ROOT)}, got none" for name in counts if name not in stored]
    faults += [f"{name}: stored, but there is no such stage" for name in stored if name not in counts]
    slower, own, comparable = [], version(), True
    for name, pieces in stages:
        if name not in stored:
            continue
        comparable &= stored[name]["with"] == own
        change = counts[name] / int(stored[name]["instructions"]) - 1
        print(f"{name:<32} {counts[name] / pieces:14.0f} a piece {100 * change:+7.2f} %")
        if change > SLACK:
            slower.append(f"{name}: {100 * change:.1f} % more instructions than stored")
    if comparable:
        faults += slower
    else:
        print(f"not judged: the stored counts are of another compiler, target or libc than {own}", file=sys.stderr)
    if faults:
        sys.exit("\n".join(faults) + "\nIf that is meant: .ci/instructions.py --write, and say why in the commit")


if __name__ == "__main__":
    main()
