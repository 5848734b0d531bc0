"""Reads a recording with the PyPI package rosbags, every message of every topic by its own definition, and prints as JSON what it found."""

import json
import sys
from pathlib import Path

from rosbags.highlevel import AnyReader

result = {"types": {}, "counts": {}, "times": {}, "last": {}, "constants": {}}


def plain(value):
    """Floats as text, because JSON knows neither NaN nor infinity; messages as dictionaries."""
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, (bool, int, str)):
        return value
    if hasattr(value, "tolist"):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return {name: plain(item) for name, item in vars(value).items() if not name.startswith("_")}


with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, timestamp, data in reader.messages():
        topic = connection.topic
        message = reader.deserialize(data, connection.msgtype)
        result["types"][topic] = connection.msgtype
        result["counts"][topic] = result["counts"].get(topic, 0) + 1
        result["times"].setdefault(topic, [timestamp, timestamp])[1] = timestamp
        result["last"][topic] = plain(message)
        result["constants"].setdefault(topic, {n: getattr(message, n) for n in dir(message) if n.isupper()})

json.dump(result, sys.stdout, allow_nan=False)
