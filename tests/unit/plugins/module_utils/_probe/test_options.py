# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options: a wrong one is a sentence before anything is sent."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe import options

MEMBER = {
    "name": "kobuki1computer",
    "address": "192.168.1.229",
    "discovery_address": "",
    "network": "",
}

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
        ({"members": [{**MEMBER, "address": "x"}]}, "members: the address of kobuki1computer is 'x', expected an IPv4"),
        ({"members": [{**MEMBER, "discovery_address": "::1"}]}, "the discovery_address of kobuki1computer is '::1'"),
        (
            {"members": [{**MEMBER, "network": "192.168.1.1"}]},
            "the network of kobuki1computer is '192.168.1.1', expected a",
        ),
        ({"members": [{**MEMBER, "network": "192.168.1.1/24"}]}, "the network of kobuki1computer"),
        ({"masters": [{**MASTER, "address": "300.1.1.1"}]}, "masters: the address of kobuki2computer is '300.1.1.1'"),
        ({"masters": [{**MASTER, "rpc_port": 0}]}, "masters: the rpc_port of kobuki2computer is 0, expected a port"),
        ({"port": 0}, "port is 0, expected a port from 1 to 65535"),
        ({"port": 65536}, "port is 65536"),
        ({"seconds": 3.0}, "seconds is 3.0, expected 0.1 to 2 seconds"),
    ],
)
def test_an_address_or_a_port_that_is_none_is_a_sentence(bad, words):
    assert words in options.find_wrong_option(params(**bad))
