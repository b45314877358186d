# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The module multimaster_verify as Ansible runs it: a program of its own."""

import json

import pytest

from tests.unit import module_server


@pytest.mark.slow
@pytest.mark.parametrize("words", [{"action": "collect"}, {"state": "collected"}, {}], ids=str)
def test_check_mode_refuses_the_same(words):
    arguments = {
        **words,
        "name": "kobuki1computer",
        "members": [{"name": "kobuki1computer", "address": "x"}],
        "masters": [],
        "port": 0,
        "_ansible_check_mode": True,
    }
    done = module_server.run("multimaster_verify", arguments)
    result = json.loads(done.stdout)
    assert result["failed"] and "the address of kobuki1computer is 'x'" in result["msg"]
