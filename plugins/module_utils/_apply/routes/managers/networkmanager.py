# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot by NetworkManager: more routes in the profile that is active on the interface (nm-settings-nmcli(5)).

A profile has another owner. So a place is `nmcli:<uuid>`, and not a file. Its text has one line per route of ours, in
the form of `nmcli connection modify`: "ipv4.routes 192.168.11.0/24 192.168.1.201 0".
"""

import ipaddress
import shutil
import typing

from ...._base import commands
from ...._base.plain_text import LINE, quote
from ...._base.problem import Problem
from ..kernel import MAIN, RouteSpec
from . import contract

PREFIX = "nmcli:"
NETPLANS = "/run/NetworkManager/system-connections/netplan-"  # the beginning of the profiles that netplan writes
_LIMIT = 30.0  # seconds; a change takes some hundredths
_NOT_THERE = 10  # exit status of nmcli(1): no such connection, device or access point
_EXTERNAL = "(externally)"  # another program has configured the interface, and NetworkManager only shows it
_WITHOUT = ("disabled", "ignore")  # methods with which a profile's routes are not made


class Active(typing.NamedTuple):
    """The profile that is active on an interface."""

    uuid: str
    external: bool
    file: str  # "" if nmcli is too old to say it (before 1.12)

    @property
    def netplan(self) -> bool:
        """True if netplan has written the profile."""
        return self.file.startswith(NETPLANS)


class Profile(typing.NamedTuple):
    """The settings of a profile for routes."""

    autoconnect: bool
    methods: typing.Dict[int, str]  # by version of IP
    tables: typing.Dict[int, int]  # by version of IP
    lines: typing.List[str]  # its routes


def nmcli(*words: str) -> commands.Answer:
    """Run nmcli with its output for programs."""
    return commands.run(("nmcli", "--terse", "--escape", "no") + words, limit=_LIMIT)


def active_profiles() -> typing.Dict[str, Active]:
    """The active profiles by interface; empty if NetworkManager is missing or does not run."""
    devices = nmcli("--fields", "DEVICE,CON-UUID,STATE", "device")
    if devices.status != 0:
        return {}
    files = dict(_split_fields(nmcli("--fields", "UUID,FILENAME", "connection", "show", "--active"), 2))
    return {
        device: Active(uuid, _EXTERNAL in state, files.get(uuid, ""))
        for device, uuid, state in _split_fields(devices, 3)
        if uuid and state.startswith("connected")
    }


def _split_fields(answer: commands.Answer, number: int) -> typing.List[typing.List[str]]:
    lines = answer.text.splitlines() if answer.status == 0 else []
    return [line.split(":", number - 1) for line in lines if line.count(":") >= number - 1]


class BackEnd(contract.BackEnd):
    """NetworkManager."""

    name = "networkmanager"
    inexpressible = ("advmss",)  # before 1.46

    def __init__(self, machine: contract.MachineContext, recorded: contract.RecordedTexts) -> None:
        super().__init__(machine, recorded)
        self._active = active_profiles() if machine.booted else {}
        self._ours = {place: set("".join(texts).splitlines()) for place, texts in recorded.items()}

    # The profile of an interface

    def list_interfaces(self) -> typing.Set[str]:
        """The interfaces on which NetworkManager has activated a profile, other than netplan's."""
        return {name for name, active in self._active.items() if not active.external and not active.netplan}

    def find_place(self, interface: str) -> str:
        active = self._active.get(interface)
        where = f"routes: {interface} shall have its routes by NetworkManager, and"
        if active is None:
            raise Problem(
                f"{where} no profile is active there, expected one: activate a profile (nmcli device), or choose another backend."
            )
        if active.external:
            raise Problem(
                f"{where} it is 'connected (externally)': another program or a person has configured it and NetworkManager looks on, expected "
                "an active profile in /etc/NetworkManager/system-connections: add one (nmcli connection add), or choose the "
                "backend that configures it."
            )
        if active.netplan:
            raise Problem(
                f"{where} its profile {quote(active.file)} is written by netplan: choose the backend netplan."
            )
        if active.file.startswith("/run/"):
            raise Problem(
                f"{where} its profile {quote(active.file)} is only in memory and gone after a reboot, expected one in "
                f"/etc/NetworkManager/system-connections: save it (nmcli connection modify {active.uuid} "
                "connection.autoconnect yes)."
            )
        sharers = [name for name, other in self._active.items() if other.uuid == active.uuid]
        what = f"{where} its profile {active.uuid}"
        self.refuse_shared(interface, sharers, what, "is active on {} too", "a profile")
        return PREFIX + active.uuid

    # Our routes in a profile

    def read(self) -> contract.Places:
        texts = {}
        for place in sorted(self.recorded) if self.machine.booted else []:
            profile = _read_profile(place)
            text = _join_lines(line for line in profile.lines if line in self._ours[place]) if profile else None
            if text is not None:
                texts[place] = text
        return texts

    def render(self, place: str, routes: contract.RoutesByInterface) -> typing.Optional[str]:
        profile = _read_profile(place)
        if profile is None:
            raise Problem(f"routes: the profile {place} of {', '.join(routes)} is gone: run again.")
        # Routes that the profile had before are not ours, so they are never removed from it.
        others = set(profile.lines) - self._ours.get(place, set())
        all_routes = [route for interface_routes in routes.values() for route in interface_routes]
        lines = {format_line(route, profile.tables[route.version]) for route in all_routes}
        return _join_lines(lines - others)

    def check(self, wanted: contract.PlannedTexts) -> None:
        """Raises Problem if other settings of a profile prevent its routes at boot. (nmcli checks the routes in `write`.)"""
        for place, text in wanted.items():
            profile = _read_profile(place)
            if text is None or profile is None:
                continue
            if not profile.autoconnect:
                raise Problem(
                    f"routes: the profile {_uuid(place)} has connection.autoconnect no, so it brings no routes back at boot, "
                    f"expected yes: nmcli connection modify {_uuid(place)} connection.autoconnect yes."
                )
            for version in sorted({int(line[len("ipv")]) for line in text.splitlines()}):
                if profile.methods[version] in _WITHOUT:
                    raise Problem(
                        f"routes: the profile {_uuid(place)} has ipv{version}.method {profile.methods[version]}, with which it "
                        f"makes no route of IPv{version}, expected one of manual, auto: configure IPv{version} in it, or set "
                        "backend to none for these routes."
                    )

    # The change of a profile

    def write(self, place: str, content: typing.Optional[str]) -> None:
        """Add the missing lines to the profile and remove our other ones, in one step of NetworkManager: all or nothing."""
        profile, wanted = _read_profile(place), (content or "").splitlines()
        if profile is None:
            if content is None:
                return
            raise Problem(f"routes: the profile {_uuid(place)} is gone, expected it there: run again.")
        ours = self._ours.setdefault(place, set())
        words = _modify_words("-", [line for line in profile.lines if line in ours and line not in wanted])
        words += _modify_words("+", [line for line in wanted if line not in profile.lines])
        ours.update(wanted)
        if words:
            answer = nmcli("connection", "modify", "uuid", _uuid(place), *words)
            if answer.status != 0:
                raise Problem(
                    f"routes: NetworkManager refuses the change of the profile {_uuid(place)} ({quote(_read_error(answer), LINE)})."
                )

    def activate(self, places: typing.List[str]) -> None:
        """Do nothing: the kernel has the routes, and NetworkManager reads the profile when it next activates it.

        Seen with NetworkManager 1.42 and `ip monitor`, in a container: `nmcli device reapply` deletes the addresses of IPv6, and routes
        and foreign addresses. With its flag that keeps those, the addresses of IPv6 are lost for good. Without `reapply`,
        the routes stay over a short loss of carrier; after a longer one, as at boot, the profile is read again.
        """


