#!/usr/bin/env python3
"""Holds the instructions of each stage from a sample to an estimate against stored counts.

  .ci/instructions.py            compares with benches/instructions.csv; more than 5 % above is an error
  .ci/instructions.py --write    stores what is counted now

Callgrind counts, so that neither the machine's speed nor what else it does plays a part. The counts belong to one version of
the compiler and one target, which are stored with them; with another compiler the comparison is printed and nothing fails.
Without valgrind the check says so and ends with 0, with 1 if THETABUS_REQUIRE_PEERS=1.
"""

import csv
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

SLACK = 0.05
ROOT = pathlib.Path(__file__).resolve().parent.parent
STORED = ROOT / "benches" / "instructions.csv"
# The same features each time: what a crate contains may change how its functions are laid out and inlined.
BUILD = [
    *"cargo build --release --locked --no-default-features --features recording,robot,sim --bench instructions".split(),
    "--message-format=json-render-diagnostics",
]


def program():
    """The path of the bench, built."""
    built = subprocess.run(BUILD, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    for line in built.splitlines():
        message = json.loads(line)
        if message.get("executable") and message["target"]["name"] == "instructions":
            return message["executable"]
    sys.exit("cargo built no bench called instructions")


def version():
    """The compiler and the target that counts belong to."""
    lines = subprocess.run(["rustc", "-vV"], check=True, stdout=subprocess.PIPE, text=True).stdout
    release, host = (re.search(rf"^{key}: (.*)$", lines, re.M)[1] for key in ("release", "host"))
    return f"rustc {release} {host}"


def count(path, stage):
    """Instructions inside `counted_work`."""
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", "--toggle-collect=*counted_work*", path, stage]
    # the same place in memory each time
    environment = {**os.environ, "LC_ALL": "C"}
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
    counts = {name: count(path, name) for name, _ in stages}
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
    failed, comparable = [], True
    for name, pieces in stages:
        if name not in stored:
            failed.append(f"{name}: expected a count in {STORED.relative_to(ROOT)}, got none")
            continue
        comparable &= stored[name]["with"] == version()
        change = counts[name] / int(stored[name]["instructions"]) - 1
        print(f"{name:<32} {counts[name] / pieces:14.0f} a piece {100 * change:+7.2f} %")
        if change > SLACK:
            failed.append(f"{name}: {100 * change:.1f} % more instructions than stored")
    failed += [f"{name}: stored, but there is no such stage" for name in stored if name not in counts]
    if failed and not comparable:
        print(f"the stored counts are those of another compiler than {version()}: nothing is judged", file=sys.stderr)
    elif failed:
        sys.exit("\n".join(failed) + "\nIf that is meant: .ci/instructions.py --write, and say why in the commit")


if __name__ == "__main__":
    main()
