"""Processor time per message in each language, in one run.

    cargo build --release -p thetabus-c --lib --example cost
    pip install ./clients/python
    python clients/cost/cost.py target/release [COUNT]

A sample of two joints, 424 bytes, goes from one process to another that waits for each. The other side is always the Rust one. Prints a table.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent


def used_ns():
    """Time that this thread has run, proc_pid_schedstat."""
    return float(pathlib.Path("/proc/self/schedstat").read_text().split()[0])


def measured(mode, count, domain):
    """This language's own part."""
    import thetabus

    if mode == "publish":
        with thetabus.Machine(joints=2, domain=domain, consumers=1, consumer_timeout=20.0) as machine:
            begun = used_ns()
            for k in range(count):
                machine.publish(q=[1e-3 * k, 1e-3 * k], input=[0.0, 0.0], t_ns=k * 1_000_000)
            return (used_ns() - begun) / count
    total = 0.0
    with thetabus.Samples(domain=domain) as samples:
        samples.next()
        begun = used_ns()
        for _ in range(1, count):
            total += samples.next().q[0]
        used = used_ns() - begun
    assert total > 0.0
    return used / count


def compiled(compiler, source, build, directory):
    program = directory / source.replace(".", "_")
    line = [compiler, "-O2", "-I", str(HERE.parent / "c" / "include"), str(HERE / source), "-o", str(program)]
    subprocess.run([*line, "-L", str(build), f"-Wl,-rpath,{build}", "-lthetabus_c"], check=True)
    return [str(program)]


def main(build, count):
    build = pathlib.Path(build).resolve()
    with tempfile.TemporaryDirectory() as directory:
        rust = [str(build / "examples" / "cost")]
        programs = {
            "Rust": rust,
            "C": compiled("gcc", "cost.c", build, pathlib.Path(directory)),
            "C++": compiled("g++", "cost.cpp", build, pathlib.Path(directory)),
            "Python": [sys.executable, str(HERE / "cost.py")],
        }
        print(f"Samples: {count}.\n\n| language | read | publish |\n|---|--:|--:|")
        for index, (name, program) in enumerate(programs.items()):
            cells = []
            for mode, other in (("read", "publish"), ("publish", "read")):
                domain = f"cost{os.getpid()}-{index}{mode[0]}"
                tail = [str(count), domain]
                with subprocess.Popen([*rust, other, *tail], stdout=subprocess.DEVNULL) as partner:
                    said = subprocess.run([*program, mode, *tail], check=True, capture_output=True, text=True).stdout
                    partner.wait(60)
                cells.append(f"{float(said) * 1e-3:.2f} us")
            print(f"| {name} | {cells[0]} | {cells[1]} |", flush=True)


if __name__ == "__main__":
    if sys.argv[1] in ("read", "publish"):
        print(measured(sys.argv[1], int(sys.argv[2]), sys.argv[3]))
    else:
        main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 200_000)
