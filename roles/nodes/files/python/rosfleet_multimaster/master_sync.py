# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The node master_sync: registers what other masters have in the own roscore, and withdraws it again.

`python3 -m rosfleet_multimaster.master_sync [--parameters FILE.json] [name:=value ...]`
"""

import json
import threading
from typing import Any, Dict, List, Optional, Set, Tuple
from urllib.parse import urlsplit
from xmlrpc.client import Fault

from . import parameters, program, ros
from .filters import Filters
from .graph import Malformed, State, parse
from .sockets import Loop, Roscore, Rpc, Workers, monotonic, notify, wall_clock
from .sync_core import Announced, Claims, Fetch, Plan, Refusal, Registration, Sync, View, Wanted, calls, plan

FETCH_TIMEOUT = 20.0  # seconds
UPDATE_TIMEOUT = 3.0  # seconds
LIST_FIRST, LIST = 0.5, 10.0  # seconds between two looks at list_masters, until the first answer and then
HEALTH = 1.0  # seconds between two looks at whether the roscore is still the one
ROUND = 30.0  # seconds between two comparisons of what is wanted with what the roscore holds, if nothing happens
AGAIN = 1.0  # seconds after a failed round
LEFTOVERS = 15.0  # seconds that registrations of an earlier life wait for their master to be found again
LINES = 50  # log lines of one round


class Reading:
    """What the own roscore holds, as far as a round needs it."""

    def __init__(self, view: View, claims: Claims) -> None:
        self.view, self.claims = view, claims


class MasterSync:
    """The program."""

    def __init__(self) -> None:
        self.log = program.logger()
        self.limited = program.Limited(self.log)
        self.loop = Loop()
        self.fetchers = Workers(self.loop, 8)
        self.updaters = Workers(self.loop, 8)
        self.services = Workers(self.loop, 2)  # calls of rospy, which know no time limit
        self.master = Workers(self.loop, 1)  # everything that is asked of the own roscore, one after the other
        self.claims: Claims = {}
        self.held: Dict[Registration, str] = {}
        self.refused: Set[Refusal] = set()
        self.list_service = ""
        self.finding = self.listing = self.checking = self.working = False
        self.round_due: Optional[float] = None
        self.list_due = self.health_due = self.find_due = 0.0
        self.ready = False
        self.listed_once = False
        self.away = False
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
        keep = values["resync_on_reconnect_timeout"] if values["resync_on_reconnect"] else None
        self.core = Sync(
            Filters(values),
            self.uri,
            self.node_name,
            values["sync_remote_nodes"],
            values["sync_topics_on_demand"],
            keep,
        )
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
            self.master.submit(
                lambda: self.identity.check(service, *self.roscore.ask(*self.identity.calls())), self._checked
            )
        if not self.finding and now >= self.find_due:
            self.find_due, self.finding = now + (ROUND if self.list_service else LIST_FIRST), True
            self.master.submit(self._find, self._found)
        if self.list_service and not self.listing and now >= self.list_due:
            self.list_due, self.listing = now + (LIST if self.listed_once else LIST_FIRST), True
            self.services.submit(lambda service=self.list_service: ros.list_masters(service), self._listed)
        for fetch in self.core.due(now):
            self.fetchers.submit(
                lambda fetch=fetch: _fetch(fetch, self.core.sync_remote_nodes),
                lambda *result, fetch=fetch: self._fetched(fetch, *result),
            )
        gone = self.core.next_gone(now)
        if self.round_due is not None and now >= self.round_due and not self.working:
            self.round_due, self.working = None, True
            wanted = self.core.wanted(now)
            claims = dict(self.claims)
            self.master.submit(lambda: self._read(wanted, claims), self._read_done)
        due = [self.health_due, self.find_due, now + ROUND]
        due += [time for time in (self.core.next_due(), gone) if time is not None]
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
        elif problem is not None and not self.away:
            self.away = True
            self.log.error("the roscore at %s does not answer: %s", self.roscore.rpc.uri, problem)
        elif problem is None and self.away:
            self.away = False
            self.log.info("the roscore answers again")
            self._round(monotonic())

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
        now, before = monotonic(), len(self.core.remotes)
        self.core.listed(masters, now)
        if not self.listed_once or len(self.core.remotes) != before:
            self._round(now)
        self.listed_once = True

    def _announced(self, change: str, master: Announced) -> None:
        """A message of `~changes`."""
        now = monotonic()
        if change == "removed":
            self.met.add(master.uri)
            self.core.removed(master.uri)
            self._round(now)
        else:
            self.core.announced(master, now)
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
        # A node that provides a wanted service here matters too: is it one of ours?
        nodes = sorted({*nodes, *(user for name in names for user in services[name])})
        answers = self.roscore.ask(
            *[("lookupNode", node) for node in nodes], *[("lookupService", name) for name in names]
        )
        node_uris = {node: uri for node, uri in zip(nodes, answers) if isinstance(uri, str)}
        service_uris = {name: uri for name, uri in zip(names, answers[len(nodes) :]) if isinstance(uri, str)}
        return Reading(View(publishers, subscribers, services, dict(types), node_uris, service_uris), claims)

    def _read_done(self, reading: Optional[Reading], problem: Optional[Exception]) -> None:
        if reading is None:
            self._round_over(problem)
            return
        now, view = monotonic(), reading.view
        wanted = [] if self.ending else self.core.wanted(now, view.own_topics(reading.claims))
        if not self.ending and (now - self.started < LEFTOVERS or not self.listed_once):
            wanted += self._leftovers(reading)
        todo = plan(wanted, view, reading.claims)
        before = view.registrations(reading.claims)
        # Reported before it is visible in the roscore, so that discovery never takes it for the robot's own.
        self.held = {**{item: reading.claims[item.of] for item in before}, **todo.held}
        types = {**self.core.types(), **{topic: kind for topic, kind in view.types.items() if kind != "*"}}
        self.master.submit(
            lambda: self._write(todo, types, reading.claims),
            lambda results, why: self._written(todo, reading.claims, results, why),
        )

    def _leftovers(self, reading: Reading) -> List[Wanted]:
        """Registrations of an earlier life whose masters have not been found again yet."""
        keep = {key: uri for key, uri in reading.claims.items() if uri not in self.met}
        return [Wanted(item, keep[item.of], keep[item.of]) for item in sorted(reading.view.registrations(keep))]

    def _write(self, todo: Plan, types: Dict[str, str], claims: Claims) -> List[Any]:
        """In the thread of the roscore: one request, the claims first."""
        record: List[Tuple[Any, ...]] = []
        if todo.claims != claims:
            record = [("setParam", program.IMPORTS, self._record(todo.claims))]
        made = [(call[0], *call[1:]) for call in calls(todo, types)]
        results = self.roscore.rpc.multicall([(call[0], self.node_name, *call[1:]) for call in record] + made)
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
        """A roscore tells only the caller who publishes; the subscriber itself is on another robot.

        It keeps the publishers of its own robot: roscpp closes the connections to those that are not in the list.
        """
        uris = list(dict.fromkeys([*publishers, *self.core.publishers_of(item.name, master)]))
        if publishers:
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
        self._round(
            now + (AGAIN if problem is not None or self.claims.keys() - {item.of for item in self.held} else ROUND)
        )
        if problem is None and self.listed_once and not self.ready:
            self.ready = True
            notify("READY=1")
        self._say_status()

    # What people see

    def _report(self, refused: List[Refusal]) -> None:
        now_refused = set(refused)
        for item in refused:
            if item not in self.refused:
                text = "%s: the %s %s at %s is refused: here it is %s. Give one of them another name, or ignore it"
                self.log.warning(text, item.master, item.kind, item.name, item.uri, item.holder)
        for item in self.refused - now_refused:
            self.log.info("%s: the %s %s is no longer refused", item.master, item.kind, item.name)
        if now_refused != self.refused:
            texts = [
                (f"{item.kind} {item.name}", f"{item.uri} of {item.master} is refused, here it is {item.holder}")
                for item in refused
            ]
            self.node.diagnose(texts, self.node_name, wall_clock())
        self.refused = now_refused

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
        self.master.submit(lambda: self._read([], claims), self._read_done)

    def _withdrawn(self, problem: Optional[Exception]) -> None:
        if self.held and problem is None:  # the round that was under way registered something
            self._withdraw()
            return
        self.farewell = (
            "withdrawn" if problem is None else f"nothing is withdrawn, the roscore does not answer: {problem}"
        )
        self.master.submit(
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
    rpc = Rpc(fetch.monitor_uri, FETCH_TIMEOUT)
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


if __name__ == "__main__":
    program.run(MasterSync().main)
