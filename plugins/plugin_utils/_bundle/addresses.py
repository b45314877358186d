# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Addresses, replaced by others of the same structure. Pure.

Each network of the plan becomes a new one of the same length. Networks inside it stay inside it, and an address keeps its place
in its network. So neighbours, gateways and broadcast addresses can still be recognised. An address outside the plan moves with
its /24. Addresses that mean the same everywhere stay: loopback, link-local, multicast.
"""

from __future__ import annotations

from collections.abc import Iterable
from ipaddress import IPv4Address, IPv4Network, collapse_addresses

_EVERYWHERE = tuple(map(IPv4Network, ("0.0.0.0/8", "127.0.0.0/8", "169.254.0.0/16", "224.0.0.0/3")))
_NEIGHBOURS = 24  # the length of the network that an address outside the plan is taken to be in
_WIDEST = 8
_FIRST = int(IPv4Address("10.1.0.0"))
_ALL = 1 << 32


class Addresses:
    """Replaces addresses: equal ones by equal ones."""

    def __init__(self, networks: Iterable[IPv4Network]) -> None:
        known = [entry for entry in networks if entry.prefixlen >= _WIDEST and not _stays(entry.network_address)]
        self._next = _FIRST
        self._new: dict[IPv4Network, IPv4Network] = {}
        for network in sorted(collapse_addresses(known), key=lambda entry: (entry.prefixlen, entry)):
            self._place(network)

    def address(self, old: IPv4Address) -> IPv4Address:
        """Return the address in the place of `old`."""
        return self.network(IPv4Network(old)).network_address

    def network(self, old: IPv4Network) -> IPv4Network:
        """Return the network in the place of `old`."""
        first = old.network_address
        if old.prefixlen < _WIDEST or _stays(first):
            return old
        around = self._around(first)
        if around is None or around.prefixlen > old.prefixlen:
            around = old if old.prefixlen < _NEIGHBOURS else old.supernet(new_prefix=_NEIGHBOURS)
        return IPv4Network((self._move(first, around), old.prefixlen))

    def _move(self, old: IPv4Address, around: IPv4Network) -> IPv4Address:
        place = int(old) - int(around.network_address)
        return IPv4Address(int(self._place(around).network_address) + place)

    def _around(self, old: IPv4Address) -> IPv4Network | None:
        """Return the known network that an address is in."""
        return next((entry for entry in self._new if old in entry), None)

    def _place(self, network: IPv4Network) -> IPv4Network:
        """Return the network in the place of this one: the next that is free."""
        if network not in self._new:
            size = network.num_addresses
            begin = -(-self._next // size) * size
            if begin + size > _ALL:  # no fleet has so many networks
                begin = size if size < _FIRST else 0
            self._next = begin + size
            self._new[network] = IPv4Network((begin, network.prefixlen))
        return self._new[network]


def _stays(address: IPv4Address) -> bool:
    return any(address in network for network in _EVERYWHERE)
