"""What a reader gets: values with their names, as numpy arrays that cannot be written to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt

from ._layout import members, record, text

Array = npt.NDArray[np.float64]

_STATES = (
    "collecting",
    "converging",
    "converged",
    "paused",
    "poorly_excited",
    "changing",
    "degraded",
    "invalid",
    "ended",
    "misfit",
)
_ESTIMATE_FLAGS = ("changed", "incomplete", "held", "warm", "commanded", "sensor")
_STATUS_FLAGS = ("warm", "paused", "silent", "commanded", "checkpoints", "replay")
_SIGNALS = ("q", "dq", "ddq", "dddq", "setpoint", "input")


def _state(value: Any) -> str:
    return _STATES[value] if value < len(_STATES) else "unknown"


def _flags(value: Any, names: Sequence[str]) -> frozenset[str]:
    return frozenset(name for bit, name in enumerate(names) if int(value) >> bit & 1)


class Joint(NamedTuple):
    """A joint of the machine."""

    name: str
    position_unit: str
    input_unit: str


class Parameter(NamedTuple):
    """A parameter of the model: bounds and start in its unit, -inf and inf for no bound."""

    name: str
    unit: str
    meaning: str
    start: float
    lower: float
    upper: float


class Derived(NamedTuple):
    """A value that follows from the parameters."""

    name: str
    unit: str
    meaning: str


class Usable(NamedTuple):
    """A value that may be used, with its standard deviation."""

    value: float
    std: float


@dataclass(frozen=True)
class Description:
    """What an identifier identifies: names, units, meanings, bounds."""

    model: str
    model_hash: int
    config_hash: int
    block_len: int
    """Samples in a block."""
    sample_period_s: float
    input_kind: str
    """`voltage`, `current`, `torque`, `force` or `input`."""
    joints: tuple[Joint, ...]
    parameters: tuple[Parameter, ...]
    derived: tuple[Derived, ...]

    @classmethod
    def _of(cls, data: bytes) -> Description:
        m = record("Description", data)
        return cls(
            model=text(m["model"]),
            model_hash=int(m["model_hash"]),
            config_hash=int(m["config_hash"]),
            block_len=int(m["block_len"]),
            sample_period_s=float(m["sample_period_ns"]) * 1e-9,
            input_kind=text(m["input_kind"]),
            joints=tuple(
                Joint(text(j["name"]), text(j["position_unit"]), text(j["input_unit"]))
                for j in m["joint"][: m["joints"]]
            ),
            parameters=tuple(
                Parameter(
                    text(p["name"]),
                    text(p["unit"]),
                    text(p["meaning"]),
                    float(p["start"]),
                    float(p["lower"]),
                    float(p["upper"]),
                )
                for p in m["parameter"][: m["params"]]
            ),
            derived=tuple(
                Derived(text(d["name"]), text(d["unit"]), text(d["meaning"])) for d in m["derived"][: m["derived_len"]]
            ),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of theta."""
        return tuple(p.name for p in self.parameters)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters, in the order of theta."""
        return tuple(p.unit for p in self.parameters)


class _Message:
    """A message with its raw fields."""

    _name = ""

    def __init__(self, data: bytes, sent_ns: int = 0) -> None:
        self.raw = record(self._name, data)
        """All fields, as `thetabus.dtype` names them."""
        self.sent_ns = sent_ns
        """CLOCK_MONOTONIC at sending, in ns."""

    @property
    def stream_id(self) -> int:
        """Changes at each start of the publisher of samples."""
        return int(self.raw["stream_id"])


class Estimate(_Message):
    """An estimate with its evidence. Arrays have one value per parameter, P, per derived value, or per equation, E.

    Names and units are those of the identifier's description; without one they are numbered (`theta_1`) and empty.
    """

    _name = "Estimate"

    def __init__(self, data: bytes, sent_ns: int = 0, description: Optional[Description] = None, gaps: int = 0) -> None:
        super().__init__(data, sent_ns)
        fits = description is not None and description.model_hash in (0, int(self.raw["model_hash"]))
        self.description = description if fits else None
        """What the names are from; None if it has not come, or is of another model."""
        self.gaps = gaps
        """Estimates of this stream that this reader has not seen before this one."""

    @property
    def block(self) -> int:
        """Number of the block, from 1."""
        return int(self.raw["block"])

    @property
    def t_s(self) -> float:
        """Stream time of the last sample of the block, in s."""
        return float(self.raw["t_last_ns"]) * 1e-9

    @property
    def state(self) -> str:
        """`collecting`, `converging`, `converged`, `paused`, `poorly_excited`, `changing`, `degraded`, `invalid` or `misfit`."""
        return _state(self.raw["state"])

    @property
    def use_ok(self) -> bool:
        """True if what is marked in `usable` may be used."""
        return bool(self.raw["use_ok"] == 1)

    @property
    def flags(self) -> frozenset[str]:
        """Some of `changed`, `incomplete`, `held`, `warm`, `commanded`, `sensor`."""
        return _flags(self.raw["flags"], _ESTIMATE_FLAGS)

    @property
    def t_change_s(self) -> Optional[float]:
        """Located stream time of the last change, in s."""
        t_ns = int(self.raw["t_change_ns"])
        return t_ns * 1e-9 if t_ns > 0 else None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, P."""
        if self.description is not None:
            return self.description.names
        return tuple(f"theta_{i + 1}" for i in range(self._params))

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters, P; empty if they are not known."""
        return self.description.units if self.description is not None else ("",) * self._params

    @property
    def _params(self) -> int:
        return min(int(self.raw["params"]), len(self.raw["theta"]))

    @property
    def values(self) -> Array:
        """Estimates in the units of the parameters, P."""
        array: Array = self.raw["theta"][: self._params]
        return array

    @property
    def std(self) -> Array:
        """Standard deviations in the units of the parameters, P; NaN if the estimator gives none."""
        array: Array = self.raw["theta_std"][: self._params]
        return array

    @cached_property
    def usable(self) -> npt.NDArray[np.bool_]:
        """What may be used, P: the parameter's own bit, and `use_ok`. The rule for taking a value by itself."""
        return members(self.raw["usable"], self._params) & self.use_ok

    @cached_property
    def excited(self) -> npt.NDArray[np.bool_]:
        """Parameters about which the block's data are informative, P."""
        return members(self.raw["excited"], self._params)

    @cached_property
    def fixed(self) -> npt.NDArray[np.bool_]:
        """What is held by configuration or command, P."""
        return members(self.raw["fixed"], self._params)

    @property
    def derived(self) -> dict[str, Usable]:
        """Values that follow from the parameters, with their standard deviations, by name."""
        count = min(int(self.raw["derived_len"]), len(self.raw["derived"]))
        known = self.description.derived if self.description is not None else ()
        names = [d.name for d in known][:count] if len(known) >= count else [f"derived_{i + 1}" for i in range(count)]
        pairs = zip(names, self.raw["derived"], self.raw["derived_std"])
        return {name: Usable(float(value), float(std)) for name, value, std in pairs}

    @property
    def residual_rms(self) -> Array:
        """Root mean square of the residual, in the equation's unit, E."""
        array: Array = self.raw["residual_rms"][: self.raw["equations"]]
        return array

    @property
    def fit(self) -> Array:
        """Chi squared of the whitened residuals over their number, E: 1 on average if the block fits."""
        array: Array = self.raw["fit"][: self.raw["equations"]]
        return array

    @property
    def fit_probability(self) -> float:
        """Probability of residuals as large as these if the model is right: below 2e-4 it is a misfit."""
        return float(self.raw["fit_probability"])

    @property
    def accepted(self) -> int:
        """Samples used since the start of the stream."""
        return int(self.raw["accepted"])

    @property
    def missing(self) -> int:
        """Samples lost since the start of the stream."""
        return int(self.raw["missing"])

    @property
    def rejected(self) -> int:
        """Samples refused since the start of the stream."""
        return int(self.raw["rejected"])

    def _index(self, name: str) -> int:
        try:
            return self.names.index(name)
        except ValueError:
            if name in self.derived:
                raise KeyError(f"{name!r} is no parameter but follows from them: derived[{name!r}]") from None
            raise KeyError(f"no parameter {name!r}; there are {', '.join(self.names)}") from None

    def __getitem__(self, name: Union[str, int]) -> float:
        """The estimate of a parameter, by name or index from 0, whether or not it may be used."""
        return float(self.values[self._index(name) if isinstance(name, str) else name])

    def get(self, name: str) -> Optional[Usable]:
        """The parameter with its standard deviation if it may be used, else None."""
        index = self._index(name)
        return Usable(float(self.values[index]), float(self.std[index])) if self.usable[index] else None

    def __repr__(self) -> str:
        values = ", ".join(f"{n}={v:.6g}" for n, v in zip(self.names, self.values))
        return f"<Estimate block {self.block} at {self.t_s:.3f} s, {self.state}: {values}>"


