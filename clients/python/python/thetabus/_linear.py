"""Machines that are defined in Python: equations that are linear in their parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Mapping, Optional, Sequence

import numpy as np
import numpy.typing as npt

from ._layout import DTYPES

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LinearPlant:
    """A machine whose equations are linear in its parameters: y = phi @ theta, a row per equation and sample.

    >>> def rows(signals):                                       # a mass with viscous friction
    ...     return np.stack([signals["ddq"][:, 0], signals["dq"][:, 0]], axis=1), signals["input"][:, 0]
    >>> axis = thetabus.LinearPlant(["mass", "friction"], ["kg", "N s/m"], rows, y_unit="N")   # doctest: +SKIP
    """

    names: Sequence[str]
    """Names of the parameters, up to 128."""
    units: Sequence[str]
    """Their units, as many."""
    rows: Callable[[Mapping[str, Array]], tuple[Any, Any]]
    """Regressor function: gets the arrays that `identify` was given, each of shape (samples, joints) and `t_s` of shape (samples,) if it was given, and
    returns phi of shape (samples, equations, parameters) and y of shape (samples, equations); with one equation the axis of the equations may be left
    out. Rows that are not finite are left out as samples that were lost. Up to 8 equations."""
    y_unit: str = ""
    """Unit of y."""
    start: Optional[Sequence[float]] = None
    """Where the estimator begins, an order of magnitude for each parameter; 1 by default."""

    def _parameters(self) -> list[tuple[str, str, float]]:
        names, units = list(self.names), list(self.units)
        start = [1.0] * len(names) if self.start is None else [float(x) for x in self.start]
        if not len(names) == len(units) == len(start):
            raise ValueError(
                f"expected a unit and a start for each of {len(names)} parameters, got {len(units)} units and {len(start)} starts"
            )
        return list(zip(names, units, start))

    def _evaluated(self, arrays: Mapping[str, Any]) -> tuple[Array, Array]:
        """phi by samples, equations, parameters, and y by samples, equations."""
        signals = {name: np.asarray(values, dtype=np.float64) for name, values in arrays.items()}
        for name, values in signals.items():
            if name != "t_s" and values.ndim == 1:
                signals[name] = values[:, None]
        found = self.rows(signals)
        if not isinstance(found, tuple) or len(found) != 2:
            raise TypeError(f"rows: expected phi and y, got {type(found).__name__}")
        phi, y = (np.ascontiguousarray(part, dtype=np.float64) for part in found)
        phi = phi[:, None, :] if phi.ndim == 2 else phi
        y = y[:, None] if y.ndim == 1 else y
        if phi.ndim != 3 or y.ndim != 2 or phi.shape != (*y.shape, len(self.names)):
            raise ValueError(
                f"rows: expected phi of samples by equations by {len(self.names)} parameters and y of samples by equations, "
                f"got {phi.shape} and {y.shape}"
            )
        return phi, y


def _numbers(name: str, values: Any) -> Array:
    """Values as an array of numbers; ValueError with their name if they are none."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: expected an array of numbers, got {type(values).__name__} ({error})") from None


def _seconds(times: Any, length: int) -> Array:
    """Times of samples [s]: one for each, finite and in their order; ValueError with the first that is not."""
    seconds = _numbers("t_s", times)
    if seconds.shape != (length,):
        raise ValueError(f"t_s: expected {length} times, one for each sample, got an array of the shape {seconds.shape}")
    wrong = np.flatnonzero(~np.isfinite(seconds))
    if len(wrong):
        raise ValueError(f"t_s: expected finite times in s, got {seconds[wrong[0]]} at index {wrong[0]}; leave such samples out")
    back = np.flatnonzero(np.diff(seconds) <= 0)
    if len(back):
        before, after = seconds[back[0] : back[0] + 2]
        raise ValueError(f"t_s: expected times that rise, got {after} s after {before} s at index {back[0] + 1}; sort the samples by time")
    return seconds


def _rows_as_samples(phi: Array, y: Array, t_s: Any, period_ns: int) -> tuple[Array, Array, bytes]:
    """phi and y on the grid of the sample period, and a sample for each of their rows that is finite."""
    length, equations = y.shape
    if t_s is None:
        index = np.arange(length)
    else:
        seconds = _seconds(t_s, length)
        index = np.round((seconds - seconds[0]) * 1e9 / period_ns).astype(np.int64)
        if length > 1 and np.diff(index).min() < 1:
            raise ValueError("t_s: expected times that rise by a sample period or more")
        grid = int(index[-1]) + 1 if length else 0
        if grid > 100 * max(length, 1):
            raise ValueError(f"t_s: {length} samples over {grid} sample periods of {period_ns * 1e-9} s; state sample_period_s")
        spread_phi, spread_y = np.zeros((grid, *phi.shape[1:])), np.zeros((grid, equations))
        spread_phi[index], spread_y[index] = phi, y
        phi, y, index = spread_phi, spread_y, index
    finite = np.isfinite(phi[index]).all(axis=(1, 2)) & np.isfinite(y[index]).all(axis=1)
    index = index[finite]
    samples = np.zeros(len(index), dtype=DTYPES["Sample"])
    samples["stream_id"], samples["joints"] = 1, equations
    samples["seq"] = index
    samples["t_ns"] = index.astype(np.uint64) * np.uint64(period_ns)
    samples["signals"] = 32
    samples["input"][:, :equations] = y[index]
    samples["flags"][-1:] = 1
    return phi, y, samples.tobytes()
