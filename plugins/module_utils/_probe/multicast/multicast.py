# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The work of multicast_verify: its options, and its actions. multimaster_verify measures with it, too."""

import errno
import ipaddress
import typing

from ..._base import actions
from ..._base.background import Visit, end_others, explain_refusal, find_wrong_value, leave, path_of
from ..._base.commands import text
from ..._base.plain_text import quote
from ..._base.problem import Problem
from ..._machine import network
from .helper import HelperSettings
from .helper_process import icmp_rounds, open_sockets, plain, serve
from .memberships import drop_own, igmp6_memberships, igmp_memberships
from .multicast_report import explain, icmp_round

KIND = "multicast"  # of the doors of helpers
MOST_ICMP_ROUNDS = 5
LONGEST_MEASUREMENT = 120  # seconds
# ip(7), IP_ADD_MEMBERSHIP
_REMEDIES = {errno.ENOBUFS: "this kernel joins no more groups, so raise net.ipv4.igmp_max_memberships"}
IGNORE_BROADCASTS = "/proc/sys/net/ipv4/icmp_echo_ignore_broadcasts"

Params = typing.Dict[str, typing.Any]
Result = typing.Dict[str, typing.Any]


def wrong(params: Params) -> typing.Optional[str]:
    """Name in one sentence the option that cannot be used; None if all can."""
    bounds = (("port", 1, 65535), ("rounds", 1, 1000), ("interval", 0.02, 10), ("lifetime", 1, 3600))
    wrong_value = find_wrong_value(params, bounds)
    if wrong_value:
        return wrong_value
    for option in ("group", "icmp_group"):
        group = params[option]
        if not (network.is_address(group) and ipaddress.IPv4Address(group).is_multicast):
            return f"{option} is {group!r}, expected an IPv4 multicast group (224.0.0.0 to 239.255.255.255)."
    if params["rounds"] * params["interval"] > LONGEST_MEASUREMENT:
        return (
            f"rounds ({params['rounds']}) times interval ({params['interval']} s) is more than "
            f"{LONGEST_MEASUREMENT} s; lower one of them."
        )
    if params["interface_address"] is not None and not network.is_address(params["interface_address"]):
        return f"interface_address is {params['interface_address']!r}, expected an IPv4 address."
    return wrong_computers(params)


def wrong_computers(params: Params) -> typing.Optional[str]:
    """Name in one sentence which of computers, name and interface_address do not fit together; None if all do."""
    names: typing.Dict[str, str] = {}
    addresses: typing.Dict[str, str] = {}
    for computer in params["computers"] or []:
        name, address = computer["name"], computer["address"]
        if not network.is_address(address):
            return f"computers: the address of {name} is {address!r}, expected an IPv4 address."
        if name in names:
            return f"computers: the name {name} is given twice; every computer needs a name of its own."
        if address in addresses:
            return (
                f"computers: {addresses[address]} and {name} both have the address {address}; "
                "every computer needs an address of its own."
            )
        names[name], addresses[address] = address, name
    if actions.read_action(params) == "list":
        return None
    if params["name"] not in names:
        return (
            f"name is {params['name']!r}, which is not among computers ({', '.join(names)}); "
            "add this computer to the list."
        )
    if names[params["name"]] != params["interface_address"]:
        return (
            f"interface_address is {params['interface_address']}, but computers gives {params['name']} the address "
            f"{names[params['name']]}; the two must be the same."
        )
    return None


def look(params: Params) -> typing.Tuple[Result, typing.Tuple[str, ...], int]:
    """Read memberships and route of this computer; also its addresses, and the number of the interface asked for. Raises Problem."""
    try:
        interfaces = network.interfaces()
    except OSError as problem:
        raise Problem(f"{problem}.") from problem
    addresses = {
        entry.address: interface for interface in interfaces for entry in interface.addresses if entry.family == "inet"
    }
    address = params["interface_address"]
    if address is not None and address not in addresses:
        raise Problem(
            f"No interface of this computer has the address {address} (interface_address); it has "
            f"{', '.join(sorted(addresses)) or 'none'}. Give it the address, or correct the inventory."
        )
    interface = addresses.get(address)
    route = network.route_to(params["group"])
    seen = {
        "memberships": igmp_memberships(text("/proc/net/igmp")) + igmp6_memberships(text("/proc/net/igmp6")),
        "route": {"device": route.device, "source": route.source},
        "interface": interface.name if interface else None,
    }
    return seen, tuple(addresses), interface.index if interface else 0


def describe(seen: Result, group: str) -> str:
    """Return the message of the action `list`."""
    members = sorted({item["interface"] for item in seen["memberships"] if item["group"] == group})
    return f"{group} has members on {', '.join(map(quote, members)) or 'no interface'}."


