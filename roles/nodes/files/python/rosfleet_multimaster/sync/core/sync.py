# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Registrations for other masters: lists and documents in, calls to the own roscore out.

The roscore itself is the only record. Claims name the nodes that we registered; their registrations in the roscore are
ours. Claims are written to the parameter server before the registrations. So they live exactly as long, and outlive a
killed master_sync. Every round compares the wanted registrations with those in the roscore.

Free of sockets, threads and clocks: times are arguments, in seconds of a clock that never steps.
"""

from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import AbstractSet, Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from ...protocol.differences import changes, excerpt, names_of
from ...protocol.filters import UNKNOWN_TYPES, Filters, Pattern, Rules
from ...protocol.graph import LOCAL, State
from ...protocol.imports import Claims
from ...protocol.members import Members
from ...protocol.messages import AnnouncedMaster, NodeKey, Registration, View, rows
from ...protocol.tcpros.hosts import host_of

COALESCE = 0.05  # seconds from a change to the fetch: several changes make one
PAUSE = 1.0  # seconds between two fetches if the first one brought nothing new: anyone can announce a change
RETRY = (0.2, 1.0, 3.0, 10.0, 30.0)  # seconds after failed fetches
PATIENCE = 1.0  # seconds from the announcement of a change until a followed master must have reported it
DOUBT = 10.0  # seconds between two fetches of a followed master that reported no change: anyone can write a stamp
MISSING = 15.0  # seconds that a master may be missing in the list (of a discovery node that has just started)

LONG_AGO, NEVER = float("-inf"), float("inf")


def nodes_of(items: Iterable[Registration]) -> Set[NodeKey]:
    """The nodes of registrations. Called after each change with all of them, so it must be fast."""
    return set(map(itemgetter(2, 3), items))


class RegistrationConflict(NamedTuple):
    """A conflict, so nothing is registered.

    A name is taken here, a topic has a different type here, or a node is at an address at which its robot cannot be.
    """

    kind: str  # node, service, type, place, limit, parameter
    name: str  # of the node, the service, the topic, the parameter
    master: str  # the name of its master
    uri: str  # of the node or service there; for a type, the type there
    holder: str  # the same here; for a place and a parameter, the refusal


@dataclass
class SyncPlan:
    """The difference to carry out, and the state after it."""

    claims: Claims
    unregister: List[Registration]
    register: List[Registration]
    held: Dict[Registration, str]  # the registrations after it -> URI of the master
    refused: List[RegistrationConflict]
    types: Dict[Registration, str]  # of the registrations after it


class Candidate(NamedTuple):
    """A wanted registration, and its master."""

    registration: Registration
    master_uri: str
    master: str
    type: str = "*"  # of the topic; "*" if the master does not know the type


def plan(wanted: Sequence[Candidate], view: View, claims: Mapping[NodeKey, str]) -> SyncPlan:
    """Plan a round: wanted registrations and those in the roscore in, the difference out.

    A node is refused if another node here has its name: the roscore would shut down the older one, on whichever robot it
    runs. A service is refused if another provider has its name. Among several masters, the first one keeps a name.
    """
    refused: Dict[RegistrationConflict, None] = {}
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
    new_claims = {registration.node_key: master for registration, master in held.items()}
    return SyncPlan(
        claims={**{item.node_key: claims[item.node_key] for item in ours}, **new_claims},
        unregister=sorted(ours - set(held)),
        register=sorted(set(held) - ours),
        held=held,
        refused=list(refused),
        types=types,
    )


def _owners(
    wanted: Sequence[Candidate], view: View, claims: Mapping[NodeKey, str], refused: Dict[RegistrationConflict, None]
) -> Dict[str, str]:
    """Node name -> URI of the node that gets it here."""
    claimants: Dict[str, List[Candidate]] = {}
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
            if uri != owner.get(node) and uri != current:  # the same URI: our own node, as another master sees it
                refused[RegistrationConflict("node", node, item.master, uri, owner.get(node) or current or "")] = None
    return owner


def _providers(
    wanted: Sequence[Candidate], view: View, claims: Mapping[NodeKey, str], refused: Dict[RegistrationConflict, None]
) -> Dict[str, str]:
    """Service name -> URI of the provider that gets it here."""
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
                RegistrationConflict(
                    "service", name, item.master, uri, provider.get(name) or view.service_uris.get(name, "")
                )
            ] = None
    return provider


def calls(todo: SyncPlan) -> List[Tuple[Any, ...]]:
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
    """The wanted registrations of a master: of its own nodes, and not filtered."""
    uris, selected = master_nodes(state, own_uri, sync_remote_nodes), []
    for kind, name, node in rows(state):
        if node not in uris:
            continue
        if kind == "service":
            provider = state.providers.get(name)
            if provider is not None and provider.uri and rules.service(node, name):
                selected.append(Registration(kind, name, node, uris[node], provider.uri))
            continue
        type_name, publishes = state.types.get(name, ""), kind == "publisher"
        if not (publishes and type_name in UNKNOWN_TYPES) and rules.topic(node, name, type_name, publishes):
            selected.append(Registration(kind, name, node, uris[node]))
    return selected


def master_nodes(state: State, own_uri: str, sync_remote_nodes: bool) -> Dict[str, str]:
    """The URIs of the nodes that count as the master's own, by name."""
    return {
        name: node.uri
        for name, node in state.nodes.items()
        if node.uri
        and node.origin != own_uri
        and (node.locality == LOCAL or (sync_remote_nodes and node.origin == state.uri))
    }


