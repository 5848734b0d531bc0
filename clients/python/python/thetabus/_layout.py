"""Numpy dtypes of the messages, from the tables of fields that the programs are built from."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ._thetabus import tables


def _dtype(table: Any) -> np.dtype[Any]:
    _, _, size, fields = table
    names, formats, offsets, titles = [], [], [], []
    for name, kind, length, _, _, _, offset in fields:
        base = _dtype(kind) if isinstance(kind, tuple) else np.dtype(kind)
        names.append(name)
        formats.append(base if length is None else (base, (length,)))
        offsets.append(offset)
        titles.append(name)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


_TABLES = {table[0]: table for table in tables()}

DTYPES: dict[str, np.dtype[Any]] = {name: _dtype(table) for name, table in _TABLES.items()}
"""Structured dtype of each message by its name: `Sample`, `Estimate`, `Status`, `Description`, `Response` ..."""


def dtype(message: str) -> np.dtype[Any]:
    """Structured dtype of a message: `Sample`, `Estimate`, `Status`, `Description`."""
    return DTYPES[message]


def meaning(message: str) -> dict[str, tuple[str, str]]:
    """Unit and meaning of each field of a message."""
    return {field[0]: (field[4], field[5]) for field in _TABLES[message][3]}


def record(message: str, data: bytes) -> np.void:
    """One message; it cannot be written to."""
    found: np.void = np.frombuffer(data, dtype=DTYPES[message])[0]
    return found


def records(message: str, data: bytes) -> npt.NDArray[np.void]:
    """Messages behind each other."""
    return np.frombuffer(data, dtype=DTYPES[message])


def text(value: Any) -> str:
    """A text of fixed size."""
    return bytes(value).split(b"\0", 1)[0].decode("utf-8", "replace")


def members(words: Any, count: int) -> npt.NDArray[np.bool_]:
    """A set of parameters as one truth value per parameter."""
    octets = np.asarray(words, dtype="<u8").view(np.uint8)
    return np.unpackbits(octets, bitorder="little")[:count].astype(np.bool_)
