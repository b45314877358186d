# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The options of multimaster_verify, checked before anything is sent."""

import typing

from .._base.background import find_wrong_value
from .._machine.network import is_address
from .measure.network import is_network

Params = typing.Dict[str, typing.Any]


def find_wrong_option(params: Params) -> typing.Optional[str]:
    """Name in one sentence the option that cannot be used; None if all can."""
    bounds = (("patience", 0, 600), ("lifetime", 10, 7200), ("seconds", 0.1, 2))
    wrong_value = find_wrong_value(params, bounds, " seconds")
    if wrong_value:
        return wrong_value
    members = [member["name"] for member in params["members"] or []]
    if members and params["name"] not in members and not params["is_router"]:
        return (
            f"name is {params['name']!r}, which is not among members ({', '.join(members)}); "
            "add this computer to the list."
        )
    return next(filter(None, list_wrong_places(params)), None)


def list_wrong_places(params: Params) -> typing.Iterator[str]:
    """Find the texts that are no address, network or port, one sentence each."""
    members, masters = params["members"] or [], params["masters"] or []
    ports = [("port", params["port"])]
    addresses = []
    for member in members:
        place = f"members: the %s of {member['name']}"
        addresses.append((place % "address", member["address"]))
        if member["discovery_address"]:
            addresses.append((place % "discovery_address", member["discovery_address"]))
        if member["network"] and not is_network(member["network"]):
            yield f"{place % 'network'} is {member['network']!r}, expected a network such as 192.168.1.0/24."
    for master in masters:
        addresses.append((f"masters: the address of {master['computer']}", master["address"]))
        if master.get("roscore"):
            addresses.append((f"masters: the roscore of {master['computer']}", master["roscore"]))
        ports.append((f"masters: the rpc_port of {master['computer']}", master["rpc_port"]))
    for place, address in addresses:
        if not is_address(address):
            yield f"{place} is {address!r}, expected an IPv4 address such as 192.168.1.239."
    for place, number in ports:
        if not 1 <= number <= 65535:
            yield f"{place} is {number}, expected a port from 1 to 65535."
