# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""From the options to routes, and from the kernel's routes to those: the pure part of the module routes."""

import ipaddress
import shlex
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import Interface
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import (
    DEFAULTS,
    MAIN,
    METRICS,
    NO_WAY,
    Held,
    Key,
    Route,
    command,
    text_of,
    words_of,
)

_LARGEST = 2**32 - 1
_LOCAL = 255  # the table local, which is the kernel's own

Interfaces = typing.Mapping[str, Interface]
Current = typing.Dict[Key, typing.List[Held]]


class Item(typing.NamedTuple):
    """A route of the list, with what is said about its boot part."""

    route: Route
    carrier: str  # the interface with which it comes back at boot; "" where any will do
    backend: str


class Entry(typing.NamedTuple):
    """What the record holds for a key: the routes that we made (two after a killed run), and whose place they took."""

    made: typing.Tuple[Route, ...]
    replaced: typing.Tuple[typing.Tuple[str, ...], ...]


class Change(typing.NamedTuple):
    """One change of the kernel's routes; `may_fail` where it may be so already."""

    verb: str
    version: int
    words: typing.Tuple[str, ...]
    may_fail: bool = False


class Plan(typing.NamedTuple):
    """What a run does to the kernel's routes. `after` holds the texts of the keys that it touches."""

    changes: typing.List[Change]
    undo: typing.List[Change]
    interim: typing.Dict[Key, Entry]
    final: typing.Dict[Key, Entry]
    after: typing.Dict[Key, typing.List[str]]
    results: typing.List[typing.Dict[str, typing.Any]]
    taken_back: typing.List[typing.Dict[str, typing.Any]]


# What is wanted


def name_of(destination: str) -> str:
    """A destination as a person writes it."""
    return "default" if destination == DEFAULTS[4] else destination


def items_of(wanted: typing.Iterable[typing.Mapping[str, typing.Any]], interfaces: Interfaces) -> typing.List[Item]:
    """The routes of the option, with the interface of each. Raises Problem with the item that cannot be meant."""
    items, keys = [], {}
    for number, given in enumerate(wanted, 1):
        item = _item(given, "routes: item %d (%s)" % (number, given["destination"]), interfaces)
        earlier = keys.setdefault(item.route.key, item)
        if earlier is item:
            items.append(item)
        elif earlier != item:
            raise Problem(
                "routes: found two routes to %s with metric %d in table %d, expected one: remove one of them, or give it "
                "another metric." % (name_of(item.route.destination), item.route.metric, item.route.table)
            )
    return items


def _item(given: typing.Mapping[str, typing.Any], where: str, interfaces: Interfaces) -> Item:
    destination = _destination(given["destination"], where)
    version, kind = (6 if ":" in destination else 4), given["type"]
    gateway = _address(given["gateway"], version, where, "gateway")
    source = _address(given["source"], version, where, "source")
    device = given["device"] or ""
    if kind in NO_WAY:
        if gateway or source or given["on_link"]:
            raise Problem("%s: found the type %s with a way, expected no gateway, source or on_link." % (where, kind))
    elif not gateway and not device:
        raise Problem("%s: found neither gateway nor device, expected one of them: add it." % where)
    if device and device not in interfaces:
        raise Problem(
            "%s: there is no interface %s, expected one of %s: correct device." % (where, device, _names(interfaces))
        )
    if given["on_link"] and not (gateway and device):
        raise Problem("%s: on_link needs gateway and device: add them, or remove on_link." % where)
    if kind not in NO_WAY and not device:
        device = _device_towards(gateway, where, interfaces)
    metric = given["metric"]
    for option, value, least in (("metric", metric or 0, 0), ("table", given["table"], 1)):
        if not least <= value <= _LARGEST or (option == "table" and value == _LOCAL):
            raise Problem(
                "%s: found the %s %d, expected a number from %d to %d%s."
                % (where, option, value, least, _LARGEST, " other than 255" if option == "table" else "")
            )
    route = Route(
        destination=destination,
        gateway=gateway,
        device="" if kind in NO_WAY else device,
        metric=metric or METRICS[version],
        table=given["table"],
        source=source,
        on_link=given["on_link"],
        type=kind,
    )
    return Item(route, device, given["backend"])


