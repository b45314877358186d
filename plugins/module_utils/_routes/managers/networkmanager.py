# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by NetworkManager: more routes in the profile that is active on the interface (nm-settings-nmcli(5)).

A profile is somebody else's, so a place is no file but `nmcli:<uuid>`, and its text is one line per route of ours, as
`nmcli connection modify` takes it: "ipv4.routes 192.168.11.0/24 192.168.1.201 0".
"""

import ipaddress
import shutil
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import MAIN, Route
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers import contract

PREFIX = "nmcli:"
NETPLANS = "/run/NetworkManager/system-connections/netplan-"  # how the profiles begin that netplan writes
_LIMIT = 30.0  # seconds; a change takes some hundredths
_NOT_THERE = 10  # exit status of nmcli(1): no such connection, device or access point
_EXTERNAL = "(externally)"  # NetworkManager shows what somebody else has configured, and does nothing with it
_WITHOUT = ("disabled", "ignore")  # methods with which a profile's routes are not made


class Active(typing.NamedTuple):
    """The profile that is active on an interface."""

    uuid: str
    external: bool
    file: str  # "" where nmcli is too old to say it (before 1.12)

    @property
    def netplan(self) -> bool:
        """Whether netplan has written it."""
        return self.file.startswith(NETPLANS)


class Profile(typing.NamedTuple):
    """What a profile says about routes: the tables and methods by IP version, and its routes as lines."""

    autoconnect: bool
    methods: typing.Dict[int, str]
    tables: typing.Dict[int, int]
    lines: typing.List[str]


def nmcli(*words: str) -> commands.Answer:
    """Ask or tell NetworkManager, in the form for programs."""
    return commands.run(("nmcli", "--terse", "--escape", "no") + words, limit=_LIMIT)


def active_profiles() -> typing.Dict[str, Active]:
    """The active profiles by interface; none where NetworkManager is not there or does not run."""
    devices = nmcli("--fields", "DEVICE,CON-UUID,STATE", "device")
    if devices.status != 0:
        return {}
    files = dict(_fields(nmcli("--fields", "UUID,FILENAME", "connection", "show", "--active"), 2))
    return {
        device: Active(uuid, _EXTERNAL in state, files.get(uuid, ""))
        for device, uuid, state in _fields(devices, 3)
        if uuid and state.startswith("connected")
    }


def _fields(answer: commands.Answer, number: int) -> typing.List[typing.List[str]]:
    lines = answer.output.decode("utf-8", "replace").splitlines() if answer.status == 0 else []
    return [line.split(":", number - 1) for line in lines if line.count(":") >= number - 1]


class BackEnd(contract.BackEnd):
    """NetworkManager."""

    name = "networkmanager"

    def __init__(self, machine: contract.Machine, root: str, recorded: typing.Dict[str, typing.List[str]]) -> None:
        super().__init__(machine, root, recorded)
        self._known: typing.Optional[typing.Dict[str, Active]] = None
        self._profiles: typing.Dict[str, typing.Optional[Profile]] = {}
        self._ours = {place: set(_lines("".join(texts))) for place, texts in recorded.items()}

    # Who

    def _active(self) -> typing.Dict[str, Active]:
        if self._known is None:
            self._known = active_profiles() if self.machine.booted else {}
        return self._known

    def owns(self) -> typing.Set[str]:
        """The interfaces on which NetworkManager has activated a profile, other than netplan's."""
        return {name for name, active in self._active().items() if not active.external and not active.netplan}

    def place(self, interface: str) -> str:
        active = self._active().get(interface)
        where = "routes: %s shall have its routes by NetworkManager, and" % interface
        if active is None:
            raise Problem(
                "%s no profile is active there, expected one: activate a profile (nmcli device), or choose another backend."
                % where
            )
        if active.external:
            raise Problem(
                "%s it is 'connected (externally)': somebody else has configured it and NetworkManager looks on, expected an "
                "active profile in /etc/NetworkManager/system-connections: add one (nmcli connection add), or choose the "
                "backend that configures it." % where
            )
        if active.netplan:
            raise Problem("%s its profile %s is written by netplan: choose the backend netplan." % (where, active.file))
        if active.file.startswith("/run/"):
            raise Problem(
                "%s its profile %s is only in memory and gone after a reboot, expected one in "
                "/etc/NetworkManager/system-connections: save it (nmcli connection modify %s connection.autoconnect yes)."
                % (where, active.file, active.uuid)
            )
        others = sorted(
            name for name, other in self._active().items() if name != interface and other.uuid == active.uuid
        )
        if others:
            raise Problem(
                "%s its profile %s is active on %s too, which would get the same routes: give %s a profile of its own."
                % (where, active.uuid, ", ".join(others), interface)
            )
        return PREFIX + active.uuid

    # What

    def _profile(self, place: str) -> typing.Optional[Profile]:
        """A profile as it was when this run first looked, None where it is gone."""
        if place not in self._profiles:
            self._profiles[place] = _ask(place)
        return self._profiles[place]

    def read(self) -> contract.Places:
        found = {}
        for place in sorted(self.recorded) if self.machine.booted else []:
            profile = self._profile(place)
            text = _text(line for line in profile.lines if line in self._ours[place]) if profile else None
            if text is not None:
                found[place] = text
        return found

    def render(self, routes: typing.Dict[str, typing.List[Route]]) -> contract.Wanted:
        wanted: contract.Wanted = dict.fromkeys(self.read())
        for interface, listed in routes.items():
            place = self.place(interface)
            profile = self._profile(place)
            if profile is None:
                raise Problem("routes: the profile %s of %s is gone: run again." % (place, interface))
            # What the profile has by itself is not ours, so it is never taken from it.
            others = set(profile.lines) - self._ours.get(place, set())
            lines = {line_of(route, profile.tables[route.version]) for route in listed}
            wanted[place] = _text(lines - others)
        return wanted

    def check(self, wanted: contract.Wanted) -> None:
        """A profile's routes are made at boot only with these settings of it; nmcli itself refuses a whole change or none."""
        for place, text in wanted.items():
            profile = self._profile(place)
            if text is None or profile is None:
                continue
            if not profile.autoconnect:
                raise Problem(
                    "routes: the profile %s has connection.autoconnect no, so it brings no routes back at boot, expected yes: "
                    "nmcli connection modify %s connection.autoconnect yes." % (_uuid(place), _uuid(place))
                )
            for version in sorted({_version(line) for line in _lines(text)}):
                if profile.methods[version] in _WITHOUT:
                    raise Problem(
                        "routes: the profile %s has ipv%d.method %s, with which it makes no route of IPv%d, expected one of "
                        "manual, auto: configure IPv%d in it, or set backend to none for these routes."
                        % (_uuid(place), version, profile.methods[version], version, version)
                    )

    # How

    def write(self, place: str, content: typing.Optional[str]) -> None:
        """Add what is missing in the profile and take out what was ours, in one step of NetworkManager: all or nothing."""
        profile, wanted = _ask(place), _lines(content or "")
        if profile is None:
            if content is None:
                return
            raise Problem("routes: the profile %s is gone, expected it there: run again." % _uuid(place))
        ours = self._ours.setdefault(place, set())
        goes = [line for line in profile.lines if line in ours and line not in wanted]
        comes = [line for line in wanted if line not in profile.lines]
        ours.update(wanted)
        words = []
        for sign, lines in (("-", goes), ("+", comes)):
            for line in lines:
                setting, _space, route = line.partition(" ")
                words += [sign + setting, route]
        if words:
            answer = nmcli("connection", "modify", "uuid", _uuid(place), *words)
            if answer.status != 0:
                raise Problem(
                    "routes: NetworkManager refuses the change of the profile %s (%s)." % (_uuid(place), _said(answer))
                )

    def activate(self, places: typing.List[str]) -> None:
        """Nothing to be done: the kernel has the routes, and the profile brings them back.

        Measured with NetworkManager 1.42 and `ip monitor`: `nmcli device reapply` deletes the addresses of IPv6, routes and
        addresses of others, and with the flag that is to keep those it loses the addresses of IPv6 for good. Without it the
        routes stay over a short loss of carrier; after a longer one, as at boot, NetworkManager reads the profile anew.
        """


