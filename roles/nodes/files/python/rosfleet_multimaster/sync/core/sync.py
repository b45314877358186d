# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Registrations for other masters: lists and documents in, calls to the own roscore out.

The roscore itself is the only record. Claims say which nodes we registered; what the roscore holds for these nodes is
ours. Claims are written to the parameter server before the registrations. So they live exactly as long, and outlive a
killed master_sync. Every round compares what is wanted with what the roscore holds.

Free of sockets, threads and clocks: times are arguments, in seconds of a clock that never steps.
"""

from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import AbstractSet, Any, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from ...protocol.differences import changes, excerpt, names_of
from ...protocol.filters import UNKNOWN_TYPES, Filters, Pattern, Rules
from ...protocol.graph import LOCAL, Endpoints, State
from ...protocol.imports import Claims
from ...protocol.members import Members
from ...protocol.messages import Master, NodeKey, Registration
from .places import Places, host_of

COALESCE = 0.05  # seconds from a change to the fetch: several changes make one
PAUSE = 1.0  # seconds between two fetches where the first one brought nothing new: anybody can announce a change
RETRY = (0.2, 1.0, 3.0, 10.0, 30.0)  # seconds after failed fetches
PATIENCE = 1.0  # seconds that a change may be announced before a master that is followed tells it,
DOUBT = 10.0  # and from one fetch to the next where it told of none: anybody can write a stamp
MISSING = 15.0  # seconds that a master may be missing in the list (of a discovery node that has just started)

LONG_AGO = float("-inf")


def nodes_of(items: Iterable[Registration]) -> Set[NodeKey]:
    """The nodes of registrations. Called after each change with all that are held."""
    return set(map(itemgetter(2, 3), items))


@dataclass
class View:
    """The registrations in the own roscore. URIs are there only for the nodes and services that were asked for."""

    publishers: Mapping[str, Sequence[str]]
    subscribers: Mapping[str, Sequence[str]]
    services: Mapping[str, Sequence[str]]
    types: Mapping[str, str]
    node_uris: Mapping[str, str] = field(default_factory=dict)
    service_uris: Mapping[str, str] = field(default_factory=dict)

    def registrations(self, claims: Iterable[NodeKey]) -> Set[Registration]:
        """Everything that the claimed nodes have registered."""
        claimed = {node: uri for node, uri in claims if self.node_uris.get(node) == uri}
        found = set()
        for kind, table in (
            ("publisher", self.publishers),
            ("subscriber", self.subscribers),
            ("service", self.services),
        ):
            for name, nodes in table.items():
                for node in nodes:
                    if node in claimed:
                        service_uri = self.service_uris.get(name, "") if kind == "service" else ""
                        found.add(Registration(kind, name, node, claimed[node], service_uri))
        return found

    def own_nodes(self, claims: Iterable[NodeKey]) -> Dict[str, List[str]]:
        """Topic -> the nodes on it that are not claimed: this robot's own."""
        claimed = {node for node, uri in claims if self.node_uris.get(node) == uri}
        found: Dict[str, Dict[str, None]] = {}
        for table in (self.publishers, self.subscribers):
            for topic, nodes in table.items():
                for node in nodes:
                    if node not in claimed:
                        found.setdefault(topic, {})[node] = None
        return {topic: list(nodes) for topic, nodes in found.items()}


class Refusal(NamedTuple):
    """A conflict, so nothing is registered.

    The name is taken here, own nodes have the topic with another type, or a node is where none of its robot can be.
    """

    kind: str  # node, service, type, place
    name: str  # of the node, the service, the topic
    master: str  # name of the master that it is of
    uri: str  # who has it there; for a type, which it is
    holder: str  # the same here; for a place, what is wrong with it


@dataclass
class Plan:
    """The difference to carry out: calls, and what will be held then."""

    claims: Claims
    unregister: List[Registration]
    register: List[Registration]
    held: Dict[Registration, str]  # what will be held after it -> URI of its master
    refused: List[Refusal]
    types: Dict[Registration, str]  # of what will be held


