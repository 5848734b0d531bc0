"""Programs of the project in a domain of their own, under a watchdog."""

from __future__ import annotations

import os
import pathlib
import shutil
import signal
import subprocess
import threading
import time
import uuid

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
WATCHDOG_S = 90.0


def programs() -> pathlib.Path:
    """Where plant_simulator and identifier are: THETABUS_BIN, or the release build."""
    return pathlib.Path(os.environ.get("THETABUS_BIN", ROOT / "target" / "release"))


class Site:
    """A domain with the programs that a test started there."""

    def __init__(self, directory: pathlib.Path) -> None:
        self.domain = "py" + uuid.uuid4().hex[:12]
        self.directory = directory
        self.running: list[subprocess.Popen[str]] = []

    def start(self, program: str, *arguments: str, config: str = "cedro2022.toml") -> subprocess.Popen[str]:
        path = programs() / program
        if not path.exists():
            pytest.fail(f"{path} is not there: cargo build --release, or name its directory in THETABUS_BIN")
        line = [str(path), *(["--config", str(ROOT / "config" / config)] if config else []), *arguments, "--domain", self.domain]
        process = subprocess.Popen(
            line, cwd=self.directory, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        self.running.append(process)
        # a program whose messages nobody reads would wait
        threading.Thread(target=lambda: process.stderr and process.stderr.read(), daemon=True).start()
        return process

    def close(self) -> None:
        for process in self.running:
            if process.poll() is None:
                process.kill()
            process.wait()
        runtime = os.environ.get("XDG_RUNTIME_DIR")
        root = pathlib.Path(runtime) / f"thetabus-{self.domain}" if runtime else pathlib.Path(f"/tmp/thetabus-{os.geteuid()}-{self.domain}")
        shutil.rmtree(root, ignore_errors=True)
        for left in pathlib.Path("/dev/shm").glob(f"thetabus_{os.geteuid()}_{self.domain}_*"):
            left.unlink(missing_ok=True)


@pytest.fixture
def site(tmp_path: pathlib.Path):
    found = Site(tmp_path)
    yield found
    found.close()


@pytest.fixture(autouse=True)
def watchdog():
    """Ends a test that hangs."""

    def end(*_: object) -> None:
        raise TimeoutError(f"not within {WATCHDOG_S} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(int(WATCHDOG_S))
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def eventually(what: str, condition):
    """Waits for a condition."""
    begun = time.monotonic()
    while time.monotonic() - begun < 60.0:
        found = condition()
        if found:
            return found
        time.sleep(0.01)
    raise AssertionError(f"not within 60 s: {what}")
