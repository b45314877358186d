# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by ifupdown: the hook in /etc/network/if-up.d of the report's Fig. 11."""

import os
import shlex
import typing

from ...._base import commands
from ...._base.problem import Problem
from ..kernel import RouteSpec, to_words
from . import contract

# run-parts(8) passes over names with a dot, so the name is without a dot.
HOOK = "/etc/network/if-up.d/" + contract.NAME
# The lists of interfaces that are up: of Debian's ifupdown, and of ifupdown-ng and ifupdown2, which run the same hooks.
STATES = ("run/network/ifstate", "run/ifstate")

# ifup runs the hook once for every stanza of an interface, so the first time may be too early for a route of IPv6.
# `replace` may be repeated. A failure is silent, because for ifup a failing hook is a failing interface.
_BEGIN = (
    "#!/bin/sh\n"
    + contract.HEADER
    + """PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin

replace() {
    family=$1
    shift
    ip "$family" route replace "$@" 2>/dev/null || :
}
"""
)


class BackEnd(contract.BackEnd):
    """ifupdown, and the programs that are compatible with it (ifupdown-ng, ifupdown2)."""

    name = "ifupdown"
    mode = 0o755
    takes_precedence = True  # hooks run after everything that the stanza of an interface asks for

    def list_interfaces(self) -> typing.Set[str]:
        """The interfaces that ifup has brought up, from its own list of them."""
        lines = [line for path in STATES for line in commands.text(self.machine.path(path)).splitlines()]
        names = {line.partition("=")[0].split()[0] for line in lines if line.strip()}
        return {name for name in names if name in self.machine.interfaces}

    def list_places(self) -> typing.List[str]:
        return [HOOK]

    def find_place(self, interface: str) -> str:
        if not os.path.isdir(self.machine.path("/etc/network")):
            raise Problem(
                f"routes: {interface} shall have its routes by ifupdown, and there is no /etc/network, expected ifupdown "
                "installed: install it, or choose another backend."
            )
        return HOOK

    def render(self, place: str, routes: contract.RoutesByInterface) -> str:
        # A route without a device belongs to no interface: the first interface that comes up makes it.
        everywhere = [route for name in sorted(routes) for route in routes[name] if not route.device]
        text = _BEGIN + "".join(f"\n{_line(route)}" for route in everywhere) + ("\n" if everywhere else "")
        cases = [_case(name, [route for route in routes[name] if route.device]) for name in sorted(routes)]
        if any(cases):
            text += f'\ncase "$IFACE" in\n{"".join(cases)}esac\n'
        return text


def _case(interface: str, routes: typing.List[RouteSpec]) -> str:
    """The lines for one interface, "" without routes."""
    lines = "".join(f"    {_line(route)}\n" for route in routes)
    return f"{shlex.quote(interface)})\n{lines}    ;;\n" if routes else ""


def _line(route: RouteSpec) -> str:
    return " ".join(["replace", f"-{route.version}", *(shlex.quote(word) for word in to_words(route))])
