"""Prints the medians of `cargo bench --bench stages` as a table: `table.py [target]`."""

import json
import pathlib
import sys


def shown(nanoseconds):
    for limit, size, unit in ((1e3, 1, "ns"), (1e6, 1e3, "µs"), (1e99, 1e6, "ms")):
        if nanoseconds < limit:
            return f"{nanoseconds / size:.3g} {unit}"


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "target") / "criterion" / "stages"
    print("| stage | pieces | median of one |\n|:--|--:|--:|")
    for file in sorted(root.glob("*/new/estimates.json")):
        about = json.loads((file.parent / "benchmark.json").read_text())
        pieces = about["throughput"]["Elements"]
        median = json.loads(file.read_text())["median"]["point_estimate"]
        print(f"| {about['function_id']} | {pieces} | {shown(median / pieces)} |")


if __name__ == "__main__":
    main()
