# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A result is packed for as long as Ansible keeps it."""

import json

import fleets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.packed import pack, unpack
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.task_results import (
    find_result,
    read_observation,
)

RESULT = {"changed": False, "msg": "Looked.", "members": [{"name": "pc1", "loss": None}], "warnings": ["slow"]}
TASKS = {"multicast": "seen.multicast", "probe": "seen", "earlier": []}


def answered(fleet, name):
    seen = fleets.good(fleet, name)
    return {"changed": False, "msg": "", **to_plain(seen.probe), "multicast": to_plain(seen.multicast)}


def test_texts_and_what_ansible_reads_stay():
    packed = pack(RESULT)
    assert {**packed, "packed": ""} == {"changed": False, "msg": "Looked.", "warnings": ["slow"], "packed": ""}
    assert {**unpack(packed), "packed": ""} == {**RESULT, "packed": ""}
    assert unpack(RESULT) == RESULT
    assert pack({"failed": True, "msg": "No."}) == {"failed": True, "msg": "No."}


def test_the_observation_is_the_same():
    fleet = fleets.plan(4, 2)
    for name in fleet.computers:
        whole = answered(fleet, name)
        hosts = [{"seen": whole}, {"seen": pack(whole)}]
        first, second = (read_observation(name, variables, TASKS) for variables in hosts)
        assert first == second and first.probe and first.multicast


def test_a_large_answer_is_a_small_text():
    whole = answered(fleets.plan(30, 4), "kobuki1computer")
    assert len(pack(whole)["packed"]) * 10 < len(json.dumps(whole))


def test_a_part_that_a_robot_has_named_so_is_no_packed_one():
    said = {"multicast": {"packed": pack(RESULT)["packed"]}}
    assert find_result({"seen": said}, "seen.multicast") == said["multicast"]
    assert find_result({"seen": pack(said)}, "seen.multicast") == said["multicast"]
