# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by ifupdown: the hook in /etc/network/if-up.d of the report's Fig. 11."""

import fnmatch
import glob
import os
import shlex
import typing

from ...._base import commands
from ...._base.plain_text import quote
from ...._base.problem import Problem
from ..kernel import RouteSpec, to_words
from . import contract

# run-parts(8) passes over names with a dot, so the name is without a dot.
HOOK = "/etc/network/if-up.d/" + contract.NAME
# The lists of interfaces that are up: of Debian's ifupdown, and of ifupdown-ng and ifupdown2, which run the same hooks.
STATES = ("run/network/ifstate", "run/ifstate")
INTERFACES = "/etc/network/interfaces"
_MOST_FILES = 200  # that are read

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

    def __init__(self, machine: contract.MachineContext, recorded: contract.RecordedTexts) -> None:
        super().__init__(machine, recorded)
        self._rendered: contract.RoutesByInterface = {}

    def list_interfaces(self) -> typing.Set[str]:
        """The interfaces that ifup has brought up, from its own list of them."""
        lines = [line for path in STATES for line in commands.text(self.machine.path(path)).splitlines()]
        # An alias, as `eth0:1`, has a stanza and a line of its own.
        names = {line.partition("=")[0].split()[0].partition(":")[0] for line in lines if line.strip()}
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
        self._rendered = routes
        # A route without a device belongs to no interface: the first interface that comes up makes it.
        everywhere = [route for name in sorted(routes) for route in routes[name] if not route.device]
        text = _BEGIN + "".join(f"\n{_line(route)}" for route in everywhere) + ("\n" if everywhere else "")
        cases = [_case(name, [route for route in routes[name] if route.device]) for name in sorted(routes)]
        if any(cases):
            text += f'\ncase "$IFACE" in\n{"".join(cases)}esac\n'
        return text

    def check(self, wanted: contract.PlannedTexts) -> None:
        """Raises Problem if ifup runs no hooks for an interface."""
        for place, words in self._read_interfaces():
            silent = words[1:] if words[0] == "no-scripts" else []
            for interface in self._rendered:
                if any(fnmatch.fnmatchcase(interface, pattern) for pattern in silent):
                    raise Problem(
                        f"routes: {quote(place)} says {quote(' '.join(words))}, so ifup runs no hook for {interface}, and none brings its routes "
                        "back at boot, expected hooks to run: take the interface out of that line, or set backend to none for its routes."
                    )

    def _read_interfaces(self) -> typing.Iterator[typing.Tuple[str, typing.List[str]]]:
        """The lines of interfaces(5) as words, each with its file, also of the files that they name."""
        places = [INTERFACES]
        for place in places:  # which grows
            for line in commands.text(self.machine.path(place)).replace("\\\n", " ").splitlines():
                words = line.split()
                if words and not words[0].startswith("#"):
                    yield place, words
                    named = (name for name in self._list_named(place, words) if name not in places)
                    places += list(named)[: _MOST_FILES - len(places)]

    def _list_named(self, place: str, words: typing.List[str]) -> typing.List[str]:
        """The files that a line of `place` names for reading."""
        end = {"source": "", "source-directory": "/*"}.get(words[0])
        if end is None:
            return []
        root = self.machine.path("/")
        patterns = [self.machine.path(os.path.join(os.path.dirname(place), word + end)) for word in words[1:]]
        found = [path for pattern in patterns for path in glob.glob(pattern) if os.path.isfile(path)]
        return [f"/{os.path.relpath(path, root)}" for path in found]


def _case(interface: str, routes: typing.List[RouteSpec]) -> str:
    """The lines for one interface and its aliases, whose networks may have gateways, too; "" without routes."""
    lines = "".join(f"    {_line(route)}\n" for route in routes)
    name = shlex.quote(interface)
    return f"{name} | {name}:*)\n{lines}    ;;\n" if routes else ""


def _line(route: RouteSpec) -> str:
    return " ".join(["replace", f"-{route.version}", *(shlex.quote(word) for word in to_words(route))])