# The other masters


class Fetch(NamedTuple):
    """Fetch the state of a master from its discovery node, and hand it to `take_fetch`."""

    uri: str
    monitor_uri: str
    rules: Rules


@dataclass
class Remote:
    """Another master."""

    announced: AnnouncedMaster
    rules: Rules  # for fetching and selecting
    parameter_rules: Rules  # without the changes for synchronisation on demand
    state: Optional[State] = None
    due: float = NEVER  # when it is fetched; not while it is being fetched
    fetching: bool = False
    failures: int = 0
    offline_since: float = NEVER  # NEVER: it is online
    missing_since: float = NEVER  # in the list of discovery
    asking_for: float = 0.0  # the announced local stamp when the present fetch began
    answered_for: float = 0.0  # the same of the last successful fetch
    began: float = LONG_AGO  # when the last fetch began
    vain: bool = False  # the last fetch brought nothing new
    following: bool = False  # its changes are followed
    lapsed: bool = False  # they were followed, and must be fetched again
    misplaced: Mapping[str, str] = field(default_factory=dict)  # URI of a node or service -> why it is refused
    selected: Dict[Registration, str] = field(default_factory=dict)  # wanted registration -> type of the topic


class Sync:
    """The other masters, the states to fetch, and the wanted registrations."""

    def __init__(
        self,
        filters: Filters,
        own_uri: str,
        own_node: str,
        sync_remote_nodes: bool,
        on_demand: bool,
        keep_offline: float,
        members: Optional[Members] = None,
    ) -> None:
        """`keep_offline`: seconds that the registrations of an offline master are kept."""
        self.members = Members() if members is None else members
        self.filters, self.own_uri, self.own_node = filters, own_uri, own_node
        self.sync_remote_nodes, self.on_demand, self.keep_offline = sync_remote_nodes, on_demand, keep_offline
        self.remotes: Dict[str, Remote] = {}

    def take_list(self, masters: Sequence[AnnouncedMaster], now: float, newer: AbstractSet[str] = frozenset()) -> None:
        """Take the complete list of discovery. A missing master is kept for a while: discovery may have just started.

        `newer`: masters with news since the list was asked for. Their entries in the list are old.
        """
        for master in masters:
            if master.uri not in newer:
                self.take_announcement(master, now)
        present = {master.uri for master in masters} | newer
        for uri, remote in list(self.remotes.items()):
            remote.missing_since = NEVER if uri in present else min(now, remote.missing_since)
            if now - remote.missing_since >= MISSING:
                del self.remotes[uri]

    def remove(self, uri: str) -> None:
        """Forget a master that discovery has removed."""
        self.remotes.pop(uri, None)

    def take_announcement(self, master: AnnouncedMaster, now: float) -> None:
        """Take the news of discovery that a master is there, or changed."""
        stranger = self.members.find_refusal(master.uri, master.name, host_of(master.monitor_uri))
        remote = self.remotes.get(master.uri)
        wanted = remote is not None and remote.announced.name == master.name
        if stranger or master.uri == self.own_uri or not (wanted or self.filters.wants_host(master.name)):
            self.remotes.pop(master.uri, None)  # it may have been wanted under another name
            return
        if remote is None:
            remote = self.remotes[master.uri] = Remote(master, *self._rules(master))
        elif master.name != remote.announced.name or master.discoverer != remote.announced.discoverer:
            remote.rules, remote.parameter_rules = self._rules(master)
            remote.state = None
        before, remote.announced = remote.announced, master
        remote.missing_since = NEVER
        if not master.online:
            remote.offline_since = min(now, remote.offline_since)
            return
        if self._is_expired(remote, now):
            remote.state = None
        remote.offline_since = NEVER
        if not self._is_outdated(remote):
            if remote.following:
                remote.due = NEVER  # an earlier announcement was wrong
        elif not remote.fetching:
            self._fetch_soon(remote, master != before, now)

    def _fetch_soon(self, remote: Remote, news: bool, now: float) -> None:
        if remote.due == NEVER:
            remote.due, remote.failures = _soon(remote, now, remote.following), 0
        elif remote.failures and news:
            remote.due = min(remote.due, _soon(remote, now))

    def _rules(self, master: AnnouncedMaster) -> Tuple[Rules, Rules]:
        rules = self.filters.rules(master.name, (master.discoverer, self.own_node))
        # On demand every topic may be wanted: `candidates` chooses.
        return (replace(rules, sync_topics=Pattern.from_items(["*"])) if self.on_demand else rules), rules

    def due(self, now: float) -> List[Fetch]:
        """The states to fetch now."""
        fetches = []
        for uri, remote in self.remotes.items():
            if remote.due <= now:
                remote.fetching, remote.due, remote.asking_for = True, NEVER, remote.announced.local_stamp
                remote.began, remote.following = now, False
                fetches.append(Fetch(uri, remote.announced.monitor_uri, remote.rules))
        return fetches

    def next_due(self) -> float:
        """The time of the next fetch."""
        return min((remote.due for remote in self.remotes.values()), default=NEVER)

    def take_fetch(
        self,
        fetch: Fetch,
        state: Optional[State],
        now: float,
        misplaced: Optional[Mapping[str, str]] = None,
        *,
        following: bool = False,
    ) -> Optional[Set[Registration]]:
        """Take the result of a fetch: a state, or None. Return the registrations of the old and the new state, if it is taken.

        `misplaced`: of its nodes and services, as in Remote. `following`: its changes are followed.
        """
        remote = self.remotes.get(fetch.uri)
        if remote is None:
            return None
        remote.fetching = False
        if state is None or state.uri != fetch.uri or fetch.rules != remote.rules:
            # A state of another master does not count, nor one of this master under its former name.
            remote.vain = True
            if remote.announced.online:
                remote.due = now + RETRY[min(remote.failures, len(RETRY) - 1)]
                remote.failures += 1
            return None
        selected, remote.misplaced = remote.selected, misplaced or {}
        remote.vain = remote.state is not None and remote.state.local_stamp == state.local_stamp
        remote.state, remote.answered_for, remote.failures = state, remote.asking_for, 0
        remote.selected = self._select(remote, state)
        remote.following, remote.lapsed = following, False
        if self._is_outdated(remote):  # it has changed again
            remote.due = _soon(remote, now, following)
        return {*selected, *remote.selected}

    def follows(self, fetch: Fetch) -> bool:
        """True while the changes of a master are followed, by the rules and at the address of this fetch."""
        remote = self.remotes.get(fetch.uri)
        if remote is None or not remote.following or not remote.announced.online:
            return False
        same = remote.rules is fetch.rules or remote.rules == fetch.rules  # `is` first: comparing takes long
        return same and remote.announced.monitor_uri == fetch.monitor_uri

    def take_change(self, uri: str, state: State, misplaced: Mapping[str, str]) -> Set[Registration]:
        """Take the new state of a followed master. Return the registrations that may have changed."""
        remote = self.remotes[uri]
        before, remote.state = remote.state, state
        if not self._is_outdated(remote):
            remote.due = NEVER
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
        """The wanted registrations of a state, or of a part of one, at allowed places."""
        return {
            item: "*" if state.types.get(item.name, "") in UNKNOWN_TYPES else state.types[item.name]
            for item in select(state, remote.rules, self.own_uri, self.sync_remote_nodes)
            if item.node_uri not in remote.misplaced and item.service_uri not in remote.misplaced
        }

    def find_candidates(self, items: AbstractSet[Registration], now: float) -> Dict[Registration, Candidate]:
        """The wanted ones of some registrations. Does not look whether a topic is in demand."""
        candidates: Dict[Registration, Candidate] = {}
        for uri, remote in sorted(self.remotes.items()):
            if remote.state is not None and not self._is_expired(remote, now):
                for item in remote.selected.keys() & items:
                    candidates.setdefault(item, Candidate(item, uri, remote.announced.name, remote.selected[item]))
        return candidates

    def is_contested(self, name: str, master: str) -> bool:
        """True if a master other than this one has a node or a service of this name."""
        return any(
            remote.state is not None and (name in remote.state.nodes or name in remote.state.services)
            for uri, remote in self.remotes.items()
            if uri != master
        )

    def end_following(self, uri: str, now: float) -> None:
        """Follow the changes of a master no more. If it is online, it is fetched again."""
        remote = self.remotes.get(uri)
        if remote is None or remote.fetching:
            return
        remote.following, remote.lapsed = False, True
        if remote.announced.online:
            remote.due, remote.failures = now + RETRY[0], 0

    def candidates(self, now: float, own_topics: Optional[Iterable[str]] = None) -> List[Candidate]:
        """The registrations to make here. `own_topics`: topics of own nodes, for synchronisation on demand; None for any."""
        demanded = None if own_topics is None or not self.on_demand else set(own_topics)
        candidates = []
        for uri, remote in sorted(self.remotes.items()):
            if remote.state is None or self._is_expired(remote, now):
                continue
            rules = remote.parameter_rules
            for item, kind in remote.selected.items():
                if demanded is not None and item.kind != "service" and item.name not in demanded:
                    if not rules.sync_topics.matches(item.name) and not rules.sync_nodes.matches(item.node):
                        continue
                candidates.append(Candidate(item, uri, remote.announced.name, kind))
        return candidates

    def place_refusals(self) -> List[RegistrationConflict]:
        """The refusals of nodes and services at addresses at which their robot cannot be."""
        refusals: Dict[RegistrationConflict, None] = {}
        for _uri, remote in sorted(self.remotes.items()):
            if not remote.misplaced or remote.state is None or not remote.announced.online:
                continue
            master = remote.announced.name
            for item in select(remote.state, remote.rules, self.own_uri, self.sync_remote_nodes):
                here = item.node_uri in remote.misplaced
                name, uri = (item.node, item.node_uri) if here else (item.name, item.service_uri)
                if uri in remote.misplaced:
                    refusals[RegistrationConflict("place", name, master, uri, remote.misplaced[uri])] = None
        return list(refusals)

    def stamps(self) -> Dict[str, float]:
        """Master -> stamp of the state that was fetched last."""
        return {uri: remote.state.local_stamp for uri, remote in self.remotes.items() if remote.state}

    def publishers_for(self, item: Registration, master_uri: str, here: Sequence[str]) -> List[str]:
        """The URIs to send to an imported subscriber: the publishers here and those of its own robot. Empty: send nothing.

        roscpp closes the connections to missing publishers. So nothing is sent if a filter hides publishers of its own
        robot, or if there is no publisher here. Nothing is sent if its own roscore has all of these, and so has sent
        them: rospy that gets them twice may connect twice, and loses messages. A robot of the fleet may name any publisher,
        since only its own nodes hear of it. If a stranger names a refused one, its subscriber gets nothing.
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

    def find_members(self, now: float) -> Dict[str, AnnouncedMaster]:
        """The masters of the fleet's robots that are there, by their names in small letters. Strangers are not among them."""
        found: Dict[str, AnnouncedMaster] = {}
        for uri, remote in self.remotes.items():
            member = self.members.master(uri)
            if member is not None and not self._is_expired(remote, now):
                found[member.name.lower()] = remote.announced
        return found

    def next_expiry(self, now: float) -> float:
        """The time at which the registrations of an offline master end."""
        times = (remote.offline_since + self.keep_offline for remote in self.remotes.values())
        return min((time for time in times if time > now), default=NEVER)

    def _is_expired(self, remote: Remote, now: float) -> bool:
        return now >= remote.offline_since + self.keep_offline

    def _is_outdated(self, remote: Remote) -> bool:
        """True if a newer state was announced. A state fetched after an announcement counts as the announced one."""
        if remote.state is None or remote.lapsed:
            return True
        return remote.announced.local_stamp not in (remote.state.local_stamp, remote.answered_for)


def _soon(remote: Remote, now: float, following: bool = False) -> float:
    """The time of a fetch after news: at once, unless the last fetch was in vain. A followed master has time to report them."""
    if following:
        return max(now + PATIENCE, remote.began + DOUBT) if remote.vain else now + PATIENCE
    return max(now + COALESCE, remote.began + PAUSE) if remote.vain else now + COALESCE