# Profiles and lines


def _uuid(place: str) -> str:
    return place[len(PREFIX) :]


def _said(answer: commands.Answer) -> str:
    return " ".join(answer.error.split()).replace("Error: ", "").rstrip(".") or "without a word"


def _ask(place: str) -> typing.Optional[Profile]:
    """A profile, None where it is gone, or NetworkManager with it. Raises Problem where it cannot be read."""
    names = ["connection.autoconnect"]
    names += ["ipv%d.%s" % (version, name) for version in (4, 6) for name in ("method", "route-table", "routes")]
    answer = nmcli("--fields", ",".join(names), "connection", "show", "uuid", _uuid(place))
    if answer.status == _NOT_THERE or not shutil.which("nmcli", path=commands.BASE_PATH):
        return None
    if answer.status != 0:
        raise Problem(
            "routes: the profile %s of NetworkManager cannot be read (%s), expected NetworkManager running: start it."
            % (_uuid(place), _said(answer))
        )
    values = dict(_fields(answer, 2))
    return Profile(
        autoconnect=values.get("connection.autoconnect") != "no",
        methods={version: values.get("ipv%d.method" % version, "") for version in (4, 6)},
        tables={version: int(values.get("ipv%d.route-table" % version) or 0) for version in (4, 6)},
        lines=[
            line
            for version in (4, 6)
            for line in lines_of(version, values.get("ipv%d.routes" % version, ""), _uuid(place))
        ],
    )