class Wanted(NamedTuple):
    """A wanted registration and the master that it is of."""

    registration: Registration
    master_uri: str
    master: str
    type: str = "*"  # of the topic; "*" where the master knows none


def plan(wanted: Sequence[Wanted], view: View, claims: Mapping[NodeKey, str]) -> Plan:
    """Plan a round: wanted, held and foreign registrations in, calls out.

    A node whose name another node has is refused (a roscore would shut down the older one, on whichever robot it runs);
    so is a service whose name another provider has. Among several masters the one that holds a name keeps it.
    """
    refused: Dict[Refusal, None] = {}
    owner = _owners(wanted, view, claims, refused)
    provider = _providers(
        [item for item in wanted if owner.get(item.registration.node) == item.registration.node_uri],
        view,
        claims,
        refused,
    )
    held: Dict[Registration, str] = {}
    types: Dict[Registration, str] = {}
    for item in wanted:
        registration = item.registration
        if owner.get(registration.node) != registration.node_uri:
            continue
        if registration.kind == "service" and provider.get(registration.name) != registration.service_uri:
            continue
        held.setdefault(registration, item.master_uri)
        types.setdefault(registration, item.type)
    ours = view.registrations(claims)
    after = {registration.node_key: master for registration, master in held.items()}
    return Plan(
        claims={**{item.node_key: claims[item.node_key] for item in ours}, **after},
        unregister=sorted(ours - set(held)),
        register=sorted(set(held) - ours),
        held=held,
        refused=list(refused),
        types=types,
    )


def _owners(
    wanted: Sequence[Wanted], view: View, claims: Mapping[NodeKey, str], refused: Dict[Refusal, None]
) -> Dict[str, str]:
    """Node name -> URI of the node that is to have it here."""
    claimants: Dict[str, List[Wanted]] = {}
    for item in wanted:
        claimants.setdefault(item.registration.node, []).append(item)
    owner = {}
    for node, items in claimants.items():
        current = view.node_uris.get(node)
        uris = [item.registration.node_uri for item in items]
        if current is None or (node, current) in claims:
            owner[node] = current if current in uris else uris[0]
        for item in items:
            uri = item.registration.node_uri
            if uri != owner.get(node) and uri != current:  # the same URI: the own node, seen through another master
                refused[Refusal("node", node, item.master, uri, owner.get(node) or current or "")] = None
    return owner


def _providers(
    wanted: Sequence[Wanted], view: View, claims: Mapping[NodeKey, str], refused: Dict[Refusal, None]
) -> Dict[str, str]:
    """Service name -> URI of the provider that is to have it here."""
    provider: Dict[str, str] = {}
    uris: Dict[str, List[str]] = {}
    for item in wanted:
        if item.registration.kind == "service":
            uris.setdefault(item.registration.name, []).append(item.registration.service_uri)
    for name, offered in uris.items():
        current, users = view.service_uris.get(name), view.services.get(name, ())
        ours = all((user, view.node_uris.get(user, "")) in claims for user in users)
        if current is None or ours:
            provider[name] = current if current in offered else offered[0]
    for item in wanted:
        name, uri = item.registration.name, item.registration.service_uri
        if item.registration.kind == "service" and uri != provider.get(name):
            refused[
                Refusal("service", name, item.master, uri, provider.get(name) or view.service_uris.get(name, ""))
            ] = None
    return provider


def calls(todo: Plan) -> List[Tuple[Any, ...]]:
    """The calls to the own roscore, (method, argument, ...), in the order of `unregister` and `register`."""
    return [_call("unregister", item) for item in todo.unregister] + [
        _call("register", item, todo.types[item]) for item in todo.register
    ]


def _call(verb: str, item: Registration, kind: str = "*") -> Tuple[Any, ...]:
    method = verb + item.kind.capitalize()
    if item.kind == "service":
        head = (method, item.node, item.name, item.service_uri)
        return head if verb == "unregister" else head + (item.node_uri,)
    if verb == "unregister":
        return method, item.node, item.name, item.node_uri
    return method, item.node, item.name, kind, item.node_uri


