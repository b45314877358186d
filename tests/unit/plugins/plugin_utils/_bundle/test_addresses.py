# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Other addresses of the same structure."""

from ipaddress import IPv4Address, IPv4Network

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.addresses import Addresses
from hypothesis import given
from hypothesis import strategies as st

NETWORKS = [
    IPv4Network(text) for text in ("192.168.1.0/24", "172.16.0.0/16", "10.0.0.0/8", "192.168.11.0/24", "10.1.2.0/30")
]


def test_networks_and_the_places_in_them():
    other = Addresses(NETWORKS)
    for network in NETWORKS:
        new = other.network(network)
        assert new.prefixlen == network.prefixlen and new != network
        assert other.address(network[1]) == new[1] and other.address(network.broadcast_address) == new.broadcast_address
    assert other.network(NETWORKS[4]).subnet_of(other.network(NETWORKS[2]))
    assert not other.network(NETWORKS[0]).overlaps(other.network(NETWORKS[3]))


@pytest.mark.parametrize("text", ["0.0.0.0", "127.0.1.1", "224.0.0.1", "226.0.0.0", "255.255.255.255", "169.254.3.4"])
def test_what_means_the_same_everywhere(text):
    assert str(Addresses(NETWORKS).address(IPv4Address(text))) == text


def test_the_default_route_stays():
    assert Addresses(NETWORKS).network(IPv4Network("0.0.0.0/0")) == IPv4Network("0.0.0.0/0")


def test_an_address_outside_the_plan_keeps_its_neighbours():
    other = Addresses(NETWORKS)
    one, two, far = (other.address(IPv4Address(text)) for text in ("8.8.8.8", "8.8.8.4", "9.9.9.9"))
    assert int(one) - int(two) == 4 and (int(one) & 255) == 8 and abs(int(far) - int(one)) > 200


@given(st.lists(st.ip_addresses(v=4), max_size=40, unique=True))
def test_two_addresses_stay_two(addresses):
    other = Addresses(NETWORKS)
    assert len({other.address(address) for address in addresses}) == len(addresses)
