# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The plan for the kernel's routes: the changes from the present routes to the wanted ones, and their undo. Pure.

Each listed route is planned by itself, and so is each route that is taken back. Each key has a route at every moment: `replace`
of ip-route(8) is one step of the kernel, and removals come after all additions.
"""

import shlex
import typing

from ..._base.plain_text import quote
from .kernel import DEFAULTS, NO_WAY, KernelRoute, Key, RouteSpec, format_route, to_words

Held = typing.List[KernelRoute]  # the kernel's routes of one key
Current = typing.Dict[Key, Held]  # the kernel's routes


class RouteEntry(typing.NamedTuple):
    """The record of one key: the routes that we made, and the words of the routes that they replaced."""

    made: typing.Tuple[RouteSpec, ...]  # two after a killed run
    replaced: typing.Tuple[typing.Tuple[str, ...], ...]


Entries = typing.Dict[Key, RouteEntry]


class RouteChange(typing.NamedTuple):
    """One change of the kernel's routes."""

    verb: str  # replace, append or del
    key: Key
    words: typing.Tuple[str, ...]
    may_fail: bool = False  # the state may be as wanted already

    @property
    def command(self) -> typing.List[str]:
        """The command that makes the change."""
        return ["ip", f"-{self.key[0]}", "route", self.verb, *self.words]


class RouteResult(typing.NamedTuple):
    """The result for one listed route."""

    before: typing.Optional[str]  # as `ip route` writes it
    after: str
    state: str  # ok, changed, conflict or refused
    problem: typing.Optional[str]


class KeyPlan(typing.NamedTuple):
    """The plan for one key."""

    adds: typing.List[RouteChange]
    removals: typing.List[RouteChange]
    after: typing.List[str]  # the routes of the key afterwards
    result: typing.Any  # a RouteResult, or the result for a route that is no longer listed
    entry: typing.Optional[RouteEntry] = None  # the record on the way, our route last; None: no new entry


class RoutesPlan(typing.NamedTuple):
    """The changes of one run, in their order, and the record before and after them."""

    changes: typing.List[RouteChange]
    undo: typing.List[RouteChange]
    interim: Entries
    final: Entries
    after: typing.Dict[Key, typing.List[str]]  # the texts of the keys that the run touches
    results: typing.List[RouteResult]  # in the order of the listed routes
    taken_back: typing.List[typing.Dict[str, typing.Any]]  # as the module returns them


def plan_routes(
    routes: typing.List[RouteSpec], current: Current, entries: Entries, replace: bool, interfaces: typing.Container[str]
) -> RoutesPlan:
    """The plan from the kernel's routes and the record to these routes.

    `current` holds every key of `routes` and `entries` that the kernel has. `replace`: a route of another owner may be
    replaced. `interfaces`: the names of the interfaces that are there.
    """
    # A network on a link comes before the routes whose gateway is in it.
    wanted = {
        route.key: _plan_listed(route, current.get(route.key, []), entries.get(route.key, RouteEntry((), ())), replace)
        for route in sorted(routes, key=lambda route: bool(route.gateway))
    }
    taken_back = {
        key: _plan_removal(key, entry, current.get(key, []), interfaces)
        for key, entry in sorted(entries.items())
        if key not in wanted
    }
    made = {key: part.entry for key, part in wanted.items() if part.entry is not None}
    after = {key: part.after for key, part in [*wanted.items(), *taken_back.items()]}
    replaced = [changes for part in wanted.values() for changes in (part.adds, part.removals)]
    returns = _flat(part.adds for part in taken_back.values())
    changes = _flat(replaced) + _links_first(returns) + _flat(part.removals for part in taken_back.values())
    return RoutesPlan(
        changes=changes,
        undo=_undo(routes, current, after) if changes else [],
        interim={**entries, **made},
        final={key: entry._replace(made=entry.made[-1:]) for key, entry in made.items()},
        after=after,
        results=[wanted[route.key].result for route in routes],
        taken_back=[part.result for part in taken_back.values()],
    )


def _flat(lists: typing.Iterable[typing.List[RouteChange]]) -> typing.List[RouteChange]:
    return [change for changes in lists for change in changes]


# One listed route