def select(state: State, rules: Rules, own_uri: str, sync_remote_nodes: bool) -> List[Registration]:
    """The registrations of a master that are wanted here: of its own nodes, and not filtered."""
    uris = own_nodes(state, own_uri, sync_remote_nodes)
    return [
        *_topics(state, rules, uris, "publisher", state.publishers),
        *_topics(state, rules, uris, "subscriber", state.subscribers),
        *_services(state, rules, uris),
    ]


def own_nodes(state: State, own_uri: str, sync_remote_nodes: bool) -> Dict[str, str]:
    """The URIs of the nodes that count as the master's own, by name."""
    return {
        name: node.uri
        for name, node in state.nodes.items()
        if node.uri
        and node.origin != own_uri
        and (node.locality == LOCAL or (sync_remote_nodes and node.origin == state.uri))
    }


def _topics(
    state: State, rules: Rules, uris: Mapping[str, str], kind: str, endpoints: Endpoints
) -> Iterator[Registration]:
    publisher = kind == "publisher"
    for topic, nodes in endpoints.items():
        type_name = state.types.get(topic, "")
        if publisher and type_name in UNKNOWN_TYPES:
            continue
        for node in nodes:
            if node in uris and rules.topic(node, topic, type_name, publisher):
                yield Registration(kind, topic, node, uris[node])


def _services(state: State, rules: Rules, uris: Mapping[str, str]) -> Iterator[Registration]:
    for service, nodes in state.services.items():
        provider = state.providers.get(service)
        if provider is None or not provider.uri:
            continue
        for node in nodes:
            if node in uris and rules.service(node, service):
                yield Registration("service", service, node, uris[node], provider.uri)


# The other masters


class Fetch(NamedTuple):
    """Fetch the state of a master from its discovery node and hand it to `fetched`."""

    uri: str
    monitor_uri: str
    rules: Rules
    quick: bool = True  # it may tell its changes


@dataclass
class Remote:
    """Another master."""

    announced: Master
    rules: Rules  # for fetching and selecting
    given: Rules  # as they stand in the parameters
    state: Optional[State] = None
    due: Optional[float] = None
    fetching: bool = False
    failures: int = 0
    offline_since: Optional[float] = None
    missing_since: Optional[float] = None
    asking_for: float = 0.0  # local stamp that was announced when the fetch under way began
    answered_for: float = 0.0  # the same of the last successful one
    problem: str = ""
    began: float = LONG_AGO  # when the last fetch began
    vain: bool = False  # it brought nothing new
    following: bool = False  # it tells its changes,
    lapsed: bool = False  # and does so no more: it is fetched again
    quick: bool = True  # False where it was found that it does not tell its changes
    misplaced: Mapping[str, str] = field(default_factory=dict)  # URI of a node or service -> why it is refused
    selected: Dict[Registration, str] = field(default_factory=dict)  # what is wanted of the state -> type of the topic


