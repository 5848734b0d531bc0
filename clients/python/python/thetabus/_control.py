"""Commands to a running identifier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Optional, Sequence

from . import _thetabus
from ._closing import Closing
from ._layout import record, text

_KINDS = {1: "parameter", 2: "tunable", 3: "position", 4: "input", 5: "figure"}


class Refused(_thetabus.ThetabusError):
    """The identifier refused a command, or could not do it; the message says why."""


class Item(NamedTuple):
    """Something that an identifier describes."""

    kind: str
    """`parameter`, `tunable`, `position`, `input` or `figure`."""
    name: str
    unit: str
    value: float
    """Value of a tunable, start of a parameter."""
    lower: float
    upper: float


@dataclass(frozen=True)
class Answer:
    """What was done."""

    text: str
    from_seq: int
    """First sample to which the command applies; 0 if not known."""
    block: int
    """Block that begins there."""
    items: tuple[Item, ...]


class Control(Closing):
    """Tells the identifier of a robot what to do.

    >>> with thetabus.Control("arm") as control:      # doctest: +SKIP
    ...     control.fix("theta_3", 4.5)
    """

    def __init__(self, robot: str = "arm", *, domain: str = "default", timeout: float = 3.0) -> None:
        """Finds the identifier; each command waits `timeout` seconds for its answer."""
        self.timeout = timeout
        self._control = _thetabus.Control(robot, domain)

    def _ask(self, command: str, name: str = "", value: Optional[float] = None, from_seq: int = 0) -> Answer:
        return self._answer(self._control.ask(command, name, value, from_seq, self.timeout))

    def _answer(self, response: bytes) -> Answer:
        m = record("Response", response)
        words = text(m["text"])
        if m["code"] != 0:
            raise Refused(words)
        items = tuple(
            Item(
                _KINDS.get(int(i["kind"]), "unknown"),
                text(i["name"]),
                text(i["unit"]),
                float(i["value"]),
                float(i["lower"]),
                float(i["upper"]),
            )
            for i in m["items"][: m["items_len"]]
        )
        return Answer(words, int(m["from_seq"]), int(m["block"]), items)

    def pause(self) -> Answer:
        """Takes no more samples in, from the next border between two blocks on."""
        return self._ask("pause")

    def resume(self) -> Answer:
        """Goes on."""
        return self._ask("resume")

    def reset(self) -> Answer:
        """Back to the start values; tunables stay."""
        return self._ask("reset")

    def set(self, tunable: str, value: float, *, from_seq: int = 0) -> Answer:
        """Sets a tunable, not before sample `from_seq`."""
        return self._ask("set", tunable, value, from_seq)

    def fix(self, parameter: str, value: Optional[float] = None) -> Answer:
        """Holds a parameter at a value, or at its estimate."""
        return self._ask("fix", parameter, value)

    def free(self, parameter: str) -> Answer:
        """Estimates a parameter that was held."""
        return self._ask("free", parameter)

    def payload(
        self,
        mass: float = 0.0,
        com: Sequence[float] = (0.0, 0.0, 0.0),
        inertia: Optional[Sequence[float]] = None,
    ) -> Answer:
        """Says what the flange of a robot carries, instead of letting it be found; a mass of 0 is an empty flange.

        Mass in kg, centre of mass in the flange's frame in m, inertia about it in the flange's axes as xx, xy, yy, xz, yz, zz in kg m^2; without it, that
        of a ball of light metal.
        """
        return self._answer(self._control.payload(mass, list(com), None if inertia is None else list(inertia), self.timeout))

    def save(self) -> Answer:
        """Writes a checkpoint."""
        return self._ask("save")

    def describe(self) -> Answer:
        """Parameters, tunables and signals, in `items`; the text is the model's name."""
        return self._ask("describe")

    def close(self) -> None:
        """Leaves the domain."""
        self._control.close()
