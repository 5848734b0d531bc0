"""Identification off line."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Mapping, Optional, Sequence, Union

import numpy as np

from . import _thetabus
from ._layout import DTYPES
from ._linear import LinearPlant, _numbers, _rows_as_samples, _seconds
from ._messages import Description, Estimate, Status
from ._recording import _SIGNALS, Recording


@dataclass(frozen=True)
class Identification:
    """What came out."""

    estimates: list[Estimate]
    """One per block."""
    description: Description
    """Names, units, meanings."""
    status: Status
    """Samples used, lost and refused, and the last error in words."""

    @property
    def last(self) -> Estimate:
        """The last estimate; LookupError if there is none."""
        if not self.estimates:
            raise LookupError(f"no block was completed: {self.status!r} {self.status.error}")
        return self.estimates[-1]


_SOURCES = 'a recording, its path or that of its directory, or arrays by signal: {"q": q, "input": torque}'
_MAX_JOINTS = DTYPES["Sample"]["q"].shape[0]


def _recording(source: Any) -> Recording:
    """The recording that was named; an error that says what else was named and what to do with it."""
    try:
        path = os.path.abspath(os.fsdecode(source))
    except TypeError:
        raise TypeError(f"source: expected {_SOURCES}; got {type(source).__name__}") from None
    if not os.path.exists(path):
        raise FileNotFoundError(f"source: expected {_SOURCES}; got {path}, which does not exist")
    if os.path.isdir(path) and not os.path.isfile(os.path.join(path, "recording.mcap")):
        raise ValueError(f"source: expected a directory of results with recording.mcap in it, got {path} without one")
    if path.lower().endswith((".csv", ".txt", ".tsv", ".log")):
        raise ValueError(
            f"source: expected {_SOURCES}; got {path}, a table: read it into arrays in SI units, for example with "
            f"numpy.genfromtxt(path, delimiter=',', names=True), or identify it by the command `thetabus identify {path} --config FILE.toml`"
        )
    return Recording(source)


def _samples(arrays: Mapping[str, Any], period_ns: int, model: str, joints_of_model: int) -> bytes:
    unknown = set(arrays) - {*_SIGNALS, "t_s"}
    if unknown:
        raise ValueError(f"expected signals out of {', '.join(_SIGNALS)} and t_s, got {', '.join(sorted(unknown))}")
    signals = {name: _numbers(name, values) for name, values in arrays.items() if name != "t_s"}
    signals = {name: values[:, None] if values.ndim == 1 else values for name, values in signals.items()}
    is_table = all(values.ndim == 2 for values in signals.values())
    if not signals or not is_table or len({values.shape for values in signals.values()}) != 1:
        shapes = ", ".join(f"{name} {values.shape}" for name, values in signals.items())
        raise ValueError(f"expected arrays of one shape, samples by joints, got {shapes or 'none'}")
    length, joints = next(iter(signals.values())).shape
    if joints != joints_of_model or joints > _MAX_JOINTS:
        first = next(iter(signals))
        raise ValueError(
            f"{first}: expected samples by {joints_of_model} joint(s), as many as the model {model} has, got the shape {signals[first].shape}"
        )
    if not length:
        raise ValueError("expected arrays with samples, got none")
    samples = np.zeros(length, dtype=DTYPES["Sample"])
    samples["stream_id"], samples["joints"] = 1, joints
    times = arrays.get("t_s")
    if times is None:
        samples["seq"] = np.arange(length)
        samples["t_ns"] = np.arange(length, dtype=np.uint64) * np.uint64(period_ns)
    else:
        seconds = _seconds(times, length)
        t_ns = np.round((seconds - seconds[0]) * 1e9)
        samples["t_ns"], samples["seq"] = t_ns, np.round(t_ns / period_ns)
    for name, values in signals.items():
        samples[name][:, :joints] = values
        samples["signals"] |= np.uint32(1 << _SIGNALS.index(name))
    samples["flags"][-1:] = 1
    return samples.tobytes()


def identify(
    source: Union[Recording, str, os.PathLike[str], Mapping[str, Any]],
    config: Optional[Union[str, os.PathLike[str]]] = None,
    *,
    set: Union[str, Sequence[str]] = (),
    plant: Optional[LinearPlant] = None,
    sample_period_s: Optional[float] = None,
) -> Identification:
    """Identifies off line, with the identifier's own code.

    `source`: a recording or its path, which has its configuration inside, or arrays by signal, samples by joints, SI and radians:
    `{"q": q, "input": torque}`, with `t_s` if samples are missing. `config`: a configuration file, needed for arrays. `set`:
    overrides, `"estimator.block_len=1000"`. Commands that a recorded run was given are not repeated; `thetabus identify` does.

    `plant`: a machine that is defined in Python, whose rows are made from the arrays, samples `sample_period_s` apart, 1 ms by default. Its
    estimator is that of every machine, so `config` and `set` may change what stands in section `estimator`.

    Robots from a URDF, and logs in CSV, are identified by the command `thetabus identify`.
    """
    overrides = [set] if isinstance(set, str) else list(set)
    if sample_period_s is not None:
        overrides.append(f"plant.sample_period_s={sample_period_s!r}")
    if plant is not None:
        if not isinstance(source, Mapping):
            raise TypeError("plant: expected arrays by signal as the source, not a recording")
        return _identify_linear(source, plant, config, overrides, sample_period_s or 1e-3)
    if not isinstance(source, (Recording, Mapping)):
        source = _recording(source)
    if isinstance(source, Recording):
        recorded, samples = source.info["config"], source.raw_samples.tobytes()
    else:
        # the sample period stands in the configuration, which a first look without samples gives
        described, _, _ = _thetabus.identify(config, None, overrides, b"")
        model = Description._of(described)
        recorded, samples = None, _samples(source, round(model.sample_period_s * 1e9), model.model, len(model.joints))
    return _outcome(*_thetabus.identify(config, recorded, overrides, samples))


def _identify_linear(
    arrays: Mapping[str, Any],
    plant: LinearPlant,
    config: Optional[Union[str, os.PathLike[str]]],
    overrides: list[str],
    sample_period_s: float,
) -> Identification:
    phi, y, samples = _rows_as_samples(*plant._evaluated(arrays), arrays.get("t_s"), round(sample_period_s * 1e9))
    found = _thetabus.identify_linear(
        plant._parameters(), plant.y_unit, y.shape[1], phi.tobytes(), y.tobytes(), config, overrides, samples
    )
    return _outcome(*found)


def _outcome(described: bytes, estimates: bytes, status: bytes) -> Identification:
    description = Description._of(described)
    size = DTYPES["Estimate"].itemsize
    parts = (estimates[at : at + size] for at in range(0, len(estimates), size))
    return Identification([Estimate(part, 0, description) for part in parts], description, Status(status))
