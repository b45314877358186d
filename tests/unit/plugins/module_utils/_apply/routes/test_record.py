# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The record of the module routes: what is read from its JSON is written the same."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.kernel import RouteSpec

ROUTE = {
    "destination": "0.0.0.0/0",
    "gateway": "192.168.11.101",
    "device": "eth0",
    "metric": 0,
    "table": 254,
    "source": "",
    "on_link": False,
    "type": "unicast",
}
HOOK = "/etc/network/if-up.d/rosfleet-multimaster"
RECORD = {
    "routes": [{"made": [ROUTE], "replaced": [["default", "via", "192.168.11.1", "dev", "eth0"]]}],
    "boot": {
        "places": {HOOK: {"backend": "ifupdown", "texts": ["#!/bin/sh\n"], "routes": [ROUTE]}},
        "pending": {"ifupdown": [HOOK]},
        "folders": ["/etc/network/if-up.d"],
    },
}


@pytest.mark.parametrize("data", [{}, RECORD, {"routes": RECORD["routes"]}, {"boot": RECORD["boot"]}])
def test_a_record_is_written_as_it_was_read(data):
    assert record.read_record(data).to_json() == data


def test_the_parts_have_types():
    found = record.read_record(RECORD)
    ours = RouteSpec("0.0.0.0/0", "192.168.11.101", "eth0")
    assert found.entries[ours.key].made == (ours,)
    assert found.places[HOOK].routes == [ours]
