# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter node_parameters: bundled nodes are told the members, upstream's are not."""

import pytest
from ansible.errors import AnsibleFilterError
from ansible_collections.rosfleet.multimaster.plugins.filter.node_parameters import node_parameters

MEMBERS = [{"robot": "tibi"}]


def test_a_bundled_node_is_told_the_members():
    assert node_parameters({"strangers": "ignore"}, MEMBERS) == {"strangers": "ignore", "members": MEMBERS}


def test_a_node_of_upstream_is_not():
    assert node_parameters({"name": "tibi"}, MEMBERS) == {"name": "tibi"}


def test_without_a_plan_there_is_a_sentence():
    with pytest.raises(AnsibleFilterError, match="let the role preflight make the plan first"):
        node_parameters("", MEMBERS)
