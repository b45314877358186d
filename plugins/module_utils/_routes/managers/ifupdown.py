# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by ifupdown: the hook in /etc/network/if-up.d of the report's Fig. 11."""

import os
import shlex
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import Route, words_of
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers import contract

# run-parts(8) passes over names with a dot, so the name has none.
HOOK = "/etc/network/if-up.d/" + contract.NAME
# ifupdown of Debian; ifupdown-ng and ifupdown2, which run the same hooks.
STATES = ("run/network/ifstate", "run/ifstate")

# ifup runs the hook once for every stanza of an interface, so a route of IPv6 may come too early in the first of them:
# `replace` may be repeated, and what fails is silent, since ifup takes a failing hook for a failing interface.
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
    """ifupdown, and what is compatible with it."""

    name = "ifupdown"
    mode = 0o755
    has_last_word = True  # hooks run after everything that the stanza of an interface asks for

    def owns(self) -> typing.Set[str]:
        """The interfaces that ifup has brought up, from its own list of them."""
        lines = [line for path in STATES for line in commands.text(self.path(path)).splitlines()]
        names = {line.partition("=")[0].split()[0] for line in lines if line.strip()}
        return {name for name in names if name in self.machine.interfaces}

    def read(self) -> contract.Places:
        text = self.own_text(HOOK)
        return {} if text is None else {HOOK: text}

    def place(self, interface: str) -> str:
        if not os.path.isdir(self.path("/etc/network")):
            raise Problem(
                "routes: %s shall have its routes by ifupdown, and there is no /etc/network, expected ifupdown installed: "
                "install it, or choose another backend." % interface
            )
        return HOOK

    def render(self, routes: typing.Dict[str, typing.List[Route]]) -> contract.Wanted:
        if not any(routes.values()):
            return {HOOK: None}
        # A route without a device belongs to no interface: whichever comes up first makes it.
        everywhere = [route for name in sorted(routes) for route in routes[name] if not route.device]
        text = _BEGIN + "".join("\n" + _line(route) for route in everywhere) + ("\n" if everywhere else "")
        cases = {name: [route for route in routes[name] if route.device] for name in sorted(routes)}
        if any(cases.values()):
            text += '\ncase "$IFACE" in\n'
            for name, listed in cases.items():
                if listed:
                    lines = "".join("    %s\n" % _line(route) for route in listed)
                    text += "%s)\n%s    ;;\n" % (shlex.quote(name), lines)
            text += "esac\n"
        return {HOOK: text}


def _line(route: Route) -> str:
    return " ".join(["replace", "-%d" % route.version] + [shlex.quote(word) for word in words_of(route)])