class Sample(_Message):
    """Joints, setpoint and input of one instant; arrays have one value per joint, J, or are None if the signal was not measured."""

    _name = "Sample"

    def __init__(self, data: bytes, sent_ns: int = 0, gaps: int = 0) -> None:
        super().__init__(data, sent_ns)
        self.gaps = gaps
        """Samples of this stream that were lost before this one."""

    @property
    def seq(self) -> int:
        """Counts from 0, one per sample period."""
        return int(self.raw["seq"])

    @property
    def t_ns(self) -> int:
        """Stream time in ns."""
        return int(self.raw["t_ns"])

    @property
    def t_s(self) -> float:
        """Stream time in s."""
        return self.t_ns * 1e-9

    @property
    def joints(self) -> int:
        """Number of joints."""
        return min(int(self.raw["joints"]), len(self.raw["q"]))

    @property
    def last(self) -> bool:
        """True for the last sample of a stream."""
        return bool(self.raw["flags"] & 1)

    def _signal(self, name: str) -> Optional[Array]:
        if not int(self.raw["signals"]) >> _SIGNALS.index(name) & 1:
            return None
        array: Array = self.raw[name][: self.joints]
        return array

    @property
    def q(self) -> Optional[Array]:
        """Positions in rad or m, J."""
        return self._signal("q")

    @property
    def dq(self) -> Optional[Array]:
        """Velocities in rad/s or m/s, J."""
        return self._signal("dq")

    @property
    def ddq(self) -> Optional[Array]:
        """Accelerations in rad/s^2 or m/s^2, J."""
        return self._signal("ddq")

    @property
    def setpoint(self) -> Optional[Array]:
        """Commanded positions in rad or m, J."""
        return self._signal("setpoint")

    @property
    def input(self) -> Optional[Array]:
        """The drives' inputs in V, A, N m or N, J."""
        return self._signal("input")

    def __repr__(self) -> str:
        return f"<Sample {self.seq} at {self.t_s:.3f} s: q={self.q} input={self.input}>"


