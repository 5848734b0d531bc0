"""Recordings as arrays."""

from __future__ import annotations

import os
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from ._layout import members, records
from ._thetabus import recording

_SIGNALS = ("q", "dq", "ddq", "dddq", "setpoint", "input")


class Recording:
    """A recording, or the directory of results that holds one, with its samples, estimates and status as arrays.

    >>> r = thetabus.Recording("thetabus-out/now")      # doctest: +SKIP
    >>> r.samples["t_s"], r.samples["q_1"], r.estimates["theta_7"]
    """

    def __init__(self, path: Union[str, os.PathLike[str]], *, from_s: float = 0.0, to_s: float = float("inf")) -> None:
        """Reads what lies from `from_s` to `to_s` of stream time; what was lost stands in `loss`."""
        path = os.fspath(path)
        if os.path.isdir(path):
            path = os.path.join(path, "recording.mcap")
        end = (1 << 64) - 1 if to_s * 1e9 >= 2**64 - 1 else int(to_s * 1e9)
        info, samples, estimates, statuses = recording(path, int(from_s * 1e9), end)
        self.info: dict[str, Any] = info
        """Robot, model, configuration (TOML), units, names."""
        self.loss: Union[str, None] = info["loss"]
        """What the recording has lost, in words; None if nothing."""
        self.raw_samples: npt.NDArray[np.void] = records("Sample", samples)
        """All fields of all samples, as `thetabus.dtype("Sample")` names them."""
        self.raw_estimates: npt.NDArray[np.void] = records("Estimate", estimates)
        """All fields of all estimates."""
        self.raw_status: npt.NDArray[np.void] = records("Status", statuses)
        """All fields of all status messages."""

    @property
    def names(self) -> list[str]:
        """Names of the parameters, in the order of theta."""
        return [name for name, _ in self.info["parameters"]]

    @property
    def units(self) -> dict[str, str]:
        """Units by name, of parameters and derived values."""
        return dict(self.info["parameters"] + self.info["derived"])

    @property
    def samples(self) -> dict[str, npt.NDArray[Any]]:
        """A column per signal that was measured: `seq`, `t_s`, `q_1`, `input_1` ..."""
        raw = self.raw_samples
        columns: dict[str, npt.NDArray[Any]] = {"seq": raw["seq"], "t_s": raw["t_ns"] * 1e-9}
        for bit, name in enumerate(_SIGNALS):
            if len(raw) and (raw["signals"] >> np.uint32(bit) & 1).any():
                for joint in range(self.info["joints"]):
                    columns[f"{name}_{joint + 1}"] = raw[name][:, joint]
        return columns

    @property
    def estimates(self) -> dict[str, npt.NDArray[Any]]:
        """A column per value, as in estimates.csv: `block`, `t_s`, `use_ok`, `theta_1`, `theta_1_std`, `theta_1_usable` ..."""
        raw = self.raw_estimates
        columns: dict[str, npt.NDArray[Any]] = {
            "block": raw["block"],
            "t_s": raw["t_last_ns"] * 1e-9,
            "state": raw["state"],
            "use_ok": raw["use_ok"] == 1,
        }
        count = len(self.names)
        usable = np.array([members(words, count) for words in raw["usable"]], dtype=bool).reshape(len(raw), count)
        for i, name in enumerate(self.names):
            columns[name], columns[f"{name}_std"] = raw["theta"][:, i], raw["theta_std"][:, i]
            columns[f"{name}_usable"] = usable[:, i] & columns["use_ok"]
        for i, (name, _) in enumerate(self.info["derived"]):
            columns[name], columns[f"{name}_std"] = raw["derived"][:, i], raw["derived_std"][:, i]
        return columns

    def to_pandas(self) -> Any:
        """Samples and estimates as a pair of pandas data frames; needs pandas."""
        import pandas  # type: ignore[import-untyped,unused-ignore]

        return pandas.DataFrame(self.samples), pandas.DataFrame(self.estimates)
