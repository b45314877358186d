# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The concerns of a run: all, or those that its tags name."""

from pathlib import Path

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.concerns import (
    CONCERNS,
    UnknownTag,
    choose_concerns,
)

ROOT = Path(__file__).parents[5]
OPTIONS = {
    "sysctl": {"path": "x"},
    "routes": {"routes": []},
    "firewall": {"rules": []},
    "tunnel": {"files": []},
    "hosts_entries": {"entries": []},
    "multimaster_packages": {"names": []},
    "managed_files": [{"bundle": name} for name in ("environment", "nodes", "multicast_routing", "clock")],
    "managed_services": [{"bundle": name} for name in ("multicast_routing", "multimaster")],
    "shells": {"variables": {}},
}


def test_a_run_without_tags_is_about_all():
    assert choose_concerns(OPTIONS, ["all"], [], ["always"]) == OPTIONS


@pytest.mark.parametrize("tag", CONCERNS)
def test_a_tag_and_its_opposite_part_the_whole(tag):
    one, others = choose_concerns(OPTIONS, [tag], [], []), choose_concerns(OPTIONS, ["all"], [tag], [])
    assert one and others
    for name, value in OPTIONS.items():
        if isinstance(value, list):
            parts = one.get(name, []) + others.get(name, [])
            assert sorted(bundle["bundle"] for bundle in parts) == sorted(bundle["bundle"] for bundle in value)
        else:
            assert (name in one) is not (name in others)


def test_a_tag_of_the_callers_playbook_is_about_all():
    assert choose_concerns(OPTIONS, ["lab"], [], ["lab", "always"]) == OPTIONS


def test_a_skipped_tag_of_others_leaves_out_nothing():
    assert choose_concerns(OPTIONS, ["all"], ["notest"], []) == OPTIONS


def test_an_unknown_tag_is_a_sentence():
    with pytest.raises(UnknownTag, match="^hots is no tag of a concern; expected some of sysctl, routes, "):
        choose_concerns(OPTIONS, ["hots"], [], ["always"])


def test_every_concern_is_a_role_and_every_option_is_of_one():
    roles = {path.name for path in (ROOT / "roles").iterdir()}
    assert set(CONCERNS) == roles - {"computer", "preflight", "verify"}
    tasks = yaml.safe_load((ROOT / "roles/computer/tasks/main.yml").read_text())
    handed = {name for task in tasks for name in task.get("rosfleet.multimaster.multimaster_computer", {})}
    assert handed == {name for options in CONCERNS.values() for name in options}