def _destination(value: str, where: str) -> str:
    if value == "default":
        return DEFAULTS[4]
    try:
        return str(ipaddress.ip_network(value))
    except ValueError as problem:
        raise Problem(
            "%s: found a destination that is no network (%s), expected one such as 192.168.11.0/24, fd00:11::/64, "
            "default or ::/0." % (where, problem)
        ) from problem


def _address(value: typing.Optional[str], version: int, where: str, option: str) -> str:
    if not value:
        return ""
    try:
        address = ipaddress.ip_address(value)
    except ValueError as problem:
        raise Problem("%s: the %s %s is no address: correct it." % (where, option, value)) from problem
    if address.version != version:
        raise Problem(
            "%s: the %s %s is an IPv%d address, expected IPv%d as the destination (the default of IPv6 is ::/0)."
            % (where, option, value, address.version, version)
        )
    return str(address)


def _names(interfaces: typing.Iterable[str]) -> str:
    return ", ".join(sorted(interfaces)) or "none"


def _device_towards(gateway: str, where: str, interfaces: Interfaces) -> str:
    """The interface whose connected network holds the gateway: the smallest such network decides."""
    address = ipaddress.ip_address(gateway)
    if address.is_link_local:
        raise Problem(
            "%s: the gateway %s is link-local, so every interface could be meant: add device." % (where, gateway)
        )
    found: typing.Dict[int, typing.Set[str]] = {}
    for name, link in interfaces.items():
        for own in link.networks:
            if not link.loopback and address in own.network:
                found.setdefault(own.network.prefixlen, set()).add(name)
    if not found:
        raise Problem(
            "%s: no interface has a network with the gateway %s (found %s), expected one: correct the gateway, or bring the "
            "interface up with an address there." % (where, gateway, _addresses(interfaces))
        )
    nearest = found[max(found)]
    if len(nearest) > 1:
        raise Problem("%s: the gateway %s is behind %s: say which in device." % (where, gateway, _names(nearest)))
    return nearest.pop()


def _addresses(interfaces: Interfaces) -> str:
    found = [
        "%s %s" % (name, own)
        for name, link in sorted(interfaces.items())
        for own in link.networks
        if not link.loopback and not own.is_link_local
    ]
    return ", ".join(found) or "no address"


def check_usable(items: typing.List[Item], interfaces: Interfaces, current: Current) -> None:
    """Raises Problem for a route that the kernel would refuse as the interfaces are now."""
    own = {str(address.ip) for link in interfaces.values() for address in link.networks}
    routes = [item.route for item in items] + [held.route for there in current.values() for held in there]
    for route in (item.route for item in items):
        where = "routes: %s" % text_of(route)
        if route.device and not interfaces[route.device].up:
            raise Problem("%s: the interface %s is down, expected it up: bring it up first." % (where, route.device))
        if route.source and route.source not in own:
            raise Problem(
                "%s: the source %s is no address of this computer (found %s): correct it."
                % (where, route.source, _addresses(interfaces))
            )
        if not route.gateway or route.on_link:
            continue
        if route.gateway in own:
            raise Problem(
                "%s: the gateway is an address of this computer itself, expected the address of another one: correct it."
                % where
            )
        gateway = ipaddress.ip_address(route.gateway)
        near = [address.network for address in interfaces[route.device].networks]
        near += [
            ipaddress.ip_network(other.destination)
            for other in routes
            if other.device == route.device and not other.gateway and other.destination not in DEFAULTS.values()
        ]
        if not gateway.is_link_local and not any(gateway in network for network in near):
            raise Problem(
                "%s: the gateway is not in a network of %s (found %s): correct gateway or device, or set on_link where it "
                "is on that link all the same."
                % (where, route.device, _addresses({route.device: interfaces[route.device]}))
            )


# The plan


