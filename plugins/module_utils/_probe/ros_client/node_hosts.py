# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The hosts that people's nodes announce, as they are in their URIs at the roscore."""

import collections
import typing

from ..._base.plain_text import LINE, plain
from .hosts import host_of, place_of

MOST = 100  # nodes and processes that are reported

Row = typing.Dict[str, typing.Any]
Members = typing.Iterable[typing.Dict[str, typing.Any]]


def list_hosts(members: Members, keep: typing.Callable[[typing.Dict[str, typing.Any]], bool]) -> typing.Set[str]:
    """List the planned names and addresses of the members that are kept, in small letters."""
    return {
        text.lower()
        for member in members
        if keep(member)
        for text in (member["name"], member["address"], member["discovery_address"])
        if text
    }


def announced(
    nodes: typing.Dict[str, str],
    services: typing.Dict[str, str],
    members: typing.Sequence[typing.Dict[str, typing.Any]],
    own: str,
) -> typing.List[Row]:
    """List the nodes ({node: URI}) that announce a host which is not a planned one of the own computer's robot, or services elsewhere.

    `services` has the URI of one service of each node. Each row has node, host, port, and the host of its services if that is
    another computer than the one of the node.
    """
    robots = {member["robot"] for member in members if member["name"] == own}
    computers = {
        host: member["name"] for member in members if member["robot"] in robots for host in list_hosts([member], bool)
    }
    found = []
    for node, uri in sorted(nodes.items()):
        (host, port), its = place_of(uri), host_of(services.get(node, ""))
        elsewhere = bool(host and its) and computers.get(host, host) != computers.get(its, its)
        if "://" in uri and (host not in computers or elsewhere):
            # A host in another spelling, which each program reads in its own way, is there with all of its URI.
            shown = host or plain(uri, LINE)
            found.append({"node": node, "host": shown, "port": port, "services": its if elsewhere else ""})
    return found[:MOST]


def count_hosts(nodes: typing.Dict[str, str]) -> typing.List[Row]:
    """Count the nodes ({node: URI}) of each host that is announced, those with most nodes first."""
    counts = collections.Counter(map(host_of, nodes.values()))
    return [{"host": host, "nodes": number} for host, number in counts.most_common(MOST)]
