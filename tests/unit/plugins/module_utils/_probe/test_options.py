# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options: a wrong one is a sentence before anything is sent."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe import options
from mentioned import mentions

MEMBER = {"name": "kobuki1computer", "address": "192.168.1.229", "discovery_address": "", "network": ""}

MASTER = {"computer": "kobuki2computer", "address": "192.168.1.239", "rpc_port": 11611}


def params(**changed):
    usual = {
        "run": "x",
        "patience": 20,
        "lifetime": 300,
        "seconds": 0.5,
        "name": "kobuki1computer",
        "is_router": False,
        "port": 11511,
    }
    return {**usual, "members": [MEMBER], "masters": [MASTER], **changed}


@pytest.mark.parametrize(
    "good",
    [
        {},
        {"members": None, "masters": None},
        {"members": [{**MEMBER, "discovery_address": "10.0.0.1", "network": "192.168.1.0/24"}]},
        {"port": 65535},
    ],
)
def test_usual_options_are_right(good):
    assert options.find_wrong_option(params(**good)) is None


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"members": [{**MEMBER, "address": "x"}]}, "kobuki1computer x IPv4"),
        ({"members": [{**MEMBER, "discovery_address": "::1"}]}, "discovery_address kobuki1computer 1"),
        ({"members": [{**MEMBER, "network": "192.168.1.1"}]}, "kobuki1computer 192.168.1.1"),
        ({"members": [{**MEMBER, "network": "192.168.1.1/24"}]}, "kobuki1computer network"),
        ({"masters": [{**MASTER, "address": "300.1.1.1"}]}, "kobuki2computer 300.1.1.1"),
        ({"masters": [{**MASTER, "rpc_port": 0}]}, "rpc_port kobuki2computer 0"),
        ({"port": 0}, "0 1 65535"),
        ({"port": 65536}, "port is 65536"),
        ({"seconds": 3.0}, "3.0 0.1 2"),
    ],
)
def test_an_address_or_a_port_that_is_none_is_a_sentence(bad, words):
    assert mentions(options.find_wrong_option(params(**bad)), *words.split())