def _plan_listed(route: RouteSpec, kernel_routes: Held, entry: RouteEntry, replace: bool) -> KeyPlan:
    """The plan for a listed route. `kernel_routes`: the kernel's routes of its key. `entry`: the record of its key."""
    same, others, foreign = _sort_routes(route, kernel_routes, entry)
    state, problem = _judge(route, kernel_routes, foreign, replace)
    if state == "ok" and (others or not same):
        state = "changed"
    before = (same or kernel_routes)[0].text if kernel_routes else None
    after = same[0].text if same else format_route(route)
    superfluous = others if same else others[1:]  # our route replaces the first of several
    part = KeyPlan(
        adds=[] if same else [RouteChange("replace", route.key, tuple(to_words(route)))],
        removals=[remove(kernel_route) for kernel_route in superfluous],
        after=[after],
        result=RouteResult(before, after, state, problem),
    )
    if same and not others and route.way not in _ways(entry):
        return part  # an adopted route has no record: it is not ours to take back
    earlier = tuple(other for other in entry.made if other != route)
    return part._replace(entry=RouteEntry(earlier + (route,), _list_replaced(entry, kernel_routes)))


def _sort_routes(route: RouteSpec, kernel_routes: Held, entry: RouteEntry) -> typing.Tuple[Held, Held, Held]:
    """The routes that go the wanted way, the other ones, and those of the other ones that are not ours."""
    same = [kernel_route for kernel_route in kernel_routes if _is_match(kernel_route, route, entry)]
    others = [kernel_route for kernel_route in kernel_routes if kernel_route not in same]
    return same, others, [kernel_route for kernel_route in others if kernel_route.route.way not in _ways(entry)]


def _is_match(kernel_route: KernelRoute, route: RouteSpec, entry: RouteEntry) -> bool:
    """True if the kernel's route is the wanted one. A route of another owner may have more attributes than the wanted one."""
    if kernel_route.route.way not in _ways(entry):
        return route.fits(kernel_route.route)
    return kernel_route.route.way == route.way and kernel_route.route.on_link == _on_link(kernel_route, route, entry)


def _on_link(kernel_route: KernelRoute, route: RouteSpec, entry: RouteEntry) -> bool:
    """True if a route of ours shall have on_link: it is wanted, or a manager has added it."""
    made = any(other.on_link for other in entry.made if other.way == kernel_route.route.way)
    return route.on_link or (kernel_route.route.on_link and not made)


def _ways(entry: RouteEntry) -> typing.Set[RouteSpec]:
    """The ways of the routes that we made."""
    return {route.way for route in entry.made}


def _list_replaced(entry: RouteEntry, kernel_routes: Held) -> typing.Tuple[typing.Tuple[str, ...], ...]:
    """The foreign routes that come back when ours is no longer listed."""
    foreign = [kernel_route.words for kernel_route in kernel_routes if kernel_route.route.way not in _ways(entry)]
    ours = len(foreign) < len(kernel_routes)
    # If our routes were all gone, the foreign routes have replaced those of the record.
    earlier = entry.replaced if ours or not foreign else ()
    return earlier + tuple(words for words in foreign if words not in earlier)


def _judge(
    route: RouteSpec, kernel_routes: Held, foreign: Held, replace: bool
) -> typing.Tuple[str, typing.Optional[str]]:
    """The state of a listed route and its sentence. It is conflict or refused if foreign routes have its place."""
    name = format_route(route)
    connected = [kernel_route for kernel_route in kernel_routes if kernel_route.protocol == "kernel"]
    if connected:
        return "refused", (
            f"routes: {name}: the kernel itself makes {quote(connected[0].text)} for an address of the interface, so it is never "
            "replaced: remove it from routes, or give it another metric."
        )
    if foreign and not replace:
        return "conflict", (
            f"routes: {name}: the foreign route {quote(foreign[0].text)} is there, expected no other way with this metric: correct it "
            "there, give this one another metric, or set on_conflict to replace."
        )
    inexpressible = sorted({word for kernel_route in foreign for word in kernel_route.inexpressible})
    if inexpressible:
        return "refused", (
            f"routes: {name}: the foreign route {quote(foreign[0].text)} has {', '.join(map(quote, inexpressible))}, which cannot be given back later, "
            "so it is not replaced: remove it by hand, or give this one another metric."
        )
    return "ok", None


# One route taken back


def _list_returns(entry: RouteEntry, interfaces: typing.Container[str]) -> typing.List[typing.Tuple[str, ...]]:
    """List the routes that ours replaced and that can come back, since their interface is there."""
    devices = [(words, _find_word_after("dev", words)) for words in entry.replaced]
    return [words for words, device in devices if device is None or device in interfaces]


