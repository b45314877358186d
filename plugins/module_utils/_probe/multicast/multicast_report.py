# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Sentences about the result of multicast_verify, and one ICMP round as the module returns it."""

import typing

from ..._base.plain_text import quote


def icmp_round(
    number: int, answered: typing.Set[str], computers: typing.Dict[str, str], own: str
) -> typing.Dict[str, typing.Any]:
    """Return one ICMP round as the module does; `answered` are source addresses, `computers` are {address: name}."""
    others = {address: name for address, name in computers.items() if address != own}
    return {
        "round": number,
        "answered": [name for address, name in others.items() if address in answered],
        "missing": [name for address, name in others.items() if address not in answered],
        "unexpected": sorted(set(answered) - set(computers)),
    }


# A sentence for each case; {names} and {port} are filled in, and a case without names is left out.
CAUSES = (
    ("silent", "Not heard on the group: {names}."),
    ("deaf", "Do not hear this computer on the group: {names}."),
    ("elsewhere", "Heard on another interface than the planned one: {names}; check the addresses and the cabling."),
    (
        "reachable",
        (
            "Unicast datagrams reach {names}, so something drops only the group: IGMP snooping without a querier, "
            "an access point's multicast filter, or a firewall rule for the group."
        ),
    ),
    (
        "unreachable",
        (
            "No answer came from {names}: the computer is down, no helper was started there, its address or interface "
            "is not the planned one, or a firewall closes UDP port {port}."
        ),
    ),
    (
        "unanswered",
        "Heard, but whether they hear this computer is open, as no count came back: {names}; their own result shows it.",
    ),
)


def explain(result: typing.Dict[str, typing.Any], port: int) -> str:
    """Name the missing computers and the usual causes in one message."""
    udp = result["udp"]
    if not result["missing"] and not result["unanswered"]:
        by_unicast = sum(1 for entry in udp if not entry["multicast"])
        more = f", {by_unicast} of them by unicast, since the group does not pass between them" if by_unicast else ""
        return f"Every other computer ({len(udp)}) is heard on the group and hears this one{more}."
    cases = _cases(result)
    return " ".join(text.format(names=", ".join(cases[case]), port=port) for case, text in CAUSES if cases[case])


def _find_unheard(udp: typing.List[typing.Dict[str, typing.Any]]) -> typing.Tuple[typing.List, typing.List]:
    """Find the computers that were not heard on the group, and those without the group that did not answer."""
    silent = [entry for entry in udp if entry["multicast"] and not entry["heard_from"]]
    return silent, [entry for entry in udp if not entry["multicast"] and not entry["unicast"]]


def _cases(result: typing.Dict[str, typing.Any]) -> typing.Dict[str, typing.List[str]]:
    """List the computers of each case of CAUSES."""
    udp, missing = result["udp"], result["missing"]
    silent, apart = _find_unheard(udp)
    elsewhere = [(entry["name"], entry["other_interfaces"]) for entry in silent if entry["other_interfaces"]]
    cases = {
        "silent": silent,
        "deaf": [entry for entry in udp if entry["heard_by"] is False],
        "reachable": [entry for entry in udp if entry["name"] in missing and entry["unicast"]],
        "unreachable": [entry for entry in silent + apart if entry["heard_by"] is None],
    }
    names = {case: [entry["name"] for entry in entries] for case, entries in cases.items()}
    names["elsewhere"] = [f"{name} ({', '.join(map(quote, interfaces))})" for name, interfaces in elsewhere]
    return dict(names, unanswered=result["unanswered"])
