# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options of the module firewall: addresses in normal form, and one sentence for each that is none."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall import packet_filter
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem

NOTHING = {"members": [], "also": [], "networks": [], "guards": [], "open_ports": [], "ssh_ports": []}


def read(ssh=(), **options):
    return packet_filter.read_options({**NOTHING, **options}, ssh)


def test_addresses_are_in_normal_form_and_once():
    found = read(members=["192.168.1.229/32", "192.168.1.229", "192.168.2.7", "fe80::0:1"], also=["192.168.2.0/24"])
    assert found.members == ("192.168.1.229", "fe80::1", "192.168.2.0/24")
    assert found.list_members(4) == ["192.168.1.229", "192.168.2.0/24"]
    assert found.list_members(6) == ["fe80::1"]


def test_without_members_nothing_is_wanted():
    assert read() is None
    assert read(also=["192.168.2.0/24"], open_ports=["51820/udp"], ssh=[2222]) is None


def test_ports_of_ssh_stay_open_where_they_are_protected_at_all():
    found = read(members=["192.168.1.229"], ssh_ports=[22, 2200], open_ports=["51820/udp", "80/tcp"], ssh=[2222])
    assert found.list_open_ports("tcp") == [2200, 2222]
    assert found.list_open_ports("udp") == [51820]
    assert found.list_closed_ranges("tcp") == [(1024, 2199), (2201, 2221), (2223, 65535)]
    assert found.list_closed_ranges("udp") == [(1024, 65535)]


def test_ports_of_ssh_at_the_ends_and_side_by_side():
    assert read(members=["10.0.0.1"], ssh=[1024, 2222, 2223, 65535]).list_closed_ranges("tcp") == [
        (1025, 2221),
        (2224, 65534),
    ]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"members": ["robot"]}, "members has 'robot', which is no address and no network"),
        ({"members": ["192.168.1.5/24"]}, "members has '192.168.1.5/24', which is no address and no network"),
        ({"members": ["10.0.0.1"], "also": ["x"]}, "also has 'x'"),
        ({"members": [], "networks": ["192.168.1.0/24"]}, "networks has 192.168.1.0/24, but members is empty"),
        ({"members": ["10.0.0.1"], "networks": ["fd00::/8"]}, "networks has a network of IPv6"),
        (
            {"members": ["10.0.0.1"], "open_ports": ["51820"]},
            "open_ports has '51820', expected a port and its protocol",
        ),
        ({"members": ["10.0.0.1"], "open_ports": ["70000/tcp"]}, "open_ports has '70000/tcp'"),
        ({"members": ["10.0.0.1"], "ssh_ports": [70000]}, "ssh_ports has 70000"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(options, sentence):
    with pytest.raises(Problem) as problem:
        read(**options)
    assert str(problem.value).startswith(sentence)
