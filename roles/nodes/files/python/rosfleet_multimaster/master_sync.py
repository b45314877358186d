# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The node master_sync: registers what other masters have in the own roscore, and withdraws it again.

`python3 -m rosfleet_multimaster.master_sync [--parameters FILE.json] [name:=value ...]`
"""

import json
import threading
from typing import Any, Dict, List, Optional, Sequence, Set, Tuple
from urllib.parse import urlsplit
from xmlrpc.client import Fault

from . import program
from .core import parameters
from .core.filters import Filters
from .core.graph import Malformed, State, parse
from .core.losses import Connection, Ending, Look, Losses, connections_of
from .core.message_types import Question, TypeGuard
from .core.sync import Announced, Claims, Fetch, Plan, Refusal, Registration, Sync, View, Wanted, calls, plan
from .edge import connections, ros
from .edge.clock import monotonic, wall_clock
from .edge.loop import Loop, Workers
from .edge.roscore import Roscore
from .edge.rpc_client import Rpc
from .edge.systemd import notify

FETCH_TIMEOUT, MAX_STATE = 10.0, 16 << 20  # seconds, bytes: 5,000 topics are 3 MB
UPDATE_TIMEOUT = 3.0  # seconds
LIST_FIRST, LIST = 0.5, 10.0  # seconds between two looks at list_masters, until the first answer and then
HEALTH, AWAY_HEALTH = 0.5, 0.1  # seconds between two looks at whether the roscore is still the one; while it is away
ROUND = 30.0  # seconds between two comparisons of what is wanted with what the roscore holds, if nothing happens
AGAIN = (0.2, 0.5, 1.0)  # seconds after failed rounds: a roscore under load refuses one now and then
QUESTION_TIMEOUT = 2.0  # seconds for what an own node is asked, or another master about its types
SWEEP, SWEEP_AGAIN = 1.0, 0.1  # seconds between two looks for connections to lost masters, and where there were some
LEFTOVERS = 15.0  # seconds that registrations of an earlier life wait for their master to be found again
LINES = 50  # log lines of one round

# What is said of a refusal: where the other one is, where the own one is, and what to do.
SENTENCES = {
    "node": "at %s is refused: here it is %s. Give one of them another name, or ignore it",
    "service": "at %s is refused: here it is %s. Give one of them another name, or ignore it",
    "type": "is refused: there it is %s, here %s. Use one definition on both robots, another topic, or ignore_topics",
}
NOUNS = {"node": "node", "service": "service", "type": "topic"}


class Reading:
    """What the own roscore holds, as far as a round needs it: who has the names of what was wanted when it began."""

    def __init__(self, wanted: Sequence[Wanted], view: View, claims: Claims) -> None:
        self.wanted, self.view, self.claims = {item.registration for item in wanted}, view, claims


class MasterSync:
    """The program."""

    def __init__(self) -> None:
        self.log = program.logger()
        self.limited = program.Limited(self.log)
        self.loop = Loop()
        self.fetchers = Workers(self.loop, 8)
        self.updaters = Workers(self.loop, 8)
        self.askers = Workers(self.loop, 4)
        self.enders = Workers(self.loop, 1)  # of connections: never behind what may hang
        self.resolvers = Workers(self.loop, 2)  # name servers know no time limit
        self.rospy_calls = Workers(self.loop, 2)
        self.roscore_calls = Workers(self.loop, 1)  # everything that is asked of the own roscore, one after the other
        self.claims: Claims = {}
        self.held: Dict[Registration, str] = {}
        self.refused: Set[Refusal] = set()
        self.list_service = ""
        self.finding = self.listing = self.checking = self.working = False
        self.round_due: Optional[float] = None
        self.list_due = self.health_due = self.find_due = 0.0
        self.ready = False
        self.listed_once = False
        self.unanswered = self.failed_rounds = 0
        self.guard = TypeGuard()
        self.losses: Optional[Losses] = None
        self.sweep_due, self.sweeping = 0.0, False
        self.status = ""
        self.ending = False
        self.farewell = ""
        self.own_local_stamp = 0.0
        self.met: Set[str] = set()  # URIs of the masters whose state was had in this life

    def main(self) -> int:
        """Start, run, end."""
        given = program.arguments(__doc__ or "")
        read = program.read_parameters(given.parameters, parameters.SYNC)
        env_uri = ros.master_uri()
        self.uri = program.wait_for_roscore(env_uri)
        name = ros.node_name("master_sync")
        self.roscore = Roscore(env_uri, name)
        program.refuse_second(self.roscore, name)
        self.node_name, self.node_uri = ros.start("master_sync")
        ros.ended_by(lambda reason: self.loop.post(self._ended_by_ros, reason))
        values, warnings = program.settle_parameters(self.roscore, name, read, parameters.SYNC)
        program.logger(values["log_level"])
        for warning in warnings:
            self.log.warning("%s", warning)
        self.identity = program.Identity()
        (text,) = self.roscore.ask(("getParam", program.IMPORTS))
        self.claims = _claims(text)
        if self.claims:
            self.log.info("%d nodes of other masters are registered here since before this start", len(self.claims))
        # Also an empty record tells who keeps it: discovery and the verification then ask nobody else.
        self.roscore.ask(("setParam", program.IMPORTS, self._record(self.claims)))
        keep = values["resync_on_reconnect_timeout"] if values["resync_on_reconnect"] else None
        self.core = Sync(
            Filters(values),
            self.uri,
            self.node_name,
            values["sync_remote_nodes"],
            values["sync_topics_on_demand"],
            keep,
        )
        if values["end_lost_connections"]:
            self._prepare_for_losses()
        self.node = ros.SyncNode(lambda: self.held)
        self.identity.service = self.node.service_uri()
        self.started = monotonic()
        program.on_signals(self.loop, self._end)
        notify("STATUS=looking for master_discovery")
        self.loop.run(self._tick)
        self.log.info("%s", self.farewell)
        ros.stop("the service ends")
        return 0

    # The loop

    def _tick(self, now: float) -> float:
        if self.ending:
            return now + 1.0
        if not self.checking and now >= self.health_due:
            self.health_due, self.checking = now + HEALTH, True
            service = self.identity.service
            self.roscore_calls.submit(
                lambda: self.identity.check(service, *self.roscore.ask(*self.identity.calls())), self._checked
            )
        if not self.finding and now >= self.find_due:
            self.find_due, self.finding = now + (ROUND if self.list_service else LIST_FIRST), True
            self.roscore_calls.submit(self._find, self._found)
        if self.list_service and not self.listing and now >= self.list_due:
            self.list_due, self.listing = now + (LIST if self.listed_once else LIST_FIRST), True
            self.rospy_calls.submit(lambda service=self.list_service: ros.list_masters(service), self._listed)
        for fetch in self.core.due(now):
            self.fetchers.submit(
                lambda fetch=fetch: _fetch(fetch, self.core.sync_remote_nodes),
                lambda *result, fetch=fetch: self._fetched(fetch, *result),
            )
        sweep = self.losses is not None and bool(self.losses.endpoints())
        if sweep and not self.sweeping and now >= self.sweep_due:
            self._sweep(now)
        gone = self.core.next_gone(now)
        if self.round_due is not None and now >= self.round_due and not self.working:
            self.round_due, self.working = None, True
            wanted = self.core.wanted(now)
            claims = dict(self.claims)
            self.roscore_calls.submit(lambda: self._read(wanted, claims), self._read_done)
        # Of what is under way, the end wakes the loop.
        due = [now + ROUND]
        due += [self.health_due] if not self.checking else []
        due += [self.find_due] if not self.finding else []
        due += [time for time in (self.core.next_due(), gone) if time is not None]
        due += [self.sweep_due] if sweep and not self.sweeping else []
        due += [self.list_due] if self.list_service and not self.listing else []
        due += [self.round_due] if self.round_due is not None and not self.working else []
        if gone is not None:
            self._round(gone)
        return min(due)

    def _round(self, at: float) -> None:
        """Have a round at this time, or earlier."""
        self.round_due = at if self.round_due is None else min(at, self.round_due)

    def _checked(self, _result: None, problem: Optional[Exception]) -> None:
        self.checking = False
        if isinstance(problem, program.Fatal):
            self._give_up(str(problem))
        elif problem is not None:
            self.unanswered += 1
            self.health_due = monotonic() + AWAY_HEALTH  # the next one may be another roscore already
            if self.unanswered == 2:
                self.log.error("the roscore at %s does not answer: %s", self.roscore.rpc.uri, problem)
        else:
            if self.unanswered > 1:
                self.log.info("the roscore answers again")
                self._round(monotonic())
            self.unanswered = 0

    # Discovery

    def _find(self) -> Tuple[str, str]:
        """The topic and the service of the discovery node of this roscore."""
        types, system = self.roscore.ask(("getTopicTypes",), ("getSystemState",))
        if types is None or system is None:
            raise OSError("the roscore does not tell its state")
        foreign = {node for node, _uri in self.claims}
        publishers, _subscribers, services = system
        own_topics = {topic for topic, nodes in publishers if set(nodes) - foreign}
        topics = sorted(topic for topic, kind in types if kind.endswith(ros.CHANGES_TYPE) and topic in own_topics)
        found = sorted(name for name, nodes in services if name.endswith(ros.LIST_MASTERS) and set(nodes) - foreign)
        return (topics[0] if topics else ""), (found[0] if found else "")

    def _found(self, found: Optional[Tuple[str, str]], problem: Optional[Exception]) -> None:
        self.finding = False
        topic, service = found or ("", "")
        if topic:
            self.node.subscribe(topic, lambda change, master: self.loop.post(self._announced, change, master))
        if problem is not None:
            self.find_due = monotonic() + LIST_FIRST
        if service and service != self.list_service:
            self.list_due = 0.0
        if service:
            self.list_service = service
        elif problem is None:
            text = f"no master_discovery on the roscore at {self.roscore.rpc.uri}: waiting for it"
            self.limited.say("warning", "discovery", text)
            if not self.listed_once:
                notify(f"STATUS={text}")

    def _listed(self, masters: Optional[List[Announced]], problem: Optional[Exception]) -> None:
        self.listing = False
        if masters is None:
            self.find_due = monotonic() + LIST_FIRST
            self.list_service = ""
            self.limited.say("warning", "list", f"master_discovery does not list the masters: {problem}")
            return
        now, before = monotonic(), self._online()
        self.core.listed(masters, now)
        self._look_for_losses(now)
        if not self.listed_once or self._online() != before:
            self._round(now)
        self.listed_once = True

    def _online(self) -> Dict[str, bool]:
        """URI of a master -> whether it is online."""
        return {uri: remote.announced.online for uri, remote in self.core.remotes.items()}

    def _announced(self, change: str, master: Announced) -> None:
        """A message of `~changes`."""
        now = monotonic()
        if change == "removed":
            self.met.add(master.uri)
            self.core.removed(master.uri)
            self._round(now)
        else:
            self.core.announced(master, now)
            self._look_for_losses(now)
            own_changed = master.uri == self.uri and master.local_stamp != self.own_local_stamp
            if own_changed or not master.online:
                self._round(now)
            if own_changed:  # a name that was taken may be free now
                self.own_local_stamp = master.local_stamp

    def _fetched(self, fetch: Fetch, state: Optional[State], problem: Optional[Exception]) -> None:
        now = monotonic()
        if self.core.fetched(fetch, state, str(problem or ""), now):
            self.met.add(fetch.uri)
            self._round(now)
        elif problem is not None:
            self.limited.say(
                "warning",
                f"fetch {fetch.uri}",
                f"the state of {fetch.uri} cannot be had from {fetch.monitor_uri}: {problem}",
            )

    # A round: read, plan, write

    def _read(self, wanted: List[Wanted], claims: Claims) -> Reading:
        """In the thread of the roscore."""
        types, system = self.roscore.ask(("getTopicTypes",), ("getSystemState",))
        if types is None or system is None:
            raise OSError("the roscore does not tell its state")
        publishers, subscribers, services = ({name: tuple(nodes) for name, nodes in part} for part in system)
        claimed = {node for node, _uri in claims}
        nodes = sorted({item.registration.node for item in wanted} | claimed)
        asked = {item.registration.name for item in wanted if item.registration.kind == "service"}
        names = sorted(name for name, users in services.items() if name in asked or claimed.intersection(users))
        # A node that provides a wanted service here, or has a wanted topic, matters too: is it one of ours?
        users = {user for name in names for user in services[name]}
        topics = {item.registration.name for item in wanted if item.registration.kind != "service"}
        for table in (publishers, subscribers):
            users.update(user for topic in topics.intersection(table) for user in table[topic])
        nodes = sorted({*nodes, *users})
        answers = self.roscore.ask(
            *[("lookupNode", node) for node in nodes], *[("lookupService", name) for name in names]
        )
        node_uris = {node: uri for node, uri in zip(nodes, answers) if isinstance(uri, str)}
        service_uris = {name: uri for name, uri in zip(names, answers[len(nodes) :]) if isinstance(uri, str)}
        return Reading(wanted, View(publishers, subscribers, services, dict(types), node_uris, service_uris), claims)

    def _read_done(self, reading: Optional[Reading], problem: Optional[Exception]) -> None:
        if reading is None:
            self._round_over(problem)
            return
        now, view = monotonic(), reading.view
        wanted = [] if self.ending else self.core.wanted(now, view.own_nodes(reading.claims))
        # What came meanwhile is for the next round: nobody has looked whether its name is free.
        wanted = [item for item in wanted if item.registration in reading.wanted]
        if not self.ending and (now - self.started < LEFTOVERS or not self.listed_once):
            wanted += self._leftovers(reading)
        verdict = self.guard.judge(wanted, view, reading.claims, self.core.stamps(), now)
        for question in verdict.questions:
            self._ask(question)
        todo = plan(verdict.wanted, view, reading.claims)
        todo.refused += verdict.refused
        if self.losses is not None:
            self.losses.registered(todo.held, view, reading.claims)
            for host in self.losses.to_resolve(now):
                self._resolve(host)
        before = view.registrations(reading.claims)
        # Reported before it is visible in the roscore, so that discovery never takes it for the robot's own.
        self.held = {**{item: reading.claims[item.of] for item in before}, **todo.held}
        self.roscore_calls.submit(
            lambda: self._write(todo, reading.claims),
            lambda results, why: self._written(todo, reading.claims, results, why),
        )

    def _leftovers(self, reading: Reading) -> List[Wanted]:
        """Registrations of an earlier life whose masters have not been found again yet."""
        keep = {key: uri for key, uri in reading.claims.items() if uri not in self.met}
        return [Wanted(item, keep[item.of], keep[item.of]) for item in sorted(reading.view.registrations(keep))]

    def _write(self, todo: Plan, claims: Claims) -> List[Any]:
        """In the thread of the roscore: one request, the claims first."""
        record: List[Tuple[Any, ...]] = []
        if todo.claims != claims:
            record = [("setParam", program.IMPORTS, self._record(todo.claims))]
        results = self.roscore.rpc.multicall([(call[0], self.node_name, *call[1:]) for call in record] + calls(todo))
        return results[len(record) :]

    def _record(self, claims: Claims) -> str:
        imports: Dict[str, Dict[str, str]] = {}
        for (node, uri), master in sorted(claims.items()):
            imports.setdefault(master, {})[node] = uri
        return json.dumps({"node": self.node_name, "uri": self.node_uri, "imports": imports})

    def _written(self, todo: Plan, claims: Claims, results: Optional[List[Any]], problem: Optional[Exception]) -> None:
        self.claims = todo.claims  # also after a failure: perhaps it was carried out, and the next round will see
        if results is None:
            self._round_over(problem)
            return
        self.held = dict(todo.held)
        done = []
        made = [("unregistered", item, claims[item.of]) for item in todo.unregister]
        made += [("registered", item, todo.held[item]) for item in todo.register]
        for (verb, item, master), result in zip(made, results):
            if isinstance(result, Fault) or result[0] != 1:
                why = result.faultString if isinstance(result, Fault) else result[1]
                self.held.pop(item, None)
                self.limited.say("error", f"call {item}", f"the roscore refuses the {item}: {why}")
                continue
            done.append(f"{self._name(master)}: {verb} the {item}")
            if verb == "registered" and item.kind == "subscriber":
                self._tell_publishers(item, master, result[2])
        for line in done[:LINES]:
            self.log.info("%s", line)
        if len(done) > LINES:
            self.log.info("... and %d more registrations", len(done) - LINES)
        self._report(todo.refused)
        self._round_over(None)

    def _name(self, master: str) -> str:
        remote = self.core.remotes.get(master)
        return remote.announced.name if remote is not None else urlsplit(master).hostname or master

    def _tell_publishers(self, item: Registration, master: str, publishers: List[str]) -> None:
        """A roscore tells only the caller who publishes; the subscriber itself is on another robot."""
        uris = self.core.publishers_for(item, master, publishers)
        if uris:
            self.updaters.submit(
                lambda: Rpc(item.node_uri, UPDATE_TIMEOUT).call("publisherUpdate", "/master", item.name, uris),
                lambda _result, problem: (
                    problem
                    and self.limited.say(
                        "warning",
                        f"update {item.node_uri}",
                        f"{item.node} cannot be told who publishes {item.name}: {problem}",
                    )
                ),
            )

    def _round_over(self, problem: Optional[Exception]) -> None:
        self.working = False
        now = monotonic()
        if self.ending:
            self._withdrawn(problem)
            return
        if problem is not None:
            self.limited.say("error", "round", f"nothing can be registered at {self.roscore.rpc.uri}: {problem}")
        self.failed_rounds = self.failed_rounds + 1 if problem is not None else 0
        if self.failed_rounds:
            self._round(now + AGAIN[min(self.failed_rounds, len(AGAIN)) - 1])
        else:
            left = self.claims.keys() - {item.of for item in self.held}
            self._round(now + (AGAIN[-1] if left else ROUND))
        if problem is None and self.listed_once and not self.ready:
            self.ready = True
            notify("READY=1")
        self._say_status()

    # The types of shared topics

    def _ask(self, question: Question) -> None:
        if question.node is not None:
            node = question.node
            self.askers.submit(lambda: _types_of(node[1]), lambda types, _problem: self._told_by_node(node, types))
            return
        remote, types = self.core.remotes.get(question.master), sorted(question.types)
        monitor = remote.announced.monitor_uri if remote is not None else ""
        self.askers.submit(
            lambda: _md5sums(monitor, types), lambda sums, _problem: self._told_by_master(question.master, sums)
        )

    def _told_by_node(self, node: Tuple[str, str], types: Optional[Dict[str, str]]) -> None:
        self.guard.told_by_node(node, types, monotonic())
        self._round(monotonic())

    def _told_by_master(self, master: str, sums: Optional[Tuple[Dict[str, str], Dict[str, str]]]) -> None:
        there, here = sums or (None, {})
        self.guard.told_by_master(master, there, here, monotonic())
        self._round(monotonic())

    # Lost masters

    def _prepare_for_losses(self) -> None:
        try:
            connections.check()
        except OSError as problem:
            text = (
                "connections with lost robots are left to TCP, since this service cannot end them (CAP_NET_ADMIN): %s"
            )
            self.log.info(text, problem)
            return
        self.losses = Losses()

    def _resolve(self, host: str) -> None:
        self.resolvers.submit(
            lambda: connections.addresses_of(host),
            lambda found, _problem: self.losses and found and self.losses.resolved(host, found, monotonic()),
        )

    def _look_for_losses(self, now: float) -> None:
        if self.losses is None:
            return
        looks, endings = self.losses.seen(self._online(), now)
        for look in looks:
            self.sweep_due = now
            for _name, uri in look.nodes:
                self.updaters.submit(
                    lambda look=look, uri=uri: _connections_with(look, uri),
                    lambda found, _problem, look=look: self.losses and self.losses.noted(look.master, found or set()),
                )
        for ending in endings:
            self.enders.submit(lambda ending=ending: _end(ending), self._ended_connections)

    def _sweep(self, now: float) -> None:
        """Nothing of this computer is to wait for the nodes of a lost master."""
        self.sweep_due, self.sweeping = now + SWEEP, True
        endpoints = self.losses.endpoints() if self.losses else set()

        def done(ended: Optional[List[connections.Tcp]], problem: Optional[Exception]) -> None:
            self.sweeping = False
            if ended:  # the roscore may have a queue of what leads there
                self.sweep_due = monotonic() + SWEEP_AGAIN
            self._ended_connections(ended, problem)

        self.enders.submit(lambda: connections.end_all(lambda found: found.remote in endpoints), done)

    def _ended_connections(self, ended: Optional[List[connections.Tcp]], problem: Optional[Exception]) -> None:
        for found in (ended or [])[:LINES]:
            self.log.info("the connection from port %d to %s:%d is ended", found.local[1], *found.remote)
        if problem is not None:
            self.limited.say("warning", "end", f"connections with lost robots cannot be ended: {problem}")

    # What people see

    def _report(self, refused: List[Refusal]) -> None:
        now_refused = set(refused)
        for item in refused:
            if item not in self.refused:
                text = SENTENCES[item.kind] % (item.uri, item.holder)
                self.log.warning("%s: the %s %s %s", item.master, NOUNS[item.kind], item.name, text)
        for item in self.refused - now_refused:
            self.log.info("%s: the %s %s is no longer refused", item.master, NOUNS[item.kind], item.name)
        if now_refused != self.refused:
            names = [item for item in refused if item.kind != "type"]
            types = [item for item in refused if item.kind == "type"]
            self.node.diagnose(
                [
                    self._diagnosis("names", "refused, since the name is taken here", names),
                    self._diagnosis("types", "refused, since the topic has another type here", types),
                ],
                wall_clock(),
            )
        self.refused = now_refused

    def _diagnosis(self, what: str, why: str, refused: List[Refusal]) -> ros.Diagnosis:
        values = [
            (f"{NOUNS[item.kind]} {item.name}", f"{item.uri} of {item.master} is refused, here it is {item.holder}")
            for item in refused
        ]
        return ros.Diagnosis(
            f"{self.node_name.lstrip('/')}: {what}", f"{why}: {len(refused)}" if refused else "OK", values
        )

    def _say_status(self) -> None:
        if not self.listed_once:
            return
        parts = []
        for uri, remote in sorted(self.core.remotes.items(), key=lambda item: item[1].announced.name):
            mine = [item for item, master in self.held.items() if master == uri]
            topics = len({item.name for item in mine if item.kind != "service"})
            services = sum(1 for item in mine if item.kind == "service")
            offline = "" if remote.announced.online else " (offline)"
            parts.append(f"{remote.announced.name}{offline}: {topics} topics, {services} services")
        text = "; ".join(parts) or "no other master"
        text += f"; refused: {', '.join(sorted({item.name for item in self.refused}))}" if self.refused else ""
        if text != self.status:
            self.status = text
            notify(f"STATUS={text}")

    # The end

    def _ended_by_ros(self, reason: str) -> None:
        if not self.ending:
            self._give_up(f"somebody ended this node: {reason}")

    def _give_up(self, reason: str) -> None:
        """End at once: what is registered is recorded in the roscore, and the service manager starts the node again."""
        self.log.error("%s", reason)
        notify(f"STOPPING=1\nSTATUS={reason}")
        program.leave_process(1)

    def _end(self) -> None:
        """Withdraw everything, but not for ever."""
        if self.ending:
            return
        self.ending = True
        notify("STOPPING=1\nSTATUS=withdrawing the registrations of other masters")
        watchdog = threading.Timer(8.0, program.leave_process, (0,))
        watchdog.daemon = True
        watchdog.start()
        if not self.working:
            self._withdraw()

    def _withdraw(self) -> None:
        self.working = True
        claims = dict(self.claims)
        self.roscore_calls.submit(lambda: self._read([], claims), self._read_done)

    def _withdrawn(self, problem: Optional[Exception]) -> None:
        if self.held and problem is None:  # the round that was under way registered something
            self._withdraw()
            return
        self.farewell = (
            "withdrawn" if problem is None else f"nothing is withdrawn, the roscore does not answer: {problem}"
        )
        self.roscore_calls.submit(
            lambda: problem is None and self.roscore.ask(("deleteParam", program.IMPORTS)),
            lambda *_result: self.loop.stop(),
        )


def _claims(text: Any) -> Claims:
    """The claims of an earlier life, from the parameter server."""
    try:
        found = json.loads(text) if isinstance(text, str) else {}
        return {(node, uri): master for master, imports in found["imports"].items() for node, uri in imports.items()}
    except (ValueError, KeyError, AttributeError, TypeError):
        return {}


def _fetch(fetch: Fetch, sync_remote_nodes: bool) -> State:
    """The state of a master, filtered there where it can be."""
    rpc = Rpc(fetch.monitor_uri, FETCH_TIMEOUT, MAX_STATE)
    try:
        try:
            return parse(rpc.call("masterInfoFiltered", fetch.rules.to_wire(sync_remote_nodes)))
        except Fault:
            if "masterInfoFiltered" in rpc.call("system.listMethods"):
                raise
            return parse(rpc.call("masterInfo"))
    except Malformed as problem:
        raise ValueError(f"it sends no state of a master: {problem}") from None
    finally:
        rpc.close()


def _types_of(node_uri: str) -> Dict[str, str]:
    """Topic -> type, as a node of this robot has them."""
    rpc, found = Rpc(node_uri, QUESTION_TIMEOUT), {}
    try:
        for method in ("getPublications", "getSubscriptions"):
            answer = rpc.call(method, "/rosfleet")
            rows = answer[2] if isinstance(answer, list) and len(answer) == 3 and isinstance(answer[2], list) else []
            found.update({row[0]: row[1] for row in rows if _texts(row, 2)})
    finally:
        rpc.close()
    return found


def _md5sums(monitor_uri: str, types: List[str]) -> Tuple[Dict[str, str], Dict[str, str]]:
    """The md5 sums of types at another master, and here. Only types that an own node has named are imported."""
    rows = Rpc(monitor_uri, QUESTION_TIMEOUT).call("getTopicsMd5sum", types)
    there = {row[0]: row[1] for row in rows if _texts(row, 2)} if isinstance(rows, list) else {}
    here = {name: ros.md5sum(name) for name in types if name in there}
    return there, {name: md5sum for name, md5sum in here.items() if md5sum}


def _texts(row: Any, width: int) -> bool:
    return isinstance(row, list) and len(row) == width and all(isinstance(text, str) for text in row)


def _connections_with(look: Look, node_uri: str) -> Set[Connection]:
    """The connections of an own node with the nodes of a master."""
    answer = Rpc(node_uri, QUESTION_TIMEOUT).call("getBusInfo", "/rosfleet")
    return connections_of(answer[2] if isinstance(answer, list) and len(answer) == 3 else [], look.others)


def _end(ending: Ending) -> List[connections.Tcp]:
    return connections.end_all(lambda found: ending.wants(found.local[1], found.remote, found.silent))


if __name__ == "__main__":
    program.run(MasterSync().main)
