# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The services of discovery and sync nodes at a roscore, under whatever name, and whose they are.

The bundled nodes, multimaster_fkie and fkie_mas have the same services below names of their own. Some sync nodes register
even those of another robot, which would list the registrations there.
"""

import typing

from ..._base.deadlines import call_all
from ..._contract.outcomes import Outcome
from ..._machine import network
from ..._machine.outcomes import classify_error
from .hosts import host_of
from .xml_rpc import ask

LIST_MASTERS, SYNC_INFO = "/list_masters", "/get_sync_info"  # the ends of their names
USUAL = ("/master_discovery/", "/master_sync/", "/mas_discovery/", "/mas_sync/")
MOST = 8  # services of one kind that are looked at: one of each is usual
NAMES = 5.0  # seconds for the addresses of all hosts


def find_own(roscore: str, caller: str, services: typing.Iterable[str], end: str) -> typing.List[str]:
    """List the services with this end of their name that nodes of this robot provide, those with usual names first.

    `roscore` is its URI. A service whose host has no address is the last: its owner is unknown.
    """
    names = sorted(
        (name for name in services if name.endswith(end)), key=lambda name: (not name.startswith(USUAL), name)
    )
    hosts = _look_up(roscore, caller, names[:MOST])
    here = host_of(roscore)
    others = sorted({host for host in hosts.values() if host not in ("", here)})
    if not others:  # the usual case: nothing is looked up
        return sorted(hosts, key=lambda name: hosts[name] == "")
    found = call_all(network.resolve, [here, *others], NAMES, lambda host: ([], ""))
    addresses = {host: set(those) for host, (those, _error) in zip([here, *others], found)}
    ours = addresses[here] | _list_own_addresses()
    own = [name for name, host in hosts.items() if host == here or addresses.get(host, set()) & ours]
    return own + [name for name, host in hosts.items() if name not in own and not addresses.get(host)]


def _look_up(roscore: str, caller: str, services: typing.Sequence[str]) -> typing.Dict[str, str]:
    """Return the hosts of services; empty for those that the roscore does not know, and for the rest as soon as it gives no answer."""
    hosts = dict.fromkeys(services, "")
    for service in services:
        try:
            hosts[service] = host_of(str(ask(roscore, caller, "lookupService", service)))
        except OSError as problem:
            if classify_error(problem.__cause__)[0] == Outcome.NO_ANSWER:
                break
    return hosts


def _list_own_addresses() -> typing.Set[str]:
    """List the addresses of this computer: its nodes may use any of them, whatever the roscore's name is."""
    try:
        return {address.address for entry in network.interfaces() for address in entry.addresses}
    except OSError:
        return set()
