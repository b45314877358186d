# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by netplan: a file of ours that adds routes to the definitions of other files (netplan(5)).

netplan merges the lists of routes of all files. Which definition an interface has is read from what netplan has generated
for the manager that configures it, so that no YAML has to be understood here.
"""

import glob
import os
import re
import shutil
import tempfile
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import Route
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers import contract, networkmanager
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers import networkd as routes_networkd

FILE = "/etc/netplan/90-%s.yaml" % contract.NAME
FOLDERS = ("etc/netplan", "run/netplan", "lib/netplan")  # what netplan reads
_GENERATED = "/run/systemd/network/10-netplan-"
_LIMIT = 60.0  # seconds; netplan generate takes a few tenths

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
    """netplan, with either of its renderers."""

    name = "netplan"
    mode = 0o600

    def __init__(self, machine: contract.Machine, root: str, recorded: typing.Dict[str, typing.List[str]]) -> None:
        super().__init__(machine, root, recorded)
        self._known: typing.Optional[typing.Dict[str, Definition]] = None

    # Who

    def _definitions(self) -> typing.Dict[str, Definition]:
        """The definitions by the interface on which they are in effect."""
        if self._known is None:
            self._known = dict(self._of_networkmanager())
            self._known.update(self._of_networkd())
        return self._known

    def _of_networkd(self) -> typing.Iterator[typing.Tuple[str, Definition]]:
        networkd = routes_networkd.BackEnd(self.machine, self.root, {})
        for interface in self.machine.interfaces:
            file = networkd.network_file(interface)
            if file.startswith(_GENERATED):
                name = file[len(_GENERATED) : -len(".network")]
                kind = _setting(commands.text(self.path("%s%s.netdev" % (_GENERATED, name))), "Kind")
                wifi = os.path.exists(self.path("/run/netplan/wpa-%s.conf" % name))
                yield interface, Definition(_section("wifi" if wifi else kind), name, file)

    def _of_networkmanager(self) -> typing.Iterator[typing.Tuple[str, Definition]]:
        if not self.machine.booted or not glob.glob(networkmanager.NETPLANS + "*"):
            return
        for interface, active in networkmanager.active_profiles().items():
            if active.netplan:
                text = commands.text(active.file)
                name = _setting(text, "id")[len("netplan-") :]
                kind = _setting(text, "type")
                if kind == "wifi":  # one profile per access point
                    name = name[: -len("-" + _setting(text, "ssid"))]
                yield interface, Definition(_section(kind), name, active.file)

    def owns(self) -> typing.Set[str]:
        """The interfaces that are configured by what netplan has generated."""
        return set(self._definitions())

    def read(self) -> contract.Places:
        text = self.own_text(FILE)
        return {} if text is None else {FILE: text}

    def place(self, interface: str) -> str:
        definition = self._definitions().get(interface)
        where = "routes: %s shall have its routes by netplan, and" % interface
        if definition is None:
            raise Problem(
                "%s nothing that netplan has generated configures it, expected a definition of it in effect: write one and "
                "apply it, or choose another backend." % where
            )
        others = [
            name for name, other in sorted(self._definitions().items()) if other == definition and name != interface
        ]
        if others:
            raise Problem(
                "%s its definition %s is that of %s too, which would get the same routes: give %s a definition of its own."
                % (where, definition.name, ", ".join(others), interface)
            )
        return FILE

    # What

    def render(self, routes: typing.Dict[str, typing.List[Route]]) -> contract.Wanted:
        sections: typing.Dict[str, typing.Dict[str, typing.List[str]]] = {}
        for interface, listed in sorted(routes.items()):
            if listed:
                self.place(interface)
                definition = self._definitions()[interface]
                lines = [line for route in listed for line in _entry(route)]
                sections.setdefault(definition.section, {}).setdefault(definition.name, []).extend(lines)
        if not sections:
            return {FILE: None}
        lines = ["network:", "  version: 2"]
        for section, definitions in sorted(sections.items()):
            lines.append("  %s:" % section)
            for name, entries in sorted(definitions.items()):
                lines += ["    %s:" % _quoted(name), "      routes:"] + entries
        return {FILE: contract.HEADER + "".join(line + "\n" for line in lines)}

    def check(self, wanted: contract.Wanted) -> None:
        """Have netplan generate from a copy of its folders with our file as it shall be."""
        copy = tempfile.mkdtemp(prefix="%s-netplan-" % contract.NAME)
        try:
            for folder in FOLDERS:
                if os.path.isdir(self.path(folder)):
                    shutil.copytree(self.path(folder), os.path.join(copy, folder), ignore_dangling_symlinks=True)
            path = os.path.join(copy, FILE.lstrip("/"))
            text = wanted.get(FILE)
            if text is None:
                atomic.remove(path)
            else:
                atomic.make_folders(os.path.dirname(path))
                atomic.write_by_rename(path, text.encode("utf-8"), mode=self.mode)
            answer = commands.run(["netplan", "generate", "--root-dir", copy], limit=_LIMIT)
            if answer.status != 0:
                raise Problem(
                    "routes: netplan refuses %s as it would be (%s): correct the routes, or set backend to none for those that "
                    "its renderer cannot make." % (FILE, _said(answer).replace(copy, ""))
                )
        finally:
            shutil.rmtree(copy, ignore_errors=True)

    # How

    def activate(self, places: typing.List[str]) -> None:
        """Generate, and let the manager behind it read what was generated; never `netplan apply`, which takes links down.

        Measured with netplan 0.106: `netplan generate` touches no interface. networkd then gets to know the routes by a
        restart (see _routes_networkd), NetworkManager by loading the profile, which it uses when it next activates it.
        """
        if not self.machine.booted:
            return
        answer = commands.run(["netplan", "generate"], limit=_LIMIT)
        if answer.status != 0:
            raise Problem("routes: 'netplan generate' failed (%s), expected it to work." % _said(answer))
        files = [definition.file for definition in self._definitions().values()]
        if any(file.startswith(networkmanager.NETPLANS) for file in files):
            # A definition of a wifi has one profile per access point.
            profiles = sorted(glob.glob(networkmanager.NETPLANS + "*"))
            answer = networkmanager.nmcli("connection", "load", *profiles)
            if answer.status != 0:
                raise Problem(
                    "routes: NetworkManager cannot load what netplan has generated (%s), expected it running."
                    % _said(answer)
                )
        if any(file.startswith(_GENERATED) for file in files):
            routes_networkd.BackEnd(self.machine, self.root, {}).activate(places)


def _section(kind: str) -> str:
    return _SECTIONS.get(kind, "tunnels")


def _setting(text: str, key: str) -> str:
    """The first value of a key in a file of networkd or NetworkManager."""
    found = re.search(r"^%s=(.*)$" % re.escape(key), text, re.MULTILINE)
    return found.group(1).strip() if found else ""


def _said(answer: commands.Answer) -> str:
    lines = [line for line in answer.error.splitlines() if line.strip() and "WARNING" not in line]
    return " ".join(" ".join(lines).split()).rstrip(".") or "without a word"


def _quoted(text: str) -> str:
    """A text as a scalar of YAML; none of these texts has anything to be escaped."""
    return '"%s"' % text


# What netplan(5) calls the fields of a route; a text that is empty has no line.
_KEYS = (
    ("to", "destination"),
    ("via", "gateway"),
    ("from", "source"),
    ("metric", "metric"),
    ("table", "table"),
    ("on-link", "on_link"),
    ("type", "type"),
)
_PLAIN = {"table": 254, "on_link": False, "type": "unicast"}  # what needs no line


def _entry(route: Route) -> typing.List[str]:
    lines = []
    for key, field in _KEYS:
        value = getattr(route, field)
        if value == "" or (field in _PLAIN and value == _PLAIN[field]):
            continue
        lines.append("%s: %s" % (key, "true" if value is True else _quoted(value) if ":" in str(value) else value))
    if route.type == "unicast" and not route.gateway:
        lines.append("scope: link")  # else netplan asks for a gateway
    return ["%s%s" % ("        - " if line is lines[0] else "          ", line) for line in lines]