class Status(_Message):
    """What the identifier does, has seen and costs."""

    _name = "Status"

    @property
    def state(self) -> str:
        """As of an estimate, or `ended`."""
        return _state(self.raw["state"])

    @property
    def flags(self) -> frozenset[str]:
        """Some of `warm`, `paused`, `silent`, `commanded`, `checkpoints`, `replay`."""
        return _flags(self.raw["flags"], _STATUS_FLAGS)

    @property
    def accepted(self) -> int:
        """Samples used since the start of the stream."""
        return int(self.raw["accepted"])

    @property
    def missing(self) -> int:
        """Samples lost since the start of the stream."""
        return int(self.raw["missing"])

    @property
    def rejected(self) -> int:
        """Samples refused since the start of the stream."""
        return int(self.raw["rejected"])

    @property
    def estimates(self) -> int:
        """Estimates published since the start of the stream."""
        return int(self.raw["estimates"])

    @property
    def last_block(self) -> int:
        """Block of the last estimate, 0 before the first."""
        return int(self.raw["last_block"])

    @property
    def pid(self) -> int:
        """Process id of the identifier."""
        return int(self.raw["pid"])

    @property
    def error(self) -> str:
        """What went wrong last, in words."""
        return text(self.raw["error"]["text"])

    def __repr__(self) -> str:
        return (
            f"<Status {self.state}: {self.accepted} accepted, {self.missing} missing, {self.rejected} rejected, "
            f"{self.estimates} estimates>"
        )


class Command(_Message):
    """What a controller asks a machine to add to its own loop."""

    _name = "MachineCommand"

    @property
    def seq(self) -> int:
        """The sample that is answered; the command holds from the next one on."""
        return int(self.raw["seq"])

    @property
    def until_ns(self) -> int:
        """Stream time in ns from which on it holds no longer."""
        return int(self.raw["until_ns"])

    @property
    def feed_forward(self) -> Array:
        """Input to be added, in the unit of the input, J."""
        array: Array = self.raw["feed_forward"][: self.raw["joints"]]
        return array

    def __repr__(self) -> str:
        return f"<Command after sample {self.seq}: {self.feed_forward}>"
