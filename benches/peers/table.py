"""Makes a page from the lines of one run: `table.py LINES.csv`."""

import csv
import sys

JOBS = {
    "rows": "Recursive least squares on given rows, two equations of five parameters",
    "samples": "From samples with exact derivatives to estimates",
    "log": "From positions and voltages alone, 16 bits, 0.05 V of noise",
    "robot": "A six-axis robot from positions, velocities and torques of 40 s",
}

# Why a goal is not met, or what there is to compare.
NOTES = {
    "rows": "All programs do the same arithmetic, so no program can be 5 × faster. The size is known to the C++ "
    "at compile time. Wrls takes any number of parameters, keeps the covariance as U D Uᵀ, which stays positive after any number "
    "of samples, and refuses rows that are not finite.",
    "samples": "No other program here does this job.",
}

HEAD = """# Beside other programs

This page compares accuracy and speed with other programs on the same data.

Made by `benches/peers/run.sh docs/peers.md`; do not edit.

Everything here ran in one go on one machine, one thread each, on the same data: the arm of the paper with 150 kg, sines, 38 s at 1 kHz. Times are the fastest of 15
runs for Rust and C++, and the processor time of one run for Python. On a shared machine, ratios to Python change by a third from run to run, and single lines of Rust by
more.

Errors are relative, after the last sample, over the five parameters that this motion determines to 1 %: θ₂, θ₅, θ₇, θ₈, θ₉. The recursions start from 0 with a variance
of 10 and forget nothing. The others start from the values of `config/encoder_only.toml`, a factor of 2.5 off, unless the table says otherwise.

- **PX4's form**: the recursion that flight controllers run, rewritten in C++ (`benches/peers/arx_rls.cpp`). The regressors of PX4's own class are past inputs and
  outputs; here they are the rows of the arm.
- **flight-solver** 0.2.2 and **oxictl** 0.1.1 are crates with recursive least squares. flight-solver works in single precision.
- **numpy**, **padasip**, **filterpy**, **CasADi**, **scipy**, **pinocchio** as in `benches/peers/requirements.txt`. Their times include Python's loop, as for any
  user of Python. The unscented filter takes only the first 7.6 s, because it needs 2 ms a sample.
- filterpy's Kalman filters have θ in their state and know the model and the noise. CasADi's Gauss-Newton fits simulated positions to the whole recording, and
  takes the recorded voltages as exact; scipy fits the equations to positions that a Savitzky-Golay filter differentiates.
- **pinocchio**'s regressor with least squares has all ten parameters of each body, rotors, and friction with tanh(q̇/0.01); thetabus has base parameters, and
  friction that engages over a distance, as the simulated robot's does. The errors of this job are the residuals of the torques of another motion, relative to the
  torques, worst and median joint; 0.5 % of each drive's limit is noise.
- None of them marks usable estimates, detects changes, or reports a wrong model. The times of thetabus include this, except in the first job.
"""


def number(value):
    if value != value:
        return "–"
    return f"{value:.2g}" if value < 10 else f"{value:,.0f}".replace(",", " ")


def percent(share):
    return "diverged" if not share < 10 else f"{100 * share:.2g} %"


def section(job, lines):
    """Lines are (name, samples, ns a sample, worst, median); the first is thetabus."""
    ours, others = lines[0], lines[1:]
    worst, median = ("worst residual", "median residual") if job == "robot" else ("worst error", "median error")
    yield f"\n## {JOBS[job]}\n"
    yield f"| estimator | samples | ns a sample | × thetabus | {worst} | {median} |"
    yield "|:--|--:|--:|--:|--:|--:|"
    for name, samples, each, *errors in lines:
        times, errors = number(each / ours[2]), " | ".join(map(percent, errors))
        yield f"| {name} | {samples} | {number(each)} | {times} | {errors} |"
    if others:
        faster = [line[0] for line in others if line[2] < ours[2] and line[3] < 10]
        nearer = [line[0] for line in others if line[3] < 0.9 * ours[3]]
        fastest = min(line[2] for line in others if line[3] < 10)
        yield (
            f"\nFaster than thetabus: {', '.join(faster) or 'none'}. Worst error smaller "
            f"by a tenth or more: {', '.join(nearer) or 'none'}. The fastest that did not diverge takes "
            f"{number(fastest / ours[2])} × the time of thetabus; the goal is 5."
        )
    if job in NOTES:
        yield f"\n{NOTES[job]}"


def main():
    jobs = {job: [] for job in JOBS}
    with open(sys.argv[1], newline="") as file:
        for job, name, samples, *figures in csv.reader(file):
            jobs[job].append((name, samples, *map(float, figures)))
    print(HEAD.rstrip())
    for job, lines in jobs.items():
        if not lines or not lines[0][0].startswith("thetabus"):
            sys.exit(f"{job}: expected a line of thetabus first, got {lines}")
        print("\n".join(section(job, lines)))


if __name__ == "__main__":
    main()