def _plan_removal(key: Key, entry: RouteEntry, kernel_routes: Held, interfaces: typing.Container[str]) -> KeyPlan:
    """The plan for a route of the record that is no longer listed."""
    ours = [kernel_route for kernel_route in kernel_routes if kernel_route.route.way in _ways(entry)]
    others = [kernel_route for kernel_route in kernel_routes if kernel_route not in ours]
    back = _list_returns(entry, interfaces) if ours and not others else []
    after = [" ".join(words) for words in back] + [kernel_route.text for kernel_route in others]
    route = ours[0].route if ours else entry.made[-1]
    result = dict(
        route.describe(),
        type=route.type,
        before=kernel_routes[0].text if kernel_routes else None,
        after=after[0] if after else None,
        state=_state(ours, others, back),
    )
    # The first route that comes back replaces ours. The removal of ours is for the case that it could not.
    adds = [_make_again(key, words, words is back[0])._replace(may_fail=True) for words in back]
    return KeyPlan(adds, [remove(kernel_route) for kernel_route in ours], after, result)


def _state(ours: Held, others: Held, back: typing.Sequence[typing.Any]) -> str:
    if back:
        return "restored"
    if ours:
        return "removed"
    return "left" if others else "gone"


# Changes


def _make_again(key: Key, words: typing.Tuple[str, ...], first: bool) -> RouteChange:
    """One of several routes of a key: the first replaces the present one, the others are added to it."""
    return RouteChange("replace" if first else "append", key, words, may_fail=not first)


def remove(kernel_route: KernelRoute) -> RouteChange:
    """The removal of one route; the others with its key stay."""
    # The kernel does not distinguish routes of IPv6 by their type, but it does by their device.
    lo = ("dev", "lo") if kernel_route.route.version == 6 and kernel_route.route.type in NO_WAY else ()
    return RouteChange("del", kernel_route.route.key, kernel_route.words + lo, may_fail=True)


def _links_first(changes: typing.List[RouteChange]) -> typing.List[RouteChange]:
    """The changes with networks on a link before the routes behind them. Within a key the order stays."""
    behind = {change.key for change in changes if {"via", "nexthop"} & set(change.words)}
    return sorted(changes, key=lambda change: change.key in behind)


def _find_word_after(name: str, words: typing.Sequence[str]) -> typing.Optional[str]:
    """The word that follows `name`, None if the words do not have it."""
    return words[words.index(name) + 1] if name in words else None


# Undo


def _undo(
    routes: typing.List[RouteSpec], current: Current, after: typing.Dict[Key, typing.List[str]]
) -> typing.List[RouteChange]:
    """The changes that bring the touched keys back to their present routes: first additions, then removals."""
    adds: typing.List[RouteChange] = []
    removals: typing.List[RouteChange] = []
    for key, texts in after.items():
        kernel_routes = current.get(key, [])
        if [kernel_route.text for kernel_route in kernel_routes] == texts:
            continue
        adds += [
            _make_again(key, kernel_route.words, kernel_route is kernel_routes[0]) for kernel_route in kernel_routes
        ]
        if not kernel_routes:
            removals += [
                RouteChange("del", key, tuple(to_words(route)), may_fail=True) for route in routes if route.key == key
            ]
    return _links_first(adds) + removals


def build_undo_command(change: RouteChange) -> typing.List[str]:
    """A change of `RoutesPlan.undo` as a command. It fails only if the former state does not come back."""
    words = change.words
    if change.verb != "del":
        return ["sh", "-c", f"{_join_words(change.command)} || :"] if change.may_fail else change.command
    filters = [word for name in ("via", "dev") if name in words for word in (name, _find_word_after(name, words) or "")]
    version, destination, table, _metric = change.key
    show = ["ip", f"-{version}", "route", "show", "table", str(table), "exact", destination, *filters]
    return ["sh", "-c", f'{_join_words(change.command)} 2>/dev/null || test -z "$({_join_words(show)} 2>/dev/null)"']


def _join_words(argv: typing.Iterable[str]) -> str:
    return " ".join(shlex.quote(word) for word in argv)


# Foreign default routes


def find_other_defaults(
    routes: typing.Iterable[RouteSpec], kernel_routes: typing.Iterable[KernelRoute]
) -> typing.List[KernelRoute]:
    """The foreign default routes in addition to a wanted one, in the same table. `kernel_routes`: those that stay."""
    wanted = [route for route in routes if route.destination in DEFAULTS.values() and route.type == "unicast"]
    places = {(route.destination, route.table) for route in wanted}
    return [other for other in kernel_routes if (other.route.destination, other.route.table) in places]
