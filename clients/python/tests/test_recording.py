"""Recordings as arrays."""

from __future__ import annotations

import csv

import numpy as np
import pytest

import thetabus
from conftest import ROOT


def test_e2e_a_recording_has_the_run_in_arrays(site):
    out = site.directory / "out"
    run = site.start(
        "thetabus", "run", "--out", str(out), "--duration", "4", "--set", "estimator.block_len=200", config=""
    )
    assert run.wait() == 0
    recording = thetabus.Recording(out)
    assert recording.loss is None and recording.info["robot"] == "arm"
    samples, estimates = recording.samples, recording.estimates
    assert samples["seq"].tolist() == list(range(4000)) and samples["t_s"][-1] == pytest.approx(3.999)
    assert samples["q_1"].shape == samples["input_2"].shape == (4000,)
    with open(out / "estimates.csv") as table:
        rows = list(csv.DictReader(table))
    assert len(rows) == len(estimates["block"])
    for name in recording.names:
        assert [float(row[name]) for row in rows] == estimates[name].tolist()
    half = thetabus.Recording(out, from_s=1.0, to_s=1.999)
    assert half.samples["seq"].tolist() == list(range(1000, 2000))
    with pytest.raises(thetabus.ThetabusError, match="no.mcap"):
        thetabus.Recording(out / "no.mcap")
    # the same code off line: the same estimates to the bit
    again = thetabus.identify(recording)
    assert len(again.estimates) == len(rows) and again.status.missing == 0
    for e, row in zip(again.estimates, rows):
        assert [float(row[name]) for name in e.names] == e.values.tolist()


def test_ident_arrays_are_identified_with_a_configuration(site):
    """10 kg, 4 N s/m: x'' = (u - 4 x')/10, with the drive's gain of config/servo_axis.toml."""
    x, v, q, u = 0.0, 0.0, [], []
    for k in range(8000):
        t = k * 1e-3
        u.append(2.0 * np.sin(5 * t) + 1.5 * np.sin(17 * t) + np.sin(31 * t))
        q.append(x)
        for _ in range(10):
            v += 1e-4 * (u[-1] - 4.0 * v) / 10.0
            x += 1e-4 * v
    config = ROOT / "config" / "servo_axis.toml"
    keys = ["estimator.block_len=1000", 'identifier.projected.timing="held"']
    found = thetabus.identify({"q": q, "input": u}, config, set=keys)
    assert [e.block for e in found.estimates] == list(range(1, 9))
    assert found.last["mass"] == pytest.approx(10 * 35.15065188, rel=5e-3)
    # a hole is counted, not stretched
    keep = np.r_[0:3500, 3600:8000]
    holed = {"q": np.array(q)[keep], "input": np.array(u)[keep], "t_s": keep * 1e-3}
    assert thetabus.identify(holed, config, set=keys).status.missing == 100
    with pytest.raises(ValueError, match="configuration file"):
        thetabus.identify({"q": q, "input": u})
    with pytest.raises(ValueError, match="one shape"):
        thetabus.identify({"q": q, "input": u[1:]}, config)
    with pytest.raises(thetabus.ThetabusError, match="block_lenn"):
        thetabus.identify({"q": q, "input": u}, config, set=["estimator.block_lenn=1"])


def test_fault_a_wrong_source_is_named_with_what_to_do(tmp_path):
    config = ROOT / "config" / "servo_axis.toml"
    table = tmp_path / "log.csv"
    table.write_text("t_s,q\n0,1\n")
    q = np.zeros(100)
    cases = [
        (table, None, ValueError, "log.csv, a table: read it into arrays.*thetabus identify"),
        (tmp_path / "none", None, FileNotFoundError, "none, which does not exist"),
        (tmp_path, None, ValueError, "recording.mcap in it"),
        (config, None, thetabus.ThetabusError, "not a recording"),
        ([1.0], None, TypeError, "expected a recording.*got list"),
        ({"q": q, "input": q}, ROOT / "config/robots/six_axis.toml", thetabus.ThetabusError, "robots from a URDF are identified by the command"),
        ({"q": np.zeros((9, 2)), "input": np.zeros((9, 2))}, config, ValueError, r"1 joint\(s\).*servo_axis has, got the shape \(9, 2\)"),
        ({"q": np.zeros((9, 1, 1)), "input": np.zeros((9, 1, 1))}, config, ValueError, "samples by joints"),
        ({"q": 1.0, "input": 2.0}, config, ValueError, "samples by joints"),
        ({"q": "abc", "input": q}, config, ValueError, "q: expected an array of numbers, got str"),
        ({"q": q[:0], "input": q[:0]}, config, ValueError, "got none"),
        ({"q": q, "input": q, "t_s": q[:5]}, config, ValueError, "t_s: expected 100 times"),
        ({"q": q, "input": q, "t_s": q}, config, ValueError, "got 0.0 s after 0.0 s at index 1"),
        ({"q": q, "input": q, "t_s": q * np.nan}, config, ValueError, "got nan at index 0"),
    ]
    for source, file, error, words in cases:
        with pytest.raises(error, match=words):
            thetabus.identify(source, file)