def plan(
    routes: typing.List[Route],
    current: Current,
    entries: typing.Dict[Key, Entry],
    replace: bool,
    interfaces: typing.Iterable[str],
) -> Plan:
    """What leads from the kernel's routes and the record to these routes.

    `current` has every key of routes and entries that the kernel holds. No key is without a route on the way: `replace` of
    ip-route(8) is one step of the kernel, and what goes, goes after everything that comes.
    """
    adds: typing.List[Change] = []
    returns: typing.List[Change] = []
    removals: typing.List[Change] = []
    interim, final, after = dict(entries), {}, {}
    results, taken_back = [], []

    for route in sorted(
        routes, key=lambda route: bool(route.gateway)
    ):  # a link's own networks, then what is behind them
        there, entry = current.get(route.key, []), entries.get(route.key, Entry((), ()))
        made = {other.way for other in entry.made}
        same = [held for held in there if held.route.way == route.way]
        others = [held for held in there if held not in same]
        foreign = [held for held in others if held.route.way not in made]
        adopted = bool(same) and route.way not in made and not others

        state, problem = _judge(route, there, foreign, replace)
        if not same:
            adds.append(_make(route))  # which takes the place of the first of several
        adds += [remove(held) for held in (others if same else others[1:])]
        if state == "ok" and (others or not same):
            state = "changed"
        if not adopted:
            took = [held.words for held in there if held.route.way not in made]
            # Where none of ours was there any more, what came since has taken the earlier ones' place.
            earlier_ones = entry.replaced if not took or any(held.route.way in made for held in there) else ()
            replaced = earlier_ones + tuple(words for words in took if words not in earlier_ones)
            earlier = tuple(other for other in entry.made if other != route)
            final[route.key] = Entry((route,), replaced)
            interim[route.key] = Entry(earlier + (route,), replaced)
        before = (same or there or [None])[0]
        text = same[0].text if same else text_of(route)
        after[route.key] = [text]
        results.append(
            {
                "route": route,
                "before": before.text if before else None,
                "after": text,
                "state": state,
                "problem": problem,
            }
        )
    order = {route: number for number, route in enumerate(routes)}
    results.sort(key=lambda result: order[result["route"]])

    wanted = {route.key for route in routes}
    for key, entry in sorted(entries.items()):
        if key in wanted:
            continue
        there, made = current.get(key, []), {route.way for route in entry.made}
        ours = [held for held in there if held.route.way in made]
        others = [held for held in there if held not in ours]
        known = [words for words in entry.replaced if _device(words) in interfaces or _device(words) is None]
        back = known if ours and not others else []
        returns += [_put(key, words, words is back[0])._replace(may_fail=True) for words in back]
        removals += [remove(held) for held in ours]  # which the first of those that return has replaced, if it could
        texts = [" ".join(words) for words in back] + [held.text for held in others]
        after[key] = texts
        route = ours[0].route if ours else entry.made[-1]
        taken_back.append(
            {
                "destination": name_of(route.destination),
                "gateway": route.gateway or None,
                "device": route.device or None,
                "metric": route.metric,
                "table": route.table,
                "type": route.type,
                "before": there[0].text if there else None,
                "after": texts[0] if texts else None,
                "state": "restored" if back else "removed" if ours else "left" if others else "gone",
            }
        )
    changes = adds + _links_first(returns) + removals
    return Plan(changes, _undo(changes, routes, current, after), interim, final, after, results, taken_back)


def _make(route: Route) -> Change:
    return Change("replace", route.version, tuple(words_of(route)))


def _put(key: Key, words: typing.Tuple[str, ...], first: bool) -> Change:
    """One of several routes of a key: the first takes the place of what is there, the others join it."""
    return Change("replace" if first else "append", key[0], words, may_fail=not first)


def remove(held: Held) -> Change:
    """What removes a route and no other of its key: with IPv6 the type does not tell them apart, but the device does."""
    lo = ("dev", "lo") if held.route.version == 6 and held.route.type in NO_WAY else ()
    return Change("del", held.route.version, held.words + lo, may_fail=True)


def _device(words: typing.Sequence[str]) -> typing.Optional[str]:
    return words[words.index("dev") + 1] if "dev" in words else None


