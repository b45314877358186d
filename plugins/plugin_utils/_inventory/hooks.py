# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The part of an optional feature in the reading of an inventory."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from ipaddress import IPv4Network

from .model import Fleet, Inventory
from .variables import FleetVariables


@dataclass(frozen=True)
class InventoryHooks:
    """The functions of a feature, in the order in which they are called."""

    #: its networks, each with the name of its variable: no address may be in two networks
    list_networks: Callable[[FleetVariables], Iterable[tuple[IPv4Network | None, str]]] = lambda shared: ()
    #: a sentence for each of its variables that cannot be
    find_wrong_variables: Callable[[FleetVariables], Iterable[str]] = lambda shared: ()
    #: the fleet as it is with the feature, once all values are read and compared
    change_fleet: Callable[[Fleet, Inventory], Fleet] = lambda fleet, inventory: fleet
    #: a sentence for each thing that it cannot be together with
    find_contradictions: Callable[[Fleet], Iterable[str]] = lambda fleet: ()
