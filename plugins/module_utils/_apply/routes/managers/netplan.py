# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by netplan: a file of ours that adds routes to the definitions of other files (netplan(5)).

netplan merges the lists of routes of all files. The definition of an interface is read from the file that netplan has
generated for the manager behind it, so no YAML has to be read here.
"""

import glob
import os
import re
import shutil
import tempfile
import typing
import urllib.parse

from ...._base import commands
from ...._base.plain_text import LINE, quote
from ...._base.problem import Problem
from ...transaction import atomic
from ..kernel import DEFAULTS, RouteSpec
from . import contract, networkd, networkmanager

# Behind the files of others: netplan refuses routes for a wifi or a VLAN whose access points or link only a later file names.
FILE = f"/etc/netplan/zz-{contract.NAME}.yaml"
_EARLIER = f"/etc/netplan/90-{contract.NAME}.yaml"  # its name until version 1.1
FOLDERS = ("etc/netplan", "run/netplan", "lib/netplan")  # those that netplan reads
_GENERATED = "/run/systemd/network/10-netplan-"
_LIMIT = 60.0  # seconds; netplan generate takes a few tenths

_OTHERS = "tunnels"
# The section of a definition, by the kind of device that is generated for it; other kinds are tunnels.
_SECTIONS = {
    "": "ethernets",
    "bond": "bonds",
    "bridge": "bridges",
    "cdma": "modems",
    "dummy": "dummy-devices",
    "ethernet": "ethernets",
    "gsm": "modems",
    "veth": "virtual-ethernets",
    "vlan": "vlans",
    "vrf": "vrfs",
    "wifi": "wifis",
}


class Definition(typing.NamedTuple):
    """A definition of netplan, and the file of the manager that was generated from it."""

    section: str
    name: str
    file: str


class BackEnd(contract.BackEnd):
    """netplan, with networkd or NetworkManager behind it."""

    name = "netplan"
    mode = 0o600
    inexpressible = ("advmss",)

    def __init__(self, machine: contract.MachineContext, recorded: contract.RecordedTexts) -> None:
        super().__init__(machine, recorded)
        # by the interface on which they are in effect
        self._definitions = dict([*self._read_networkmanager(), *self._read_networkd()])
        self._rendered: contract.RoutesByInterface = {}

    # The definition of an interface

    def _read_networkd(self) -> typing.Iterator[typing.Tuple[str, Definition]]:
        manager = networkd.BackEnd(self.machine, {})
        for interface in self.machine.interfaces:
            file = manager.network_file(interface)
            if file.startswith(_GENERATED):
                name = file[len(_GENERATED) : -len(".network")]
                kind = _read_setting(commands.text(self.machine.path(f"{_GENERATED}{name}.netdev")), "Kind")
                wifi = os.path.exists(self.machine.path(f"/run/netplan/wpa-{name}.conf"))
                yield interface, Definition(_SECTIONS.get("wifi" if wifi else kind, _OTHERS), name, file)

    def _read_networkmanager(self) -> typing.Iterator[typing.Tuple[str, Definition]]:
        if not self.machine.booted or not glob.glob(networkmanager.NETPLANS + "*"):
            return
        for interface, active in networkmanager.active_profiles().items():
            if active.netplan:
                text = commands.text(active.file)
                kind = _read_setting(text, "type")
                name = read_name(active.file, _unescape(_read_setting(text, "ssid")) if kind == "wifi" else None)
                if name:
                    yield interface, Definition(_SECTIONS.get(kind, _OTHERS), name, active.file)

    def list_interfaces(self) -> typing.Set[str]:
        """The interfaces that netplan configures, by the files that it has generated for the manager behind it."""
        return set(self._definitions)

    def list_places(self) -> typing.List[str]:
        return [FILE, _EARLIER]

    def find_place(self, interface: str) -> str:
        definition = self._definitions.get(interface)
        where = f"routes: {interface} shall have its routes by netplan, and"
        if definition is None:
            raise Problem(
                f"{where} nothing that netplan has generated configures it, expected a definition of it in effect: write one "
                "and apply it, or choose another backend."
            )
        sharers = [name for name, other in self._definitions.items() if other == definition]
        what = f"{where} its definition {quote(definition.name)}"
        self.refuse_shared(interface, sharers, what, "is that of {} too", "a definition")
        return FILE

    # Our file

    def render(self, place: str, routes: contract.RoutesByInterface) -> str:
        self._rendered = routes
        sections: typing.Dict[str, typing.Dict[str, typing.List[str]]] = {}
        for interface, interface_routes in sorted(routes.items()):
            definition = self._definitions[interface]
            lines = [line for route in interface_routes for line in _render_route(route)]
            sections.setdefault(definition.section, {})[definition.name] = lines
        lines = ["network:", "  version: 2"]
        for section, definitions in sorted(sections.items()):
            lines.append(f"  {section}:")
            for name, entries in sorted(definitions.items()):
                lines += [f"    {_quote_yaml(name)}:", "      routes:", *entries]
        return contract.HEADER + "".join(f"{line}\n" for line in lines)

    def check(self, wanted: contract.PlannedTexts) -> None:
        """Run `netplan generate` on a copy of its folders with our file as wanted. Raises Problem if it refuses."""
        copy = tempfile.mkdtemp(prefix=f"{contract.NAME}-netplan-")
        try:
            for folder in FOLDERS:
                if os.path.isdir(self.machine.path(folder)):
                    shutil.copytree(
                        self.machine.path(folder), os.path.join(copy, folder), ignore_dangling_symlinks=True
                    )
            for place in self.list_places():
                path, text = os.path.join(copy, place.lstrip("/")), wanted.get(place)
                if text is None:
                    atomic.remove(path)
                else:
                    atomic.make_folders(os.path.dirname(path))
                    atomic.write_by_rename(path, text.encode("utf-8"), mode=self.mode)
            answer = commands.run(["netplan", "generate", "--root-dir", copy], limit=_LIMIT)
            if answer.status != 0:
                raise Problem(
                    f"routes: netplan refuses {FILE} as it would be ({quote(_read_error(answer).replace(copy, ''), LINE)}): correct the routes, or "
                    "set backend to none for those that its renderer cannot make."
                )
            self._check_generated(copy)
        finally:
            shutil.rmtree(copy, ignore_errors=True)

    def _check_generated(self, copy: str) -> None:
        """Raises Problem if the files that netplan has generated in a copy would not bring the routes to their interfaces."""
        for interface, routes in self._rendered.items():
            definition = self._definitions[interface]
            text = commands.text(os.path.join(copy, definition.file.lstrip("/")))
            absent = [route.destination for route in routes if route.destination not in text]
            if not text or [destination for destination in absent if destination not in DEFAULTS.values()]:
                raise Problem(
                    f"routes: {interface} is configured by {quote(definition.file)}, and netplan would generate it without the routes to "
                    f"{', '.join(absent or [route.destination for route in routes])}, expected them there by the definition "
                    f"{quote(definition.name)}: read it with 'netplan get', or set backend to none for these routes."
                )

    # Notifying netplan

    def activate(self, places: typing.List[str]) -> None:
        """Run `netplan generate`, and let the manager behind netplan read the result.

        Never `netplan apply`, which takes links down, and lets networkd delete foreign routes and rules. `netplan generate`
        touches no interface. networkd reads the routes when it is restarted as networkd.py does it; if it is not restarted, the
        files are generated at the next boot: a foreign reload finds nothing new. NetworkManager loads the profile, and
        uses it when it next activates it.
        """
        if not self.machine.booted:
            return
        files = [definition.file for definition in self._definitions.values()]
        profiles = (
            sorted(glob.glob(networkmanager.NETPLANS + "*")) if _any_below(files, networkmanager.NETPLANS) else []
        )
        if self.explain_delay() and not profiles:
            return
        answer = commands.run(["netplan", "generate"], limit=_LIMIT)
        if answer.status != 0:
            raise Problem(
                f"routes: 'netplan generate' failed ({quote(_read_error(answer), LINE)}), expected it to work."
            )
        if profiles:  # a definition of a wifi has one profile per access point
            answer = networkmanager.nmcli("connection", "load", *profiles)
            if answer.status != 0:
                raise Problem(
                    f"routes: NetworkManager cannot load the profile of netplan ({quote(_read_error(answer), LINE)}), expected it running."
                )
        if _any_below(files, _GENERATED):
            networkd.BackEnd(self.machine, {}).activate(places)

    def explain_delay(self) -> str:
        if not _any_below([definition.file for definition in self._definitions.values()], _GENERATED):
            return ""
        return networkd.BackEnd(self.machine, {}).explain_delay()


def read_name(file: str, ssid: typing.Optional[str]) -> str:
    """The name of the definition behind a profile of NetworkManager, "" if its file has another form.

    netplan names the file `netplan-NAME[-SSID].nmconnection`, in the form of a URI; people see the `id` in it.
    """
    match = re.fullmatch(r"netplan-(.+)\.nmconnection", os.path.basename(file))
    name = urllib.parse.unquote(match.group(1)) if match else ""
    end = "" if ssid is None else f"-{ssid}"  # a definition of a wifi has one profile per access point
    return name[: len(name) - len(end)] if name.endswith(end) else ""


def _unescape(text: str) -> str:
    """A value of a key file (GKeyFile) without its escapes."""
    return re.sub(
        r"\\(.)", lambda match: {"s": " ", "t": "\t", "n": "\n", "r": "\r"}.get(match.group(1), match.group(1)), text
    )


def _any_below(files: typing.Iterable[str], first: str) -> bool:
    return any(file.startswith(first) for file in files)


def _read_setting(text: str, key: str) -> str:
    """The first value of a key in a file of networkd or NetworkManager."""
    match = re.search(rf"^{re.escape(key)}=(.*)$", text, re.MULTILINE)
    return match.group(1).strip() if match else ""


def _read_error(answer: commands.Answer) -> str:
    lines = [line for line in answer.error.splitlines() if line.strip() and "WARNING" not in line]
    return " ".join(" ".join(lines).split()).rstrip(".") or "without a word"


def _quote_yaml(text: str) -> str:
    """A text as a scalar of YAML. These texts have no characters that need an escape."""
    return f'"{text}"'


# The names of the fields of a route in netplan(5), and the value that needs no line. An empty text needs no line either.
_KEYS = (
    ("to", "destination", ""),
    ("via", "gateway", ""),
    ("from", "source", ""),
    ("metric", "metric", ""),
    ("table", "table", 254),
    ("on-link", "on_link", False),
    ("type", "type", "unicast"),
    ("scope", "scope", ""),
    ("mtu", "mtu", 0),
    ("congestion-window", "initcwnd", 0),
)


def _render_route(route: RouteSpec) -> typing.List[str]:
    values = [(key, getattr(route, field), usual) for key, field, usual in _KEYS]
    lines = [f"{key}: {_render_scalar(value)}" for key, value, usual in values if value not in ("", usual)]
    if route.type == "unicast" and not route.gateway and not route.scope:
        lines.append("scope: link")  # else netplan asks for a gateway
    return [f"        - {lines[0]}", *(f"          {line}" for line in lines[1:])]


def _render_scalar(value: typing.Any) -> typing.Any:
    if value is True:
        return "true"
    return _quote_yaml(value) if ":" in str(value) else value
