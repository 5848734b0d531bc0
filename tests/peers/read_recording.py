"""Reads a recording with the PyPI packages mcap and mcap-ros2-support and prints as JSON what they found.

Every chunk's checksum is verified and every message decoded. Samples are printed as the sum of each field, so that the test on the
other side can tell each value without a large output.
"""

import json
import sys

from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory

path = sys.argv[1]
result = {"counts": {}, "sums": {}, "first": {}, "last": {}, "metadata": {}, "encodings": [], "channels": []}

# Record by record, with the checksum of each chunk.
with open(path, "rb") as file:
    result["records"] = sum(1 for _ in StreamReader(file, validate_crcs=True).records)

with open(path, "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    for metadata in reader.iter_metadata():
        result["metadata"][metadata.name] = metadata.metadata
    for schema, channel, message, ros in reader.iter_decoded_messages(log_time_order=False):
        topic = channel.topic
        fields = {name: getattr(ros, name) for name in ros.__slots__}
        encoding = [topic, schema.name, schema.encoding, channel.message_encoding]
        if encoding not in result["encodings"]:
            result["encodings"].append(encoding)
        result["counts"][topic] = result["counts"].get(topic, 0) + 1
        result["first"].setdefault(topic, fields)
        result["last"][topic] = fields
        sums = result["sums"].setdefault(topic, dict.fromkeys(fields, 0))
        for name, value in fields.items():
            if isinstance(value, (int, float)):
                sums[name] += value


def exact(value):
    """Floats as text: JSON knows neither NaN nor infinity, and not every reader of JSON rounds to the nearest."""
    if isinstance(value, dict):
        return {key: exact(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [exact(item) for item in value]
    if hasattr(value, "__slots__"):
        return {name: exact(getattr(value, name)) for name in value.__slots__}
    return repr(value) if isinstance(value, float) else value


json.dump(exact(result), sys.stdout, allow_nan=False)
