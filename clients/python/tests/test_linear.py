"""Machines that are defined in Python."""

from __future__ import annotations

import numpy as np
import pytest
import thetabus

MASS, FRICTION, OFFSET = 12.5, 3.2, -0.7
NAMES, UNITS = ["mass", "friction", "offset"], ["kg", "N s/m", "N"]


def motion(samples: int, noise_n: float, mass=MASS):
    """A driven axis: exact motion, force with noise; seeded."""
    t = 1e-3 * np.arange(samples)
    dq = 0.8 * np.sin(5.0 * t) + 0.3 * np.sin(23.0 * t + 1.0)
    ddq = 4.0 * np.cos(5.0 * t) + 6.9 * np.cos(23.0 * t + 1.0)
    force = mass * ddq + FRICTION * dq + OFFSET + noise_n * np.random.default_rng(15).normal(size=samples)
    return {"dq": dq, "ddq": ddq, "input": force}


def axis_rows(signals):
    dq, ddq = signals["dq"][:, 0], signals["ddq"][:, 0]
    return np.stack([ddq, dq, np.ones_like(dq)], axis=1), signals["input"][:, 0]


AXIS = thetabus.LinearPlant(NAMES, UNITS, axis_rows, y_unit="N")


def test_ident_an_axis_defined_in_python_is_least_squares_with_its_standard_deviations():
    arrays = motion(8000, 0.5)
    found = thetabus.identify(arrays, plant=AXIS, set=["estimator.block_len=1000", "estimator.forgetting_factor=1.0"])
    assert len(found.estimates) == 8
    last = found.last
    assert last.names == tuple(NAMES) and last.units == tuple(UNITS)
    phi, y = axis_rows({name: values[:, None] for name, values in arrays.items()})
    expected, *_ = np.linalg.lstsq(phi, y, rcond=None)
    std = 0.5 * np.sqrt(np.diag(np.linalg.inv(phi.T @ phi)))
    # What is known of the start, information 1e-6 beside 8000 rows, moves nothing that could be seen.
    np.testing.assert_allclose(last.values, expected, atol=0.05 * std.min())
    # Noise is learnt from 8000 rows, to 1 %, and a standard deviation counts what it was learnt from.
    np.testing.assert_allclose(last.std, std, rtol=0.15)
    assert last.use_ok and last.get("mass") is not None


def test_fault_a_load_that_changes_is_found_where_it_changed():
    before, after = motion(6300, 0.2), motion(12000, 0.2, MASS + 5.0)
    arrays = {name: np.concatenate([before[name], after[name][6300:]]) for name in before}
    found = thetabus.identify(arrays, plant=AXIS, set=["estimator.block_len=1000"])
    changed = [e for e in found.estimates if e.t_change_s is not None]
    assert changed and abs(changed[0].t_change_s - 6.3) < 0.05
    assert abs(found.last["mass"] - (MASS + 5.0)) < 0.05


def test_ident_two_equations_and_lost_samples():
    t = 1e-3 * np.arange(4000)
    a, b = np.sin(9.0 * t), np.cos(31.0 * t)
    theta = np.array([2.0, -4.0])

    def rows(signals):
        a, b = signals["q"].T
        phi = np.stack([np.stack([a, b], axis=1), np.stack([b, a], axis=1)], axis=1)
        return phi, signals["input"]

    y = np.stack([theta[0] * a + theta[1] * b, theta[0] * b + theta[1] * a], axis=1)
    y += 0.01 * np.random.default_rng(3).normal(size=y.shape)
    y[100] = np.nan
    kept = np.r_[0:500, 510:4000]
    plant = thetabus.LinearPlant(["a", "b"], ["", ""], rows)
    arrays = {"q": np.stack([a, b], axis=1)[kept], "input": y[kept], "t_s": t[kept]}
    found = thetabus.identify(arrays, plant=plant, set=["estimator.block_len=500"])
    np.testing.assert_allclose(found.last.values, theta, atol=0.005)
    assert found.status.missing == 11


def test_fault_what_does_not_fit_is_said():
    arrays = motion(1000, 0.0)
    wrong = thetabus.LinearPlant(NAMES, UNITS, lambda s: (np.ones((1000, 2)), np.ones(1000)))
    with pytest.raises(ValueError, match=r"by 3 parameters .* got \(1000, 1, 2\)"):
        thetabus.identify(arrays, plant=wrong)
    with pytest.raises(ValueError, match="a unit and a start for each of 3 parameters, got 1 units"):
        thetabus.identify(arrays, plant=thetabus.LinearPlant(NAMES, ["kg"], axis_rows))
    with pytest.raises(TypeError, match="expected phi and y"):
        thetabus.identify(arrays, plant=thetabus.LinearPlant(NAMES, UNITS, lambda s: None))
    with pytest.raises(ValueError, match="two parameters are called mass"):
        thetabus.identify(arrays, plant=thetabus.LinearPlant(["mass", "mass", "c"], UNITS, axis_rows))
    with pytest.raises(thetabus.ThetabusError, match="block_len"):
        thetabus.identify(arrays, plant=AXIS, set=["estimator.block_len=0"])
    with pytest.raises(TypeError, match="arrays"):
        thetabus.identify("somewhere", plant=AXIS)

    def fails(signals):
        raise RuntimeError("its own words")

    with pytest.raises(RuntimeError, match="its own words"):
        thetabus.identify(arrays, plant=thetabus.LinearPlant(NAMES, UNITS, fails))