class Sync:
    """The masters that are there, the states to fetch, and the registrations wanted of them."""

    def __init__(
        self,
        filters: Filters,
        own_uri: str,
        own_node: str,
        sync_remote_nodes: bool,
        on_demand: bool,
        keep_offline: Optional[float],
        members: Optional[Members] = None,
    ) -> None:
        """`keep_offline`: seconds that the registrations of an offline master are kept, None for ever."""
        self.members = Members() if members is None else members
        self.filters, self.own_uri, self.own_node = filters, own_uri, own_node
        self.sync_remote_nodes, self.on_demand, self.keep_offline = sync_remote_nodes, on_demand, keep_offline
        self.remotes: Dict[str, Remote] = {}

    def listed(self, masters: Sequence[Master], now: float, newer: AbstractSet[str] = frozenset()) -> None:
        """Take the complete list of discovery. A missing master is kept for a while: discovery may have just started.

        `newer`: masters of which there was news since the list was asked for. What it says of these is old.
        """
        for master in masters:
            if master.uri not in newer:
                self.announced(master, now)
        present = {master.uri for master in masters} | newer
        for uri, remote in list(self.remotes.items()):
            if uri in present:
                remote.missing_since = None
            elif remote.missing_since is None:
                remote.missing_since = now
            elif now - remote.missing_since >= MISSING:
                del self.remotes[uri]

    def removed(self, uri: str) -> None:
        """Forget a master: discovery says that it is gone."""
        self.remotes.pop(uri, None)

    def announced(self, master: Master, now: float) -> None:
        """Take the news of discovery that a master is there, or changed."""
        stranger = self.members.objection(master.uri, master.name, host_of(master.monitor_uri))
        remote = self.remotes.get(master.uri)
        wanted = remote is not None and remote.announced.name == master.name
        if stranger or master.uri == self.own_uri or not (wanted or self.filters.wants_host(master.name)):
            self.remotes.pop(master.uri, None)  # it may have been wanted under another name
            return
        if remote is None:
            remote = self.remotes[master.uri] = Remote(master, *self._rules(master))
        elif master.name != remote.announced.name or master.discoverer != remote.announced.discoverer:
            remote.rules, remote.given = self._rules(master)
            remote.state, remote.quick = None, True
        before, remote.announced = remote.announced, master
        remote.missing_since = None
        if not master.online:
            remote.offline_since = now if remote.offline_since is None else remote.offline_since
            return
        if self._is_expired(remote, now):
            remote.state, remote.quick = None, True
        remote.offline_since = None
        if not self._is_outdated(remote):
            if remote.following:
                remote.due = None  # an earlier announcement was wrong: who answers over TCP does not say whether its own nodes changed
        elif not remote.fetching:
            self._fetch_soon(remote, master != before, now)

    def _fetch_soon(self, remote: Remote, news: bool, now: float) -> None:
        if remote.due is None:
            remote.due, remote.failures = _soon(remote, now, remote.following), 0
        elif remote.failures and news:
            remote.due = min(remote.due, _soon(remote, now))

    def _rules(self, master: Master) -> Tuple[Rules, Rules]:
        given = self.filters.rules(master.name, (master.discoverer, self.own_node))
        # On demand every topic may be wanted: `wanted` chooses.
        return (replace(given, sync_topics=Pattern.from_items(["*"])) if self.on_demand else given), given

    def due(self, now: float) -> List[Fetch]:
        """The states to fetch now."""
        found = []
        for uri, remote in self.remotes.items():
            if remote.due is not None and remote.due <= now and not remote.fetching:
                remote.fetching, remote.due, remote.asking_for = True, None, remote.announced.local_stamp
                remote.began, remote.following = now, False
                found.append(Fetch(uri, remote.announced.monitor_uri, remote.rules, remote.quick))
        return found

    def next_due(self) -> Optional[float]:
        """The time of the next fetch."""
        return min(
            (remote.due for remote in self.remotes.values() if remote.due is not None and not remote.fetching),
            default=None,
        )

    def fetched(
        self,
        fetch: Fetch,
        state: Optional[State],
        problem: str,
        now: float,
        places: Optional[Places] = None,
        *,
        quick: bool = True,
        following: bool = False,
    ) -> bool:
        """Take the result of a fetch: a state, or None and why. True for a new state; without one the old is kept.

        `places`: where nodes of this master may be; None for anywhere. `quick`: it tells its changes, `following`: to us.
        """
        remote = self.remotes.get(fetch.uri)
        if remote is None:
            return False
        remote.fetching = False
        if state is not None and state.uri != fetch.uri:
            problem = f"{fetch.monitor_uri} answers for {state.uri}"
            state = None
        if fetch.rules != remote.rules:  # who it is has changed meanwhile
            state, problem = None, "it changed its name"
        remote.problem = "" if state is not None else problem
        before = remote.state
        remote.vain = state is None or (before is not None and before.local_stamp == state.local_stamp)
        if state is not None:
            remote.state, remote.answered_for, remote.failures = state, remote.asking_for, 0
            remote.misplaced = {} if places is None else places.refused(state)
            remote.selected = self._select(remote, state)
            remote.quick, remote.following, remote.lapsed = quick, following, False
            if self._is_outdated(remote):  # changed again meanwhile
                remote.due = _soon(remote, now, following)
        elif remote.announced.online:
            remote.due = now + RETRY[min(remote.failures, len(RETRY) - 1)]
            remote.failures += 1
        return state is not None

    def follows(self, fetch: Fetch) -> bool:
        """True while the changes of a master are followed as they were when this fetch began."""
        remote = self.remotes.get(fetch.uri)
        if remote is None or not remote.following or not remote.announced.online:
            return False
        same = remote.rules is fetch.rules or remote.rules == fetch.rules  # asked often, and equal rules take a while
        return same and remote.announced.monitor_uri == fetch.monitor_uri

    def followed(self, uri: str, state: State, misplaced: Mapping[str, str]) -> Set[Registration]:
        """Take a state that a master told. The registrations that may be others now."""
        remote = self.remotes[uri]
        before, remote.state = remote.state, state
        if not self._is_outdated(remote):
            remote.due = None
        selected = remote.selected
        if before is None or misplaced != remote.misplaced:
            remote.misplaced = misplaced
            remote.selected = self._select(remote, state)
            return {*selected, *remote.selected}
        undo = changes(before, state)
        names = names_of(undo, state)
        old = self._select(remote, excerpt(state, names, undo))
        new = self._select(remote, excerpt(state, names, {}))
        remote.selected = dict(selected)
        for item in old:
            remote.selected.pop(item, None)
        remote.selected.update(new)
        return {item for item in {*old, *new} if old.get(item) != new.get(item)}

    def _select(self, remote: Remote, state: State) -> Dict[Registration, str]:
        """The registrations of a state, or of a part of one, that are wanted and may be where they are."""
        return {
            item: "*" if state.types.get(item.name, "") in UNKNOWN_TYPES else state.types[item.name]
            for item in select(state, remote.rules, self.own_uri, self.sync_remote_nodes)
            if item.node_uri not in remote.misplaced and item.service_uri not in remote.misplaced
        }

    def selected(self, uri: str) -> Mapping[Registration, str]:
        """The registrations that are wanted of the last state of a master -> type of the topic."""
        remote = self.remotes.get(uri)
        return {} if remote is None else remote.selected

    def find_wanted(self, items: AbstractSet[Registration], now: float) -> Dict[Registration, Wanted]:
        """Of some registrations those that are wanted, on whatever topic."""
        found: Dict[Registration, Wanted] = {}
        for uri, remote in sorted(self.remotes.items()):
            if remote.state is not None and not self._is_expired(remote, now):
                for item in remote.selected.keys() & items:
                    found.setdefault(item, Wanted(item, uri, remote.announced.name, remote.selected[item]))
        return found

    def contested(self, name: str, master: str) -> bool:
        """True where a master other than this one has a node or a service of this name."""
        return any(
            remote.state is not None and (name in remote.state.nodes or name in remote.state.services)
            for uri, remote in self.remotes.items()
            if uri != master
        )

    def lapsed(self, uri: str, now: float) -> None:
        """Note that the changes of a master are followed no more. It is fetched again, where it is online."""
        remote = self.remotes.get(uri)
        if remote is None or remote.fetching:
            return
        remote.following, remote.lapsed = False, True
        if remote.announced.online:
            remote.due, remote.failures = now + RETRY[0], 0

    def settled(self) -> bool:
        """True where every master that is online has been asked for its state."""
        return all(
            remote.state is not None or remote.failures or not remote.announced.online
            for remote in self.remotes.values()
        )

    def wanted(self, now: float, own_topics: Optional[Iterable[str]] = None) -> List[Wanted]:
        """The registrations to make here. `own_topics`: topics of own nodes, for synchronisation on demand; None for any."""
        demanded = None if own_topics is None or not self.on_demand else set(own_topics)
        found = []
        for uri, remote in sorted(self.remotes.items()):
            if remote.state is None or self._is_expired(remote, now):
                continue
            for item, kind in remote.selected.items():
                if demanded is not None and item.kind != "service" and item.name not in demanded:
                    if not remote.given.sync_topics.matches(item.name):
                        if not remote.given.sync_nodes.matches(item.node):
                            continue
                found.append(Wanted(item, uri, remote.announced.name, kind))
        return found

    def misplaced(self) -> List[Refusal]:
        """The nodes and services that are refused, since they are where none of their robot can be."""
        found: Dict[Refusal, None] = {}
        for _uri, remote in sorted(self.remotes.items()):
            if not remote.misplaced or remote.state is None or not remote.announced.online:
                continue
            master = remote.announced.name
            for item in select(remote.state, remote.rules, self.own_uri, self.sync_remote_nodes):
                if item.node_uri in remote.misplaced:
                    why = remote.misplaced[item.node_uri]
                    found[Refusal("place", item.node, master, item.node_uri, why)] = None
                elif item.service_uri in remote.misplaced:
                    why = remote.misplaced[item.service_uri]
                    found[Refusal("place", item.name, master, item.service_uri, why)] = None
        return list(found)

    def stamps(self) -> Dict[str, float]:
        """Master -> stamp of the state that was fetched last."""
        return {uri: remote.state.local_stamp for uri, remote in self.remotes.items() if remote.state}

    def publishers_for(self, item: Registration, master_uri: str, here: Sequence[str]) -> List[str]:
        """The URIs that an imported subscriber is told: the publishers here and those of its own robot.

        roscpp closes the connections to those that are missing. So it is told nothing where a filter hides what its
        own robot has on the topic; nor where nobody publishes here; nor where its own roscore has all of these, and so has
        told it: rospy that is told twice may connect twice, and loses what came in between. A robot of the fleet may say any
        publisher, since only its own nodes hear of it; the subscriber of a stranger that says a refused one is told nothing.
        """
        remote = self.remotes.get(master_uri)
        state = remote.state if remote else None
        if remote is None or state is None or not here:
            return []
        if not remote.rules.topic(item.node, item.name, state.types.get(item.name, ""), True):
            return []
        nodes = (state.nodes.get(node) for node in state.publishers.get(item.name, ()))
        uris = [node.uri for node in nodes if node is not None and node.uri]
        known = self.members.master(master_uri) is not None
        if not known and any(uri in remote.misplaced and uri not in here for uri in uris):
            return []
        if set(here) <= set(uris):
            return []
        return list(dict.fromkeys([*here, *uris]))

    def next_expiry(self, now: float) -> Optional[float]:
        """The time at which the registrations of an offline master are to go."""
        if self.keep_offline is None:
            return None
        times = [
            remote.offline_since + self.keep_offline
            for remote in self.remotes.values()
            if remote.offline_since is not None
        ]
        return min((time for time in times if time > now), default=None)

    def _is_expired(self, remote: Remote, now: float) -> bool:
        return (
            remote.offline_since is not None
            and self.keep_offline is not None
            and now >= remote.offline_since + self.keep_offline
        )

    def _is_outdated(self, remote: Remote) -> bool:
        """True where a newer state was announced. A state fetched after an announcement has what was announced, whatever its stamp."""
        return (
            remote.state is None
            or remote.lapsed
            or remote.announced.local_stamp
            not in (
                remote.state.local_stamp,
                remote.answered_for,
            )
        )


def _soon(remote: Remote, now: float, following: bool = False) -> float:
    """The time of a fetch after news: at once, unless the last one was in vain. Who is followed has time to tell it."""
    if following:
        return max(now + PATIENCE, remote.began + DOUBT) if remote.vain else now + PATIENCE
    return max(now + COALESCE, remote.began + PAUSE) if remote.vain else now + COALESCE