def lines_of(version: int, value: str, uuid: str) -> typing.List[str]:
    """The routes that nmcli prints for a profile, as lines in normal form. Raises Problem for a form that is unknown."""
    try:
        return [_normal(version, route.split()) for route in value.split(",") if route.strip()]
    except (ValueError, IndexError) as problem:
        raise Problem(
            "routes: the profile %s has ipv%d.routes '%s', which is not in the form of nmcli since 1.8 (%s): set backend to "
            "none for its routes." % (uuid, version, value, problem)
        ) from problem


def _normal(version: int, words: typing.List[str]) -> str:
    """A route of nm-settings-nmcli(5): destination [next-hop] [metric] [attribute=value]..."""
    line = [str(ipaddress.ip_network(words[0], strict=False))]
    rest = words[1:]
    if rest and "=" not in rest[0] and ("." in rest[0] or ":" in rest[0]):
        line.append(str(ipaddress.ip_address(rest.pop(0))))
    if rest and "=" not in rest[0]:
        line.append(str(int(rest.pop(0))))
    if not all("=" in word for word in rest):
        raise ValueError("'%s' is no attribute" % " ".join(rest))
    return " ".join(["ipv%d.routes" % version] + line + sorted(rest))


def line_of(route: Route, profile_table: int) -> str:
    """A route of ours as a line. `profile_table` is the profile's route-table: 0 for none, so for the table main."""
    words = [route.destination] + ([route.gateway] if route.gateway else [])
    words.append(str(route.metric))  # without it NetworkManager takes that of the interface, 100 and more
    attributes = [
        ("onlink", "true" if route.on_link else ""),
        ("src", route.source),
        ("table", "" if route.table == (profile_table or MAIN) else str(route.table)),
        ("type", "" if route.type == "unicast" else route.type),
    ]
    words += ["%s=%s" % (name, value) for name, value in attributes if value]
    return "ipv%d.routes %s" % (route.version, " ".join(words))


def _version(line: str) -> int:
    return int(line[len("ipv")])


def _lines(text: str) -> typing.List[str]:
    return text.splitlines()


def _text(lines: typing.Iterable[str]) -> typing.Optional[str]:
    """Lines as the text of a place, None for none."""
    return "".join(line + "\n" for line in sorted(set(lines))) or None
