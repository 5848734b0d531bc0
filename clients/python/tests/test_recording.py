"""Recordings as arrays."""

from __future__ import annotations

import csv

import pytest

import thetabus


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
