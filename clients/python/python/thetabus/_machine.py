"""A machine, and a controller, in Python."""

from __future__ import annotations

from typing import Any, Optional

import numpy as np

from . import _thetabus
from ._closing import Closing
from ._messages import Sample


def _values(values: Any) -> Optional[list[float]]:
    if values is None:
        return None
    listed: list[float] = np.atleast_1d(np.asarray(values, dtype=np.float64)).tolist()
    return listed


class Machine(Closing):
    """Publishes the samples of a machine; there is one per robot and domain.

    >>> with thetabus.Machine("arm", joints=2) as machine:       # doctest: +SKIP
    ...     machine.publish(q=[0.1, 0.2], input=[3.0, -1.0])
    """

    def __init__(
        self,
        robot: str = "arm",
        joints: int = 1,
        *,
        domain: str = "default",
        consumers: int = 0,
        consumer_timeout: float = 10.0,
    ) -> None:
        """Takes the place of the plant of `robot`, with 1 to 8 joints.

        With `consumers`, for a simulation: waits until so many programs listen, for `consumer_timeout` seconds at most, and
        then for the slowest of them at each sample, so that nothing is lost. 0, for a real machine: never waits.
        """
        self._machine = _thetabus.Machine(robot, joints, domain, consumers, consumer_timeout)

    def publish(
        self,
        q: Any = None,
        input: Any = None,
        *,
        dq: Any = None,
        ddq: Any = None,
        dddq: Any = None,
        setpoint: Any = None,
        t_ns: Optional[int] = None,
        seq: Optional[int] = None,
        last: bool = False,
    ) -> int:
        """Sends a sample and gives its seq.

        Signals have one number per joint, SI and radians; None is "not measured". `input` is the drive's voltage, current,
        torque or force, held until the next sample. `t_ns` is the time of the measurement, CLOCK_MONOTONIC by default, and
        must follow the sample period. `seq` counts sample periods: state it to leave out samples that could not be
        measured. `last` ends the stream.
        """
        return self._machine.publish(
            _values(q), _values(input), _values(dq), _values(ddq), _values(dddq), _values(setpoint), t_ns, seq, last
        )

    @property
    def consumers(self) -> int:
        """Programs that receive the samples now."""
        return self._machine.consumers()

    def close(self) -> None:
        """Gives consumers a moment to take what was sent, then leaves."""
        self._machine.close()


class Controller(Closing):
    """Sends feed-forward to the machine of a robot, in answer to its samples; there is one per robot and domain.

    >>> with thetabus.Controller("arm") as controller:           # doctest: +SKIP
    ...     for sample in thetabus.Samples("arm"):
    ...         controller.send(sample, [3.0, 0.5])
    """

    def __init__(self, robot: str = "arm", *, domain: str = "default") -> None:
        """Takes the place of the controller of `robot`."""
        self._controller = _thetabus.Controller(robot, domain)

    def send(self, sample: Sample, feed_forward: Any, hold_s: float = 0.01) -> None:
        """Input to be added to the machine's own loop from the sample after this one on, for `hold_s` seconds of stream
        time at most: one number per joint in the unit of the input."""
        until_ns = sample.t_ns + round(hold_s * 1e9)
        values = _values(feed_forward) or []
        self._controller.send(sample.stream_id, sample.seq, until_ns, sample.joints, values)

    def close(self) -> None:
        """Leaves; what was sent last ends with its time."""
        self._controller.close()
