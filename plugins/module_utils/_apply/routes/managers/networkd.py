# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by systemd-networkd: a drop-in of the .network file that configures the interface (systemd.network(5))."""

import glob
import os
import re
import time
import typing

from ...._base import commands
from ...._base.plain_text import LINE, quote
from ...._base.problem import Problem
from ...transaction import atomic
from ..kernel import RouteSpec
from . import contract

FOLDER = "/etc/systemd/network"
DROP_IN = f"90-{contract.NAME}.conf"
_UNIT = "systemd-networkd.service"
_LIMIT = 60.0  # seconds; a restart takes a few tenths, and until all links are configured 0.4 to 2 on an idle machine
_STEP = 0.1  # seconds
_OLDEST = 249  # systemd with ManageForeignRoutingPolicyRules=
_NETPLAN = "10-netplan-"
_FREE = ("unmanaged", "linger", "initialized", "pending", "")  # states of a link that networkd does not configure

# The files in force until the next boot, after networkd has read routes.
_FOLDERS = tuple(f"{top}/systemd/network" for top in ("/etc", "/run", "/usr/local/lib", "/usr/lib", "/lib"))
_MANAGER = f"/run/systemd/networkd.conf.d/90-{contract.NAME}.conf"
_KEEP = f"90-{contract.NAME}-keep.conf"
_FOREIGN = contract.HEADER + "[Network]\nManageForeignRoutes=no\nManageForeignRoutingPolicyRules=no\n"
_STATIC = contract.HEADER + "[Network]\nKeepConfiguration=static\n"
_DHCP = re.compile(r"^[ \t]*DHCP[ \t]*=[ \t]*(?!no\b|none\b|false\b|off\b|0\b)\S", re.MULTILINE | re.IGNORECASE)


class BackEnd(contract.BackEnd):
    """systemd-networkd."""

    name = "networkd"

    def list_interfaces(self) -> typing.Set[str]:
        """The interfaces that networkd configures with a .network file."""
        return {name for name in self.machine.interfaces if self.network_file(name)}

    def _state_file(self, interface: str) -> str:
        return self.machine.path(f"/run/systemd/netif/links/{self.machine.interfaces[interface].index}")

    def _read_state(self, interface: str) -> typing.Dict[str, str]:
        """The state of a link. networkctl prints the same for people only. The names in the file are unchanged since systemd 209."""
        text = commands.text(self._state_file(interface))
        return {name: value for name, _equals, value in (line.partition("=") for line in text.splitlines())}

    def network_file(self, interface: str) -> str:
        """The .network file with which networkd configures an interface, "" without such a file."""
        state = self._read_state(interface)
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

    # Notifying networkd

    def activate(self, places: typing.List[str]) -> None:
        """Restart networkd, so that it knows the routes when a link comes back after an interruption.

        A restart, a reload or a reconfiguration by itself deletes addresses, routes and foreign rules, and networkd's own
        addresses for a moment. So files below /run, written before that, let it keep all that it finds. They stay until the next
        boot: if they went, a foreign reload would find another configuration, and do the same.
        If that is not enough, networkd is not restarted, and reads the routes at the next boot (`explain_delay`).
        Measured on virtual machines by `tests/machines/`; a container has no udev, and there networkd deletes nothing.
        """
        if not self._is_running() or self.explain_delay():
            return
        for path, text in self._list_kept().items():
            atomic.make_folders(os.path.dirname(self.machine.path(path)))
            atomic.write_by_rename(self.machine.path(path), text.encode("utf-8"), mode=self.mode)
        configured = {name: self._read_moment(name) for name in self.machine.interfaces if self._is_configured(name)}
        answer = commands.run(["systemctl", "restart", _UNIT], limit=_LIMIT)
        if answer.status != 0:
            raise Problem(
                f"routes: systemd-networkd could not be restarted with {', '.join(map(quote, places))} "
                f"({quote(answer.error, LINE) or 'without a word'}), expected it running: see journalctl -u {_UNIT}."
            )
        self._wait(configured)

    def explain_delay(self) -> str:
        if not self._is_running():
            return ""
        version = _read_version()
        if version < _OLDEST:
            return f"systemd {version} has no settings by which it keeps foreign rules and routes"
        dynamic = [name for name in sorted(self.list_interfaces()) if self._is_dynamic(name)]
        return (
            f"{', '.join(map(quote, dynamic))} may have a lease or an address by DHCP or router advertisements"
            if dynamic
            else ""
        )

    def _is_running(self) -> bool:
        return self.machine.booted and commands.run(["systemctl", "is-active", "--quiet", _UNIT]).status == 0

    def _is_dynamic(self, interface: str) -> bool:
        """True for an interface that has, or waits for, addresses that networkd is given by others."""
        file = self.network_file(interface)
        parts = [f"{folder}/{glob.escape(os.path.basename(file))}.d/*.conf" for folder in _FOLDERS]
        paths = [self.machine.path(file), *(path for part in parts for path in glob.glob(self.machine.path(part)))]
        texts = [commands.text(path) for path in paths]
        if any(_DHCP.search(text) for text in texts):
            return True
        return bool(commands.run(["ip", "-oneline", "address", "show", "dev", interface, "dynamic"]).text.strip())

    def _list_kept(self) -> typing.Dict[str, str]:
        """The files below /run by which a restart deletes nothing: path -> text."""
        names = {os.path.basename(self.network_file(name)) for name in self.list_interfaces()}
        return {_MANAGER: _FOREIGN, **{f"/run/systemd/network/{name}.d/{_KEEP}": _STATIC for name in sorted(names)}}

    # The state files of networkd: after a restart each is written anew, before the link is configured and after that.

    def _read_moment(self, interface: str) -> int:
        try:
            return os.stat(self._state_file(interface)).st_mtime_ns
        except OSError:
            return 0

    def _is_configured(self, interface: str) -> bool:
        return self._read_state(interface).get("ADMIN_STATE") == "configured"

    def _wait(self, configured: typing.Mapping[str, int]) -> None:
        """Wait until networkd has configured these links again, each since its moment. Raises Problem."""
        deadline = time.monotonic() + _LIMIT
        missing = list(configured)
        while missing:
            missing = [
                name for name in missing if not self._is_configured(name) or self._read_moment(name) == configured[name]
            ]
            if missing and time.monotonic() > deadline:
                states = ", ".join(
                    f"{quote(name)} is {quote(self._read_state(name).get('ADMIN_STATE', '')) or 'unknown to it'}"
                    for name in missing
                )
                raise Problem(
                    f"routes: {_LIMIT:.0f} s after its restart, systemd-networkd has not configured all links again ({states}), expected them "
                    f"configured: see networkctl status {quote(missing[0])}."
                )
            if missing:
                time.sleep(_STEP)


def _read_version() -> int:
    """The version of systemd, 0 if it is not known."""
    match = re.match(r"systemd (\d{1,6})", commands.run(["networkctl", "--version"]).text)
    return int(match.group(1)) if match else 0


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


def _render_section(route: RouteSpec) -> str:
    values = [(key, getattr(route, field), usual) for key, field, usual in _KEYS]
    lines = [f"{key}={'yes' if value is True else value}" for key, value, usual in values if value != usual]
    return "\n[Route]\n" + "\n".join(lines) + "\n"
