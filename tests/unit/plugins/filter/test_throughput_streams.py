# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter throughput_streams: who sends to whom, and what is refused before anything starts."""

import pytest
from ansible.errors import AnsibleFilterError
from ansible_collections.rosfleet.multimaster.plugins.filter.throughput_streams import throughput_streams

NAMES = ("pc0", "pc1", "pc2")
FLEET = {
    "members": [{"name": name, "network": "192.168.1.0/24"} for name in (*NAMES, "sealed")],
    "computers": {**dict.fromkeys(NAMES, {}), "sealed": {"sealed": True}},
}


@pytest.mark.parametrize("nothing", [0, 0.0, False, "0", "false", "False", "no"])
def test_without_it_nobody_sends(nothing):
    assert throughput_streams(FLEET, nothing) == {"to": {}, "seconds": 0}


@pytest.mark.parametrize("seconds", [0.5, "0.5"])
def test_each_sends_to_all_others(seconds):
    found = throughput_streams(FLEET, seconds)
    assert found["to"] == {"pc0": ["pc1", "pc2"], "pc1": ["pc0", "pc2"], "pc2": ["pc0", "pc1"]}
    assert found["seconds"] == 12  # six streams, and three starts


@pytest.mark.parametrize("wrong", [-1, 0.01, 3, "1s", "much", None, float("nan"), float("inf"), [1]])
def test_another_length_is_a_sentence(wrong):
    with pytest.raises(
        AnsibleFilterError, match=r"verify_throughput is .*, expected 0, or the seconds .* 0\.1 to 2\.$"
    ):
        throughput_streams(FLEET, wrong)


@pytest.mark.parametrize("wrong", [-1, "fast", 1e9, float("nan")])
def test_another_least_is_a_sentence(wrong):
    with pytest.raises(AnsibleFilterError, match=r"verify_throughput_least is .*, expected a number of Mbit/s"):
        throughput_streams(FLEET, 0, "auto", wrong)


def test_only_computers_of_the_run_send():
    names = [member["name"] for member in FLEET["members"]]
    assert list(throughput_streams(FLEET, 0.5, hosts=names[:1])["to"]) == names[:1]
