"""On-line identification of machines' parameters: read estimates, publish samples, send commands.

    import thetabus

    for e in thetabus.Estimates("arm"):
        print(e.block, e.state, e["theta_7"], "+-", e.std[e.names.index("theta_7")])

Everything talks to the programs of one robot in one domain through shared memory, without a daemon. Waiting calls take a
timeout in seconds, release the interpreter's lock while they wait, and end by Ctrl-C. Units are SI and radians.
"""

from ._control import Answer, Control, Item, Refused
from ._identify import Identification, identify
from ._layout import DTYPES, dtype
from ._linear import LinearPlant
from ._machine import Controller, Machine
from ._messages import (
    Command,
    Derived,
    Description,
    Estimate,
    Joint,
    Parameter,
    Sample,
    Status,
    Usable,
)
from ._readers import Commands, Descriptions, Estimates, Samples, Statuses, describe
from ._recording import Recording
from ._thetabus import SCHEMA_VERSION, ThetabusError, __version__, monotonic_ns

__all__ = [
    "Answer",
    "Command",
    "Commands",
    "Control",
    "Controller",
    "DTYPES",
    "Derived",
    "Description",
    "Descriptions",
    "Estimate",
    "Estimates",
    "Identification",
    "Item",
    "Joint",
    "LinearPlant",
    "Machine",
    "Parameter",
    "Recording",
    "Refused",
    "SCHEMA_VERSION",
    "Sample",
    "Samples",
    "Status",
    "Statuses",
    "ThetabusError",
    "Usable",
    "__version__",
    "describe",
    "dtype",
    "identify",
    "monotonic_ns",
]