# Profiles and lines


def _uuid(place: str) -> str:
    return place[len(PREFIX) :]


def _modify_words(sign: str, lines: typing.Iterable[str]) -> typing.List[str]:
    """The words of `nmcli connection modify` that add (+) or remove (-) lines."""
    words = []
    for line in lines:
        setting, _space, route = line.partition(" ")
        words += [sign + setting, route]
    return words


def _read_error(answer: commands.Answer) -> str:
    return " ".join(answer.error.split()).replace("Error: ", "").rstrip(".") or "without a word"


def _read_profile(place: str) -> typing.Optional[Profile]:
    """A profile, None if it or NetworkManager is gone. Raises Problem if it cannot be read."""
    names = ["connection.autoconnect"]
    names += [f"ipv{version}.{name}" for version in (4, 6) for name in ("method", "route-table", "routes")]
    answer = nmcli("--fields", ",".join(names), "connection", "show", "uuid", _uuid(place))
    if answer.status == _NOT_THERE or not shutil.which("nmcli", path=commands.BASE_PATH):
        return None
    if answer.status != 0:
        raise Problem(
            f"routes: the profile {_uuid(place)} of NetworkManager cannot be read ({quote(_read_error(answer), LINE)}), expected NetworkManager "
            "running: start it."
        )
    values = dict(_split_fields(answer, 2))
    return Profile(
        autoconnect=values.get("connection.autoconnect") != "no",
        methods={version: values.get(f"ipv{version}.method", "") for version in (4, 6)},
        tables={version: int(values.get(f"ipv{version}.route-table") or 0) for version in (4, 6)},
        lines=[
            line
            for version in (4, 6)
            for line in parse_lines(version, values.get(f"ipv{version}.routes", ""), _uuid(place))
        ],
    )


