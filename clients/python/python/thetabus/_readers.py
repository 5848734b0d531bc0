"""Readers of the topics: iterate over them, or ask for the next message with a timeout."""

from __future__ import annotations

import time
from typing import Generic, Iterator, Optional, TypeVar

from ._closing import Closing
from ._messages import Command, Description, Estimate, Sample, Status
from ._thetabus import Reader

M = TypeVar("M")


class _Topic(Closing, Generic[M]):
    _topic = ""

    def __init__(self, robot: str = "arm", *, domain: str = "default", timeout: Optional[float] = None) -> None:
        """Joins `domain` as a reader of `robot`; start order does not matter. With `timeout`, in seconds, iterating ends
        if nothing comes for so long."""
        self.robot, self.domain, self.timeout = robot, domain, timeout
        self._reader = Reader(self._topic, robot, domain)

    def _made(self, data: bytes, sent_ns: int) -> M:
        raise NotImplementedError

    def next(self, timeout: Optional[float] = None) -> Optional[M]:
        """The next message, or None if none comes within `timeout` seconds; waits for ever without one."""
        found = self._reader.next(timeout)
        return None if found is None else self._made(*found)

    def __iter__(self) -> Iterator[M]:
        while (message := self.next(self.timeout)) is not None:
            yield message

    @property
    def left_out(self) -> int:
        """Messages of another schema, or of a second publisher, that were left out."""
        return self._reader.left_out()

    def close(self) -> None:
        """Leaves the domain."""
        self._reader.close()


class _Gaps:
    """Counts what is missing in a numbered stream."""

    def __init__(self) -> None:
        self.last: Optional[tuple[int, int]] = None

    def before(self, stream: int, number: int) -> int:
        last, self.last = self.last, (stream, number)
        return max(number - last[1] - 1, 0) if last is not None and last[0] == stream else 0


class Descriptions(_Topic[Description]):
    """What an identifier says of its model: the last one at once, then one per start of an identifier."""

    _topic = "description"

    def _made(self, data: bytes, sent_ns: int) -> Description:
        return Description._of(data)


def describe(robot: str = "arm", *, domain: str = "default", timeout: Optional[float] = 3.0) -> Optional[Description]:
    """What the identifier of `robot` identifies, or None if none says so within `timeout` seconds."""
    with Descriptions(robot, domain=domain) as descriptions:
        return descriptions.next(timeout)


class Estimates(_Topic[Estimate]):
    """Estimates, the last one before it joined included.

    >>> for e in thetabus.Estimates("arm"):      # doctest: +SKIP
    ...     mass = e.get("mass")                 # None unless it may be used
    """

    _topic = "estimate"
    # How long the first estimate waits for the names, which the identifier has sent before.
    _names_within = 1.0

    def __init__(self, robot: str = "arm", *, domain: str = "default", timeout: Optional[float] = None) -> None:
        super().__init__(robot, domain=domain, timeout=timeout)
        self._descriptions = Reader("description", robot, domain)
        self._gaps = _Gaps()
        self._awaited: set[int] = set()
        self.description: Optional[Description] = None
        """The identifier's own names and units, once they have come."""

    def _look(self, limit: float) -> bool:
        found = self._descriptions.next(limit)
        if found is not None:
            self.description = Description._of(found[0])
        return found is not None

    def _made(self, data: bytes, sent_ns: int) -> Estimate:
        while self._look(0.0):
            pass
        e = Estimate(data, sent_ns, self.description)
        model = int(e.raw["model_hash"])
        if e.description is None and model not in self._awaited:
            # an identifier with other names has sent them before its first estimate; it is waited for once
            self._awaited.add(model)
            until = time.monotonic() + self._names_within
            while e.description is None and self._look(max(until - time.monotonic(), 0.0)):
                e = Estimate(data, sent_ns, self.description)
        e.gaps = self._gaps.before(e.stream_id, e.block)
        return e

    def close(self) -> None:
        super().close()
        self._descriptions.close()


class Samples(_Topic[Sample]):
    """Samples of a machine, in real time those of the last moment included."""

    _topic = "sample"

    def __init__(self, robot: str = "arm", *, domain: str = "default", timeout: Optional[float] = None) -> None:
        super().__init__(robot, domain=domain, timeout=timeout)
        self._gaps = _Gaps()

    def _made(self, data: bytes, sent_ns: int) -> Sample:
        sample = Sample(data, sent_ns)
        sample.gaps = self._gaps.before(sample.stream_id, sample.seq)
        return sample


class Statuses(_Topic[Status]):
    """The identifier's heartbeat, twice a second."""

    _topic = "status"

    def _made(self, data: bytes, sent_ns: int) -> Status:
        return Status(data, sent_ns)


class Commands(_Topic[Command]):
    """What a controller asks of the machine, for a machine that takes commands."""

    _topic = "command"

    def _made(self, data: bytes, sent_ns: int) -> Command:
        return Command(data, sent_ns)
