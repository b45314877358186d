# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The record of the module sysctl: what is read from its JSON is written the same."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import record

FORWARD = "net/ipv4/ip_forward"
ENTRY = {"key": FORWARD, "before": "0", "set": ["1"], "beside": {"net/ipv4/conf/eth0/forwarding": "1"}}
RECORD = {
    "drop_ins": ["/etc/sysctl.d/90-rosfleet-multimaster.conf"],
    "folders": ["/etc/sysctl.d"],
    "settings": {FORWARD: ENTRY},
}


@pytest.mark.parametrize("data", [{}, RECORD, {**RECORD, "settings": {}}])
def test_a_record_is_written_as_it_was_read(data):
    assert record.read(data).plain() == data


def test_a_setting_without_a_value_is_no_record():
    with pytest.raises(LookupError):
        record.read({"settings": {FORWARD: {**ENTRY, "set": []}}})


def test_the_entries_have_types():
    assert record.read(RECORD).settings[FORWARD].set == ["1"]