def start(settings: HelperSettings, index: int) -> Result:
    """Leave a helper behind; sockets that cannot be opened are a Problem before there is one."""
    path = path_of(KIND, settings.run)
    where = f"{settings.group}:{settings.port} on {settings.interface} ({settings.address})"
    with explain_refusal(f"Cannot listen for {where}", _REMEDIES):
        end_others(KIND)
        sockets = open_sockets(settings, index, path)
    leave(lambda: serve(sockets, settings, path), sockets, "multicast_verify's helper")
    return {"msg": f"Listening for {where}, for {settings.lifetime} s at most."}


def collect(params: Params, settings: HelperSettings, index: int) -> Result:
    """Let the helper measure, do the ICMP rounds meanwhile, and return both. Raises Problem."""
    request = {"do": "measure", "settings": plain(settings)}
    request.update((option, params[option]) for option in ("rounds", "interval", "unicast"))
    ended = (
        "No helper of this run is listening on this computer: its task with action=start did not run, "
        f"or its lifetime ({params['lifetime']} s) was over; run that task before this one, or raise lifetime."
    )
    try:
        visit = Visit(path_of(KIND, settings.run), request)
    except OSError as error:
        raise Problem(f"{ended} ({error.strerror or error})") from error
    icmp = ping(settings, index, params) if params["icmp"] else None
    reply = visit.reply(params["rounds"] * params["interval"] + 15) or {}
    if not reply:
        raise Problem(ended)
    if "settings" in reply:
        raise Problem(
            f"The helper of this run was started with other options ({reply['settings']}) than this "
            f"task has ({plain(settings)}); give both tasks the same."
        )
    if not params["unicast"]:
        reply["udp"] = [dict(entry, unicast=None) for entry in reply["udp"]]
    ok = not reply["missing"] and not reply["unanswered"]
    return dict(reply, icmp=icmp, multicast_ok=ok, msg=explain(reply, settings.port))


def ping(settings: HelperSettings, index: int, params: Params) -> Result:
    """Ping the group; that is an addition, so its error is returned with the rest."""
    answered: typing.List[typing.Set[str]] = []
    error = None
    try:
        answered = icmp_rounds(settings.address, index, params["icmp_group"], min(params["rounds"], MOST_ICMP_ROUNDS))
    except OSError as refused:
        error = f"Cannot send ICMP echo requests to {params['icmp_group']}: {refused.strerror or refused}."
    return {
        "group": params["icmp_group"],
        "echo_ignore_broadcasts": int(text(IGNORE_BROADCASTS) or 1),
        "error": error,
        "rounds": [
            icmp_round(number, sources, settings.computers, settings.address)
            for number, sources in enumerate(answered, 1)
        ],
    }


def settings_of(params: Params, interface: str, addresses: typing.Tuple[str, ...]) -> HelperSettings:
    """Make the settings of a helper out of the options."""
    return HelperSettings(
        run=params["run"],
        group=params["group"],
        port=params["port"],
        interface=interface,
        address=params["interface_address"],
        own=addresses,
        computers={computer["address"]: computer["name"] for computer in params["computers"]},
        lifetime=params["lifetime"],
        apart=frozenset(computer["address"] for computer in params["computers"] if not computer["multicast"]),
    )


def run_action(params: Params, check_mode: bool) -> Result:
    """Carry out the action, and return the result; with `check_mode` nothing is sent. Raises Problem."""
    error = wrong(params)
    if error:
        raise Problem(error)
    seen, addresses, index = look(params)
    result = dict(seen, msg=describe(seen, params["group"]))
    action = actions.read_action(params)
    if action != "list" and check_mode:
        result["msg"] += " Check mode: nothing was sent, and no helper was started or asked."
    elif action == "start":
        result.update(start(settings_of(params, seen["interface"], addresses), index))
    elif action == "collect":
        result["memberships"] = drop_own(seen["memberships"], seen["interface"], params["group"])
        result.update(collect(params, settings_of(params, seen["interface"], addresses), index))
    return result


NEEDED = ["interface_address", "name", "computers"]
COMPUTER = {
    "name": {"type": "str", "required": True},
    "address": {"type": "str", "required": True},
    "multicast": {"type": "bool", "default": True},
}
OPTIONS = {
    "action": {
        "type": "str",
        "choices": actions.list_words("list", "start", "collect"),
        "aliases": ["state"],
        "default": "list",
    },
    "run": {"type": "str", "default": "default"},
    "group": {"type": "str", "default": "226.0.0.0"},
    "port": {"type": "int", "default": 11511},
    "interface_address": {"type": "str"},
    "name": {"type": "str"},
    "computers": {"type": "list", "elements": "dict", "options": COMPUTER},
    "rounds": {"type": "int", "default": 10},
    "interval": {"type": "float", "default": 0.2},
    "unicast": {"type": "bool", "default": True},
    "icmp": {"type": "bool", "default": True},
    "icmp_group": {"type": "str", "default": "224.0.0.1"},
    "lifetime": {"type": "int", "default": 120},
    "fail_on_missing": {"type": "bool", "default": False},
}
REQUIRED_IF = tuple(("action", word, NEEDED) for word in actions.list_words("start", "collect"))
