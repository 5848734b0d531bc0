"""Plain iceoryx2 stays open: its own Python package reads an estimate by the documented layout."""

from __future__ import annotations

import ctypes
import os
import pathlib

import pytest

import thetabus
from conftest import eventually
from thetabus._layout import _TABLES

iox2 = pytest.importorskip("iceoryx2", reason="pip install iceoryx2==0.10.0")

KINDS = {"u1": ctypes.c_uint8, "u4": ctypes.c_uint32, "u8": ctypes.c_uint64, "f8": ctypes.c_double}


def structure(message: str) -> type[ctypes.Structure]:
    """A ctypes structure from the table of fields."""
    name, type_name, size, fields = _TABLES[message]
    members = []
    for field, kind, length, *_ in fields:
        base = KINDS[kind]
        members.append((field, base if length is None else base * length))
    made = type(name, (ctypes.Structure,), {"_fields_": members, "type_name": staticmethod(lambda: type_name)})
    assert ctypes.sizeof(made) == size
    return made


def test_e2e_plain_iceoryx2_reads_an_estimate(site):
    quick = ("--set", "estimator.block_len=200", "--set", "estimator.max_iterations=10")
    site.start("identifier", *quick)
    with thetabus.Estimates(domain=site.domain) as estimates:
        site.start("plant_simulator", "--duration", "1", *quick)
        e = eventually("five blocks", lambda: (e := estimates.next(20.0)) and e.block == 5 and e)
        runtime = os.environ.get("XDG_RUNTIME_DIR")
        root = pathlib.Path(runtime) / f"thetabus-{site.domain}" if runtime else f"/tmp/thetabus-{os.geteuid()}-{site.domain}"
        config = iox2.config.default()
        config.global_cfg.root_path = iox2.Path.new(str(root))
        config.global_cfg.prefix = iox2.FileName.new(f"thetabus_{os.geteuid()}_{site.domain}_")
        node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        service = (
            node.service_builder(iox2.ServiceName.new("thetabus/arm/estimate"))
            .publish_subscribe(structure("Estimate"))
            .user_header(structure("Header"))
            .open()
        )
        subscriber = service.subscriber_builder().create()
        sample = eventually("the last estimate", subscriber.receive)
        plain = sample.payload().contents
        assert (plain.block, plain.stream_id) == (5, e.stream_id)
        assert list(plain.theta[:9]) == e.values.tolist()
        assert sample.user_header().contents.schema == thetabus.SCHEMA_VERSION
