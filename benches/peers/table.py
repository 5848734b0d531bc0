"""Makes a page from the lines of one run: `table.py LINES.csv`."""

import csv
import sys

JOBS = {
    "rows": "Recursive least squares on given rows, two equations of five parameters",
    "samples": "From samples with exact derivatives to estimates, rows, blocks and alarms included",
    "log": "From positions and voltages alone, 16 bits, 0.05 V of noise",
}


HEAD = """# Beside other programs

Made by `benches/peers/run.sh`; do not edit.

Everything here ran in one go on one machine, one thread each, on the same data: the arm of the paper with 150 kg, sines, 38 s at 1 kHz. Times differ from
machine to machine, their ratios less so. Rust and C++: the fastest of five runs; Python: processor time of one run. Errors are relative, over the nine
parameters, after the last sample. The recursions start from 0 with a variance of 1e6 and forget nothing; everything else starts from the values of
`config/encoder_only.toml`, a factor of 2.5 off.

- **PX4's form**: the recursion that flight controllers run, written anew in C++ (`benches/peers/arx_rls.cpp`). PX4's own class has past inputs and outputs for
  regressors; here it gets the rows of the arm.
- **flight-solver** 0.2.2 and **oxictl** 0.1.1 are crates with recursive least squares. flight-solver works in single precision.
- **numpy**, **padasip**, **filterpy**, **CasADi**, **scipy** as in `benches/peers/requirements.txt`. Python's loop is in these times, as a user of Python has it.
- The Kalman filters have θ in their state and know the model and the noise. CasADi's Gauss-Newton fits simulated positions to the whole recording, with the
  recorded voltages for exact; scipy fits the equations to positions that a Savitzky-Golay filter differentiates.
- None of them says when it may be used, finds a change or tells a model that is wrong; thetabus' times include that.
"""


def number(value):
    return f"{value:.2g}" if value < 10 else f"{value:,.0f}".replace(",", " ")


def percent(share):
    return "diverged" if not share < 10 else f"{100 * share:.2g} %"


def main():
    with open(sys.argv[1], newline="") as file:
        lines = list(csv.reader(file))
    print(HEAD.rstrip())
    for job, words in JOBS.items():
        of_job = [line for line in lines if line[0] == job]
        if not of_job:
            continue
        ours = next((float(line[3]) for line in of_job if line[1].startswith("thetabus")), None)
        print(f"\n## {words}\n")
        print("| estimator | samples | ns a sample | × ours | worst error of θ | median error |")
        print("|:--|--:|--:|--:|--:|--:|")
        for _, name, samples, each, worst, median in of_job:
            each = float(each)
            print(f"| {name} | {samples} | {number(each)} | {number(each / ours) if ours else "–"} | {percent(float(worst))} | {percent(float(median))} |")


if __name__ == "__main__":
    main()