def parse_lines(version: int, value: str, uuid: str) -> typing.List[str]:
    """The routes that nmcli prints for a profile, as lines in normal form. Raises Problem for a form that is unknown."""
    try:
        return [_normalize(version, route.split()) for route in value.split(",") if route.strip()]
    except (ValueError, IndexError) as problem:
        raise Problem(
            f"routes: the profile {uuid} has ipv{version}.routes {quote(value)}, which is not in the form of nmcli since 1.8 "
            f"({problem}): set backend to none for its routes."
        ) from problem


def _normalize(version: int, words: typing.List[str]) -> str:
    """A route of nm-settings-nmcli(5): destination [next-hop] [metric] [attribute=value]..."""
    line = [str(ipaddress.ip_network(words[0], strict=False))]
    rest = words[1:]
    if rest and "=" not in rest[0] and ("." in rest[0] or ":" in rest[0]):
        line.append(str(ipaddress.ip_address(rest.pop(0))))
    if rest and "=" not in rest[0]:
        line.append(str(int(rest.pop(0))))
    if not all("=" in word for word in rest):
        raise ValueError(f"'{' '.join(rest)}' is no attribute")
    return " ".join([f"ipv{version}.routes", *line, *sorted(rest)])


_SCOPES = {"global": 0, "link": 253, "host": 254}  # rtnetlink(7)


def format_line(route: RouteSpec, profile_table: int) -> str:
    """A route of ours as a line. `profile_table` is the profile's route-table: 0 if it is not set, so that the table is main."""
    words = [route.destination] + ([route.gateway] if route.gateway else [])
    words.append(str(route.metric))  # without it NetworkManager takes that of the interface, 100 and more
    attributes = [
        ("initcwnd", str(route.initcwnd or "")),
        ("mtu", str(route.mtu or "")),
        ("onlink", "true" if route.on_link else ""),
        ("scope", str(_SCOPES[route.scope]) if route.scope else ""),
        ("src", route.source),
        ("table", "" if route.table == (profile_table or MAIN) else str(route.table)),
        ("type", "" if route.type == "unicast" else route.type),
    ]
    words += [f"{name}={value}" for name, value in attributes if value]
    return f"ipv{route.version}.routes {' '.join(words)}"


def _join_lines(lines: typing.Iterable[str]) -> typing.Optional[str]:
    """Lines as the text of a place, None if there are no lines."""
    return "".join(f"{line}\n" for line in sorted(set(lines))) or None
