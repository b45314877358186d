# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by systemd-networkd: a drop-in of the .network file that configures the interface (systemd.network(5))."""

import os
import typing

from ..._module.plain_text import LINE, quote
from ..._module.problem import Problem
from ..._process import commands
from ..kernel import Route
from . import contract

FOLDER = "/etc/systemd/network"
DROP_IN = f"90-{contract.NAME}.conf"
_UNIT = "systemd-networkd.service"
_LIMIT = 60.0  # seconds; a restart takes a few tenths
_NETPLAN = "10-netplan-"
_FREE = ("unmanaged", "linger", "initialized", "pending", "")  # states of a link that networkd does not configure


class BackEnd(contract.BackEnd):
    """systemd-networkd."""

    name = "networkd"

    def list_interfaces(self) -> typing.Set[str]:
        """The interfaces that networkd configures with a .network file."""
        return {name for name in self.machine.interfaces if self.network_file(name)}

    def network_file(self, interface: str) -> str:
        """The .network file with which networkd configures an interface, "" for none."""
        # networkctl prints the same for people only. The names in this file are unchanged since systemd 209.
        text = commands.text(self.machine.path(f"/run/systemd/netif/links/{self.machine.interfaces[interface].index}"))
        state = dict(line.partition("=")[::2] for line in text.splitlines())
        return "" if state.get("ADMIN_STATE", "") in _FREE else state.get("NETWORK_FILE", "")

    def list_places(self) -> typing.List[str]:
        try:
            names = sorted(os.listdir(self.machine.path(FOLDER)))
        except OSError:
            return []
        return [f"{FOLDER}/{name}/{DROP_IN}" for name in names if name.endswith(".network.d")]

    def find_place(self, interface: str) -> str:
        file = self.network_file(interface)
        where = f"routes: {interface} shall have its routes by networkd, and"
        if not file:
            raise Problem(
                f"{where} networkd configures it by no .network file, expected one: write one that matches it, or choose "
                "another backend."
            )
        if os.path.basename(file).startswith(_NETPLAN):
            raise Problem(
                f"{where} {quote(file)} is written by netplan, which may give it another name: choose the backend netplan."
            )
        sharers = [name for name in self.machine.interfaces if self.network_file(name) == file]
        what = f"routes: {interface} is configured by {quote(file)},"
        self.refuse_shared(interface, sharers, what, "and so is {}", "a .network file")
        return f"{FOLDER}/{os.path.basename(file)}.d/{DROP_IN}"

    def render(self, place: str, routes: contract.RoutesByInterface) -> str:
        sections = [_render_section(route) for interface_routes in routes.values() for route in interface_routes]
        return contract.HEADER + "".join(sections)

    def activate(self, places: typing.List[str]) -> None:
        """Restart networkd, so that it knows the routes when the link comes back after an interruption.

        Measured with systemd 252 and `ip monitor`: `networkctl reload` removes the addresses, and with them every route,
        and then restores what it knows. A restart finds everything as planned and deletes nothing: no address, no route
        of ours or of others. It keeps leases of DHCP as well (RestartKillSignal= of the unit, since systemd 244).
        """
        if not self.machine.booted or commands.run(["systemctl", "is-active", "--quiet", _UNIT]).status != 0:
            return
        answer = commands.run(["systemctl", "restart", _UNIT], limit=_LIMIT)
        if answer.status != 0:
            raise Problem(
                f"routes: systemd-networkd could not be restarted with {', '.join(map(quote, places))} "
                f"({quote(answer.error, LINE) or 'without a word'}), expected it running: see journalctl -u {_UNIT}."
            )


# The names of the fields of a route in systemd.network(5), and the value that needs no line.
_KEYS = (
    ("Destination", "destination", ""),
    ("Gateway", "gateway", ""),
    ("GatewayOnLink", "on_link", False),
    ("PreferredSource", "source", ""),
    ("Metric", "metric", 0),
    ("Table", "table", 254),
    ("Type", "type", "unicast"),
    ("Scope", "scope", ""),
    ("MTUBytes", "mtu", 0),
    ("TCPAdvertisedMaximumSegmentSize", "advmss", 0),
    ("InitialCongestionWindow", "initcwnd", 0),
)


def _render_section(route: Route) -> str:
    values = [(key, getattr(route, field), usual) for key, field, usual in _KEYS]
    lines = [f"{key}={'yes' if value is True else value}" for key, value, usual in values if value != usual]
    return "\n[Route]\n" + "\n".join(lines) + "\n"
