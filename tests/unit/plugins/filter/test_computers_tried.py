# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter computers_tried: all others in a small fleet, some in a large one."""

import pytest
from ansible.errors import AnsibleFilterError
from ansible_collections.rosfleet.multimaster.plugins.filter.computers_tried import computers_tried


def fleet(computers):
    """As much of the plan as the filter reads: robots of four computers on a network each, and a router."""
    names = [f"pc{number}" for number in range(computers)]
    members = [{"name": name, "network": f"10.{number // 4}.0.0/24"} for number, name in enumerate(names)]
    return {"members": members, "computers": {name: {} for name in [*names, "router"]}}


def test_a_small_fleet_tries_all_others():
    assert computers_tried(fleet(4), "pc1") == ["pc0", "pc2", "pc3"]
    assert computers_tried(fleet(4), "router") == ["pc0", "pc1", "pc2", "pc3"]


def test_a_large_fleet_tries_each_network_and_two_neighbours():
    chosen = computers_tried(fleet(40), "pc1")
    assert len(chosen) == 9 + 2
    assert {"pc2", "pc3"} <= set(chosen)
    assert chosen == sorted(chosen, key=lambda name: int(name[2:]))  # as in the plan
    assert len(computers_tried(fleet(40), "pc1", "all")) == 39


@pytest.mark.parametrize("pairs", ["auto", "all"])
def test_one_call_has_what_each_computer_tries(pairs):
    every = computers_tried(fleet(40), pairs=pairs)
    assert list(every) == list(fleet(40)["computers"])
    assert every == {name: computers_tried(fleet(40), name, pairs) for name in every}


def test_another_word_is_refused():
    with pytest.raises(AnsibleFilterError, match="verify_pairs is 'some', expected auto or all"):
        computers_tried(fleet(4), "pc1", "some")


def test_only_computers_of_the_run_try_others():
    hosts = ["pc0", "pc5", "router", "of another play"]
    assert list(computers_tried(fleet(40), hosts=hosts)) == ["pc0", "pc5", "router"]
