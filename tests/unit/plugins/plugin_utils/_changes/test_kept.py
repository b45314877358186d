# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The answer of a kept process is the result of a module, and no more than that."""

import json

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._changes.kept import answered

HARMLESS = {"changed": False, "msg": "seen"}


@pytest.mark.parametrize(
    "key", ["add_host", "add_group", "_ansible_no_log", "_ansible_facts_cached", "_ansible_delegated_vars"]
)
def test_what_tells_ansible_what_to_do_is_taken_out(key):
    orders = {key: {"host_name": "kobuki2computer", "host_vars": {"ansible_ssh_common_args": "-o ProxyCommand=true"}}}
    assert answered(json.dumps({**HARMLESS, **orders})) == HARMLESS


@pytest.mark.parametrize("said", ["", "[1]", "no JSON", "[" * 100_000, '{"a":' * 100_000])
def test_an_answer_that_is_no_result_is_none(said):
    assert answered(said) == {}