def _judge(
    route: Route, there: typing.List[Held], foreign: typing.List[Held], replace: bool
) -> typing.Tuple[str, typing.Optional[str]]:
    """Whether others' routes of this key stand against it."""
    name = text_of(route)
    connected = [held for held in there if held.protocol == "kernel"]
    if connected:
        return "refused", (
            "routes: %s: the kernel itself makes '%s' for an address of the interface, so it is never replaced: remove it "
            "from routes, or give it another metric." % (name, connected[0].text)
        )
    if foreign and not replace:
        return "conflict", (
            "routes: %s: somebody else has made '%s', expected no other way with this metric: correct it there, give this one "
            "another metric, or set on_conflict to replace." % (name, foreign[0].text)
        )
    strange = sorted({word for held in foreign for word in held.strange})
    if strange:
        return "refused", (
            "routes: %s: somebody else's '%s' has %s, which cannot be given back later, so it is not replaced: remove it by "
            "hand, or give this one another metric." % (name, foreign[0].text, ", ".join(strange))
        )
    return "ok", None


def _undo(
    changes: typing.List[Change],
    routes: typing.List[Route],
    current: Current,
    after: typing.Dict[Key, typing.List[str]],
) -> typing.List[Change]:
    """What brings the keys that the changes touch back to what they hold now: first what comes, then what goes."""
    if not changes:
        return []
    comes, goes = [], []
    for key, texts in after.items():
        there = current.get(key, [])
        if [held.text for held in there] == texts:
            continue
        for held in there:
            comes.append(_put(key, held.words, held is there[0]))
        if not there:
            goes += [
                Change("del", key[0], tuple(words_of(route)), may_fail=True) for route in routes if route.key == key
            ]
    return _links_first(comes) + goes


def _links_first(changes: typing.List[Change]) -> typing.List[Change]:
    """Networks on a link before what is behind them; within a key the order stays."""
    behind: typing.Dict[typing.Tuple[int, str], bool] = {}
    for change in changes:
        place = _place(change)
        behind[place] = behind.get(place, False) or bool({"via", "nexthop"} & set(change.words))
    return sorted(changes, key=lambda change: behind[_place(change)])


def _place(change: Change) -> typing.Tuple[int, str]:
    words = [word for word in change.words if word not in NO_WAY]
    numbers = [words[words.index(name) + 1] if name in words else "" for name in ("metric", "table")]
    return (change.version, " ".join([words[0]] + numbers))


def undo_command(change: Change) -> typing.List[str]:
    """A change of `Plan.undo` as a command that fails only where the state is not as it was."""
    argv = command(change.verb, change.version, change.words)
    if change.verb != "del":
        return ["sh", "-c", _quoted(argv) + " || :"] if change.may_fail else argv
    words = list(change.words)
    filters = [
        word for name in ("via", "dev") if name in words for word in words[words.index(name) : words.index(name) + 2]
    ]
    table = words[words.index("table") + 1] if "table" in words else str(MAIN)
    destination = next(word for word in words if word not in NO_WAY)
    exact = DEFAULTS[change.version] if destination == "default" else destination
    show = ["ip", "-%d" % change.version, "route", "show", "table", table, "exact", exact] + filters
    return ["sh", "-c", '%s 2>/dev/null || test -z "$(%s 2>/dev/null)"' % (_quoted(argv), _quoted(show))]


def _quoted(argv: typing.Iterable[str]) -> str:
    return " ".join(shlex.quote(word) for word in argv)


def other_defaults(routes: typing.Iterable[Route], current: typing.Iterable[Held]) -> typing.List[Held]:
    """Default routes of others beside those that are wanted, in the same table. (`current`: as it will be.)"""
    wanted = [route for route in routes if route.destination in DEFAULTS.values() and route.type == "unicast"]
    places = {(route.destination, route.table) for route in wanted}
    keys = {route.key for route in wanted}
    return [
        held for held in current if (held.route.destination, held.route.table) in places and held.route.key not in keys
    ]
