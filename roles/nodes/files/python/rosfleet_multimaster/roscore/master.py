# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""rosmaster, in this process: the only file that imports it. Its XML-RPC interface is as it was.

Its lock, its tables of registrations and its pool of workers are ours here. So each change is noted by the code that makes it, and all
changes of one call are handed on together before the caller has its answer.
"""

import contextlib
import json
import logging
import sys
import threading
from itertools import chain, islice
from socket import socket as Socket
from typing import Any, Callable, Collection, Dict, Iterator, List, Mapping, NamedTuple, Optional, Set, Tuple

import rosgraph.names
import rosgraph.network
import rosgraph.xmlrpc
from rosmaster import master_api, paramserver, registrations

from ..edge import addresses
from ..edge.clock import monotonic
from ..edge.loop import start_thread
from ..edge.roscore import TOGETHER
from ..protocol import imports, json_text
from ..protocol.plain_text import plain, quote
from ..protocol.tcpros.hosts import host_of
from . import programs
from .core.bounds import BOUNDS, BoundRefusal, Usage, check_names, is_writable, refuse, weigh
from .core.holdings import Change, Holdings
from .core.name_guard import NameGuard
from .core.notifications import NodeCall
from .core.owners import Node, inner, owner_of
from .core.registry import Record, Registry, node_of, split_name, touches
from .door import Caller, Door, Handler, multicall
from .notifier import Notifier
from .refusals import Refusals

_log = logging.getLogger("rosfleet.master")

#: method that registers something -> the kind of its record, and the index of the URI of the calling node in its arguments
_REGISTERS = {
    "registerPublisher": ("publisher", 3),
    "registerSubscriber": ("subscriber", 3),
    "registerService": ("service", 3),
    "subscribeParam": ("listener", 1),
}
#: methods that change something; for each that registers, there is one that takes it back
CHANGES = {*_REGISTERS, *(f"un{method}" for method in _REGISTERS), "setParam", "deleteParam"}
_RESERVED = "/" + imports.IMPORTS.split("/")[1]  # only the collection sets values below it
PART = 200  # records that are read at once
TYPES_AGAIN = 5.0  # seconds until types are looked through again
MOST_ENDERS = 1000  # nodes to be ended
RESOLVE = 2.0  # seconds to find the addresses of a node
_LISTS = {  # of a node in rosmaster
    "publisher": "topic_publications",
    "subscriber": "topic_subscriptions",
    "listener": "param_subscriptions",
    "service": "services",
}

Note = Callable[[Record], None]


class _Table(registrations.Registrations):  # type: ignore[misc]  # rosmaster has no types
    """Registrations of one kind, which note their changes."""

    def __init__(self, kind: str, number: int, note: Note, confirm: Note) -> None:
        """`kind`: of the records; `number`: the kind in rosmaster."""
        super().__init__(number)
        self.kind, self._note, self._confirm = kind, note, confirm

    def register(self, key: str, node: str, node_uri: str, service_uri: Optional[str] = None) -> None:
        """As rosmaster's."""
        old = (self.map.get(key), (self.service_api_map or {}).get(key)) if service_uri else len(self.map.get(key, ()))
        super().register(key, node, node_uri, service_uri)
        known = old == ((self.map[key], self.service_api_map[key]) if service_uri else len(self.map[key]))
        record = self._record(key, node, node_uri, service_uri, True)
        self._confirm(record)
        if not known:
            self._note(record)

    def unregister(self, key: str, node: str, node_uri: str, service_uri: Optional[str] = None) -> Any:
        """As rosmaster's."""
        result = super().unregister(key, node, node_uri, service_uri)
        if result[2] == 1:
            self._note(self._record(key, node, node_uri, service_uri, False))
        return result

    def unregister_all(self, node: str) -> None:
        """As rosmaster's."""
        uris = dict(self.service_api_map or {})
        ends = [(key, uri) for key, users in self.map.items() for name, uri in users if name == node]
        super().unregister_all(node)
        for key, node_uri in ends:
            self._note(self._record(key, node, node_uri, uris.get(key, ("", ""))[1], False))

    def _record(self, key: str, node: str, node_uri: str, service_uri: Optional[str], there: bool) -> Record:
        if self.kind == "service":
            return Record("service", key, node, node_uri or "", service_uri or "", there=there)
        return Record(self.kind, key, node, node_uri, there=there)


class _Values(Dict[str, Any]):
    """The nodes, or the types of topics, which note their changes."""

    def __init__(self, kind: str, note: Note) -> None:
        super().__init__()
        self._kind, self._note = kind, note

    def __setitem__(self, name: str, value: Any) -> None:
        known = self.get(name) == value
        super().__setitem__(name, value)
        if not known:
            self._note(self._record(name, getattr(value, "api", value)))

    def __delitem__(self, name: str) -> None:
        super().__delitem__(name)
        self._note(self._record(name, ""))

    def _record(self, name: str, value: Any) -> Record:
        return Record("node", name, uri=value) if self._kind == "node" else Record("type", name, value=value)


class _Manager(registrations.RegistrationManager):  # type: ignore[misc]
    """rosmaster's registrations. The subscribers of a node that loses its name are notified."""

    def __init__(self, pool: Any, note: Note, confirm: Note, lost: Callable[[List[str]], None]) -> None:
        super().__init__(pool)
        self.nodes = _Values("node", note)
        kinds = registrations.Registrations
        self.publishers = _Table("publisher", kinds.TOPIC_PUBLICATIONS, note, confirm)
        self.subscribers = _Table("subscriber", kinds.TOPIC_SUBSCRIPTIONS, note, confirm)
        self.services = _Table("service", kinds.SERVICE, note, confirm)
        self.param_subscribers = _Table("listener", kinds.PARAM_SUBSCRIPTIONS, note, confirm)
        self._lost = lost

    def _register(self, table: Any, key: str, node: str, node_uri: str, service_uri: Optional[str] = None) -> None:
        before = self.nodes.get(node)
        topics = list(before.topic_publications) if before is not None and before.api != node_uri else []
        super()._register(table, key, node, node_uri, service_uri)
        self._lost(topics)


class _Pool:
    """The replacement of rosmaster's pool of threads."""

    def __init__(self, notifier: Notifier, is_spared: Callable[[str, str], bool]) -> None:
        self._notifier, self._is_spared = notifier, is_spared

    def queue_task(self, _marker: str, task: Any, arguments: Tuple[Any, ...]) -> bool:
        """Queue a call of a node. rosmaster holds the lock of the registrations."""
        name = getattr(task, "__name__", "")
        if name == "param_update_task":
            _node, uri, key, value = arguments
            self._notifier.notify(uri, "paramUpdate", key, (key, copy_tree(value)))
        elif name == "publisher_update_task":
            uri, topic, uris = arguments
            self._notifier.notify(uri, "publisherUpdate", topic, (topic, uris))
        elif name == "shutdown_node_task":
            uri, node, reason = arguments
            if not self._is_spared(node, uri):
                self._notifier.notify(uri, "shutdown", node, (f"[{node}] Reason: {reason}",))
        return True

    def join_all(self, **_options: bool) -> None:
        """The workers end with the process."""


class Callbacks(NamedTuple):
    """The functions that the master calls in the thread of a request."""

    on_changes: Callable[[List[Record]], None]  # the changes of a call; the lock of the registrations is held
    on_leaving: Callable[[str, str], None]  # a node, by name and URI, has withdrawn everything
    wait: Callable[[], None]  # before a change; raises BoundRefusal if there is no room for it now


class MasterMethods(master_api.ROSMasterHandler):  # type: ignore[misc]
    """The methods of rosmaster, and `more`. Clients can call no other names."""

    def __init__(
        self,
        watched: Tuple[str, ...],
        callbacks: Callbacks,
        refusals: Refusals,
    ) -> None:
        """`watched`: parameters whose changes are reported; IMPORTS is one of them."""
        super().__init__(0)
        self.guard = NameGuard()
        self._spare = False
        self._records: List[Record] = []
        self._last: Dict[str, Any] = dict.fromkeys(watched)
        self.calls = threading.local()
        self._restored: Dict[Tuple[Any, ...], None] = {}  # of before a restart, until nodes confirm them
        self._notifier = Notifier(self._may_notify)
        # (URI, name) of a node to be ended -> addresses of callers, and whether they are own ones
        self._enders: Dict[Tuple[str, str], Set[Tuple[str, bool]]] = {}
        self._types_due = 0.0
        self.callbacks, self.refusals = callbacks, refusals
        self.more: Dict[str, Callable[..., Any]] = {
            "system.listMethods": lambda: sorted([*self._known, *self.more]),
            "system.multicall": lambda calls: multicall(self.answer, calls, self.caller().pause),
            TOGETHER: self._run_together,
        }

        self.usage, self.holdings = Usage(), Holdings()
        self.thread_pool = _Pool(self._notifier, self._is_spared)
        self.ps_lock = threading.RLock()  # of the registrations
        self._depth = 0  # how often its holder changes something, one within the other
        self.reg_manager = _Manager(self.thread_pool, self._note, self._confirm, self._notify_topics)
        self.publishers, self.subscribers = self.reg_manager.publishers, self.reg_manager.subscribers
        self.services, self.param_subscribers = self.reg_manager.services, self.reg_manager.param_subscribers
        tables = (self.publishers, self.subscribers, self.param_subscribers, self.services)
        self._tables = {table.kind: table for table in tables}
        self.topics_types = _Values("type", self._note)
        self.param_server = paramserver.ParamDictionary(self.reg_manager)
        self._known = {
            name
            for name in dir(master_api.ROSMasterHandler)
            if not name.startswith("_") and name != "param_update_task"
            if callable(getattr(master_api.ROSMasterHandler, name))
        }

    # Calls

    def answer(self, name: str, arguments: Tuple[Any, ...]) -> Any:
        """Answer a call of a client, also one in a multicall. A call that exceeds a bound has an answer that says so."""
        try:
            if name in CHANGES or name == TOGETHER:
                self.callbacks.wait()
            return self.call(name, *arguments)
        except BoundRefusal as problem:
            self.refusals.add(problem)
            return -1, str(problem), 0

    def call(self, name: str, *arguments: Any) -> Any:
        """Make a call, also one of this process itself. Raises BoundRefusal."""
        if name in self.more:
            return self.more[name](*arguments)
        if name not in self._known:
            raise Exception(f'method "{name}" is not supported')  # in the words of the standard library
        if name in CHANGES:
            with self._collect_changes():
                return self._change(name, arguments)
        if name == "getParam":
            with self.ps_lock:  # its answer is a part of the tree, which changes while it is written
                code, text, value = getattr(self, name)(*arguments)
                return code, text, copy_tree(value)
        return getattr(self, name)(*arguments)

    def _run_together(self, _caller_id: str, texts: List[str]) -> Any:
        """Carry out changes, [method, caller, argument, ...], in texts of JSON. The results come in such texts, too.

        The changes of one text are made together: no other call comes between them, and they are handed on at once.
        """
        if not self.caller().is_own:
            return -1, "only programs of this computer may use it", 0
        try:
            parts = [_read_calls(text) for text in texts]
        except BoundRefusal:
            raise
        except (ValueError, TypeError, RecursionError) as problem:
            return -1, f"expected: texts of JSON, each a list of calls: {plain(problem)}", 0
        answers: List[str] = []
        for calls in parts:
            results = self._run_calls(calls, BOUNDS["answer"].most - sum(map(len, answers)))
            answers.append(json.dumps(results, default=str))
        return 1, "", answers

    def _run_calls(self, calls: List[Any], left: int) -> List[Any]:
        """The results; of a call that fails, a text that says why. Raises BoundRefusal, after a change, if they weigh more."""
        results: List[Any] = []
        with self._collect_changes():
            for name, *arguments in calls:
                try:
                    if name not in CHANGES:
                        raise ValueError(f"{name} changes nothing")
                    results.append(self.call(name, *arguments))
                except BoundRefusal as refusal:
                    self.refusals.add(refusal)
                    results.append((-1, str(refusal), 0))
                except Exception as problem:  # as in a multicall: one that fails does not end the others
                    results.append(f"{type(problem).__name__}: {problem}")
                left -= weigh(results[-1])
                if left < 0:
                    raise refuse("answer", "the answer")
        return results

    def caller(self) -> Caller:
        return getattr(self.calls, "caller", Caller())

    def set_robots(self, robots: Collection[str]) -> None:
        """Keep a part of the memory for each of these robots."""
        with self.ps_lock:
            self.holdings.set_robots(robots)

    def _note(self, record: Record) -> None:
        record = record._replace(by=self.caller().other) if record.is_there else record
        self._records.append(record)
        self.holdings.note(record, self.usage.count(record))

    def _change(self, name: str, arguments: Tuple[Any, ...]) -> Any:
        check_names(arguments[:-1] if name == "setParam" else arguments)
        self._check_bounds(name, arguments)
        key = _find_parameter(name, arguments)
        arguments = self._protect(name, key, arguments)
        change = self._plan_parameters(name, key, arguments)
        _kind, at = _REGISTERS.get(name, ("", 0))
        if at and len(arguments) > at and all(isinstance(arguments[place], str) for place in (0, at)):
            refusal = self._refusal(arguments[0], arguments[at])
            if refusal:
                return -1, refusal, 0
        try:
            code, text, value = getattr(self, name)(*arguments)
        finally:
            self._spare = False
        if code == 1:
            self.usage.parameters += change.total
            self.holdings.apply(change)
            self._note_change(name, key, arguments)
        elif code == 0 and change.growth:
            self._recount(change)
        return code, text, copy_tree(value)

    def _recount(self, change: Change) -> None:
        """Count the parameters anew: rosmaster failed, before it had changed something or after that."""
        before, self.usage.parameters = self.usage.parameters, weigh(self.param_server.parameters)
        if before != self.usage.parameters:
            self.holdings.apply(change)
        self.holdings.recount(self.param_server.parameters)

    def _note_change(self, name: str, key: str, arguments: Tuple[Any, ...]) -> None:
        """Note the changes of a call. `key`: the parameter that it has set or deleted, or ""."""
        if key:
            self._note_parameter(
                key,
                Record("set", key, value=arguments[2], by=self.caller().other)
                if name == "setParam"
                else Record("delete", key),
            )
        elif name in _REGISTERS:
            self._note_caller(arguments[0])
        if name.startswith("unregister") and self.has_ended(arguments[0]):
            self.callbacks.on_leaving(arguments[0], self.reg_manager.nodes[arguments[0]].api)

    def _plan_parameters(self, name: str, key: str, arguments: Tuple[Any, ...]) -> Change:
        """The weight that a call adds to the parameters of each robot. Raises BoundRefusal. rosmaster answers wrong arguments."""
        if not key:
            return Change({})
        tree = self.param_server.parameters
        if name == "deleteParam":
            return self.holdings.plan_delete(tree, key)
        value = arguments[2]
        change = self.holdings.plan_set(tree, key, self.usage.growth(tree, key, value), self.caller().other)
        for watched in self._last:
            if touches(key, watched):
                part = value if split_name(key) else dict(value).get(split_name(watched)[0]) if value else None
                if weigh(part) > BOUNDS["watched"].most:
                    raise refuse("watched", watched)
        return change

    def _check_bounds(self, name: str, arguments: Tuple[Any, ...]) -> None:
        """Raise BoundRefusal if there is no room for a new registration."""
        kind, at = _REGISTERS.get(name, ("", 0))
        if not kind or len(arguments) <= at or not all(isinstance(text, str) for text in arguments):
            return
        node, uri, key = arguments[0], arguments[at], arguments[2 if kind == "listener" else 1]
        key = rosgraph.names.resolve_name(key, node) + ("/" if kind == "listener" else "")
        users = self._tables[kind].map.get(key, ())
        many = kind != "service" and len(users) >= BOUNDS["users"].most
        if (node, uri) in users:
            return
        robot = self.caller().other
        if many or self.usage.is_full(*arguments) or not self.holdings.have_room(robot, *arguments):
            self._forget_types()
            if self.usage.is_full(*arguments):
                raise refuse("registrations", key)
            if many:
                raise refuse("users", key)
            self.holdings.check(robot, key, *arguments)

    def _forget_types(self) -> None:
        """Forget the types of unused topics, which rosmaster keeps for ever."""
        if monotonic() < self._types_due:
            return
        self._types_due = monotonic() + TYPES_AGAIN
        for topic in list(self.topics_types):
            if topic not in self.publishers.map and topic not in self.subscribers.map:
                del self.topics_types[topic]

    def _protect(self, name: str, key: str, arguments: Tuple[Any, ...]) -> Tuple[Any, ...]:
        """The arguments, with the values below the collection's own name as they are: others may not set it. Raises BoundRefusal."""
        if not key or not touches(key, _RESERVED) or self._is_own_program():
            return arguments
        own = self._value(_RESERVED)
        if split_name(key):
            if name == "setParam" and arguments[2] == self._value(key):
                return arguments
            raise BoundRefusal(f"{key} is set only by master_sync of this computer", "own")
        if name != "setParam" or not isinstance(arguments[2], dict):
            return arguments
        tree = {part: value for part, value in arguments[2].items() if part.strip("/") != _RESERVED[1:]}
        return (*arguments[:2], tree if own is None else {**tree, _RESERVED[1:]: own})

    def _is_own_program(self) -> bool:
        caller = self.caller()
        return not caller.address or (caller.is_own and programs.is_own(*caller.ends))

    def _note_caller(self, name: str) -> None:
        """Note the address from which a node was registered first: it may be ended from there."""
        node = self.reg_manager.nodes.get(name)
        if node is not None and not hasattr(node, "by"):
            node.by = (self.caller().address, self.caller().is_own)

    def _is_spared(self, name: str, uri: str) -> bool:
        """True if a node that loses its name is not to be ended at all."""
        by = getattr(self.reg_manager.nodes.get(name), "by", ("", False))
        if len(self._enders) >= MOST_ENDERS:
            self._enders.clear()
        self._enders[uri, name] = {by, (self.caller().address, self.caller().is_own)}
        return self._spare

    def _may_notify(self, call: NodeCall) -> bool:
        """True if a node may get that. It runs in the notifier's thread.

        A node is ended only on the computer from which it or its successor was registered. Else two registrations in the name
        of any node would have this roscore end that node, on any robot.
        """
        if call.method != "shutdown":
            return True
        callers = self._enders.get((call.uri, call.key[1]), set())
        if any(own for _address, own in callers) and addresses.local_uris([call.uri], RESOLVE):
            return True
        host = host_of(call.uri)
        if addresses.addresses_of_all([host]).get(host) in {address for address, _own in callers}:
            return True
        text = "is not asked to end: neither it nor its successor was registered from its computer"
        self.refusals.say("end", f"{quote(call.key[1])} at {quote(call.uri)} {text}")
        return False

    def _refusal(self, node: str, uri: str) -> str:
        present = self.reg_manager.nodes.get(node)
        holder = present.api if present is not None else ""
        verdict = self.guard.judge(node, holder, uri, monotonic())
        self._spare = verdict.spared
        if verdict.import_lost:
            self._note_refusal(node, holder, f"an own node at {quote(uri)} has taken the name")
        if verdict.refusal:
            self._note_refusal(node, uri, verdict.refusal)
            return f"refused: {verdict.refusal}"
        return ""

    def _note_refusal(self, node: str, uri: str, why: str) -> None:
        self._records.append(Record("refused", node, uri=uri, value=why))

    def _note_parameter(self, key: str, record: Record) -> None:
        """Note that a parameter was set or deleted."""
        self._records.append(record)
        for watched, last in self._last.items():
            if touches(key, watched):
                value = self._value(watched)
                if value != last:
                    self._last[watched] = value
                    self._records.append(Record("parameter", watched, value=value))
                    if watched == imports.IMPORTS:
                        self.guard.set_imports(imports.read(value).claims)

    def _value(self, name: str) -> Any:
        try:
            return copy_tree(self.param_server.get_param(name))
        except KeyError:
            return None

    # Changes

    def _confirm(self, record: Record) -> None:
        """Note that a registration was made, or made again by its node."""
        if self._restored:
            self._restored.pop(_find_restored(record), None)

    @contextlib.contextmanager
    def _collect_changes(self) -> Iterator[None]:
        """Hold the lock. Changes are handed on before it is free."""
        with self.ps_lock:
            self._depth += 1
            try:
                yield
            finally:
                self._depth -= 1
                if not self._depth:
                    self._commit()

    def _commit(self) -> None:
        """Hand on the changes; the lock is about to be free."""
        if self._records:
            records = self._records[:]
            self._records.clear()
            for record in records:
                if record.kind == "node" and not record.uri:
                    self.guard.forget(record.name)
            self.callbacks.on_changes(records)

    def _notify_topics(self, topics: List[str]) -> None:
        for topic in topics:
            self._notify_topic_subscribers(topic, self.publishers.get_apis(topic), self.subscribers.get_apis(topic))

    def records(self) -> Iterator[Record]:
        """All registrations, as records. The lock is held while one is read; in between they may change."""
        for record in self._list_registrations():
            maker = self.holdings.find_maker(record)
            yield record if maker is None else record._replace(by=maker)

    def _list_registrations(self) -> Iterator[Record]:
        for topic, kind in list(self.topics_types.items()):
            yield Record("type", topic, value=kind)
        for name, reference in list(self.reg_manager.nodes.items()):
            yield Record("node", name, uri=reference.api)
        for table in (self.publishers, self.subscribers, self.param_subscribers):
            for key, users in list(table.map.items()):
                for node in list(users):
                    yield Record(table.kind, key, *node)
        uris = dict(self.services.service_api_map or {})
        for service, users in list(self.services.map.items()):
            if service in uris and users:
                name, uri = users[0]
                yield Record("service", service, name, uri, uris[service][1])

    def parameters(self) -> List[Record]:
        """The parameters whose changes are reported, with their values."""
        return [Record("parameter", name, value=value) for name, value in self._last.items()]

    def parts(self) -> Iterator[List[Record]]:
        """All that this master knows, a few records at a time: no call waits long for the lock.

        Changes that come meanwhile may be in it or not. With all of them carried out after it, the whole is right.
        """
        owned = self.holdings.owners.find(())
        parameters = _list_records("", self.param_server.parameters, owned)
        records = chain([Record("set", "/", value={})], parameters, self.records())
        while True:
            with self.ps_lock:
                part = list(islice(records, PART))
            if not part:
                return
            yield part

    # After a start

    def restore(self, registry: Registry) -> None:
        """Take the knowledge of an earlier life. Call it before the first request."""
        manager = self.reg_manager
        with self._collect_changes():
            for node in registry.values("node").items():
                self._node(*node)
            self.param_server.parameters.update(registry.parameters)  # the server has no parameters yet
            for record in registry.facts.values():
                kind, key = record.kind, record.name
                if kind == "type":
                    self.topics_types[key] = record.value
                elif kind != "node":
                    name, uri = node_of(record)
                    if kind == "service":
                        self.services.register(key, name, uri, record.place)
                    else:  # as its method does, without a search for each
                        self._tables[kind].map.setdefault(key, []).append((name, uri))
                    getattr(self._node(name, uri), _LISTS[kind]).append(key)
                    self._restored[_find_restored(record)] = None
            for topic in self.publishers.map:  # rosmaster lists no topics if one of them has no type
                self.topics_types.setdefault(topic, "*")
            for watched in self._last:
                self._last[watched] = self._value(watched)
            self.guard.set_imports(imports.read(self._last[imports.IMPORTS]).claims)
            for name, node in manager.nodes.items():
                self.guard.judge(name, "", node.api, monotonic())
            self._records.clear()
            self.usage = Usage()
            self.usage.parameters = weigh(registry.parameters)
            self.holdings.restore(registry.facts.values(), registry.owners)
            self.holdings.recount(registry.parameters)
            for record in self.records():
                self.holdings.note(record, self.usage.count(record))

    def _node(self, name: str, uri: str) -> Any:
        nodes = self.reg_manager.nodes
        if name not in nodes:
            nodes[name] = registrations.NodeRef(name, uri)
        return nodes[name]

    def notify_all(self) -> None:
        """Notify every node of changes that it may have missed: the queue of the earlier life is lost."""
        with self.ps_lock:
            self._notify_topics(list(self.subscribers.map))
            for key, users in self.param_subscribers.map.items():
                value = self._value(key)
                for _name, uri in users:
                    self._notifier.notify(uri, "paramUpdate", key, (key, {} if value is None else value))

    def readmit(self, registry: Registry) -> None:
        """Register nodes as if they did it themselves, and send them the answers. A name that is taken stays with its node."""
        types, caller = registry.values("type"), self.caller()
        with self._collect_changes():
            for record in registry.facts.values():
                name, uri = node_of(record)
                if record.kind == "type" or (name in self.reg_manager.nodes and not self.has(name, uri)):
                    continue
                self.calls.caller = Caller(other=record.by)  # whose share it is
                try:
                    self._readmit_one(record, types)
                except BoundRefusal as refusal:  # of a robot that has filled its share since: the others come back
                    self.refusals.add(refusal)
                finally:
                    self.calls.caller = caller

    def _readmit_one(self, record: Record, types: Mapping[str, str]) -> None:
        """Make a registration of an earlier life. Raises BoundRefusal."""
        kind, key = record.kind, record.name
        name, uri = node_of(record)
        if kind in ("publisher", "subscriber"):
            uris = self.call(f"register{kind.capitalize()}", name, key, types.get(key, "*"), uri)[2]
            if kind == "subscriber":
                self._notifier.notify(uri, "publisherUpdate", key, (key, uris))
        elif kind == "service" and key not in self.services.map:
            self.call("registerService", name, key, record.place, uri)
        elif kind == "listener":
            value = self.call("subscribeParam", name, uri, key)[2]
            self._notifier.notify(uri, "paramUpdate", key, (key, value))

    def has(self, name: str, uri: str) -> bool:
        """True while this node has the name."""
        node = self.reg_manager.nodes.get(name)
        return node is not None and node.api == uri

    def end_node(self, name: str, uri: str) -> None:
        """End a node that is dead, or whose port has another owner. Its registrations since the restart stay."""
        with self._collect_changes():
            if not self.has(name, uri):
                return
            node, services = self.reg_manager.nodes[name], self.services.service_api_map or {}
            for kind, keys in _LISTS.items():  # only its own: all nodes may have a hundred thousand
                for key in list(getattr(node, keys)):
                    place = services.get(key, ("", ""))[1] if kind == "service" else uri
                    self.end_registration(Record(kind, key, name, uri, place))
            if self.has(name, uri) and self.reg_manager.nodes[name].is_empty():
                del self.reg_manager.nodes[name]

    def has_ended(self, name: str) -> bool:
        """True if a known node has withdrawn everything: it may have ended.

        rospy and roscpp leave their parameter subscriptions, and rosmaster leaves services that a later node has taken.
        So the names of such nodes, also of imports, would never be free.
        """
        node = self.reg_manager.nodes.get(name)
        if node is None or node.topic_publications or node.topic_subscriptions:
            return False
        return all((name, node.api) not in self.services.map.get(service, ()) for service in node.services)

    def bury(self, name: str, uri: str) -> None:
        """End a dead node that had withdrawn everything."""
        with self._collect_changes():
            if self.has(name, uri) and self.has_ended(name):
                node = self.reg_manager.nodes[name]
                for key in list(node.param_subscriptions):
                    self.reg_manager.unregister_param_subscriber(key, name, uri)
                if self.has(name, uri):
                    del self.reg_manager.nodes[name]

    def end_registration(self, record: Record) -> bool:
        """End a restored registration, unless it was made again since. Whether it was there."""
        kind, key, name, uri = found = _find_restored(record)
        with self._collect_changes():
            if found not in self._restored:
                return False
            del self._restored[found]
            ends = (None, uri) if kind == "service" else (uri,)  # of the node, and of the service
            self.reg_manager._unregister(self._tables[kind], key, name, *ends)
            if kind == "publisher":
                self._notify_topics([key])
        return True


def _find_restored(record: Record) -> Tuple[str, str, str, str]:
    """The key of a restored registration: its URI is that of the service, or of the node."""
    return record.kind, record.name, record.node, record.place if record.kind == "service" else record.uri


def _read_calls(text: str) -> List[Any]:
    """The calls in a text of JSON. Raises ValueError."""
    calls = json_text.from_json(text) if isinstance(text, str) else None
    if not isinstance(calls, list) or not all(isinstance(call, list) and call for call in calls):
        raise ValueError("something else")
    if len(calls) > BOUNDS["together"].most:
        raise refuse("together", f"a text with {len(calls):,} calls")
    if not is_writable(calls):
        raise ValueError("a text with characters that XML has not")
    return calls


def _find_parameter(name: str, arguments: Tuple[Any, ...]) -> str:
    """The name of the parameter in setParam or deleteParam; "" in other calls, and in wrong ones."""
    if len(arguments) != {"setParam": 3, "deleteParam": 2}.get(name):
        return ""
    if not all(isinstance(text, str) for text in arguments[:2]) or not arguments[1]:
        return ""
    return str(rosgraph.names.resolve_name(arguments[1], arguments[0]))


def _list_records(name: str, tree: Dict[str, Any], owners: Node) -> Iterator[Record]:
    """The records of a tree of parameters: one for each value, so that the lines of the store stay short."""
    if not tree or any(not key or "/" in key for key in tree):  # no path leads to such a member
        yield Record("set", name or "/", value=copy_tree(tree), by=owner_of(owners))
        return
    for key, value in list(tree.items()):
        below = inner(owners, key)
        if isinstance(value, dict):
            yield from _list_records(f"{name}/{key}", value, below)
        else:
            yield Record("set", f"{name}/{key}", value=value, by=owner_of(below))


def copy_tree(value: Any) -> Any:
    """A copy of the mappings in a value: those of rosmaster change."""
    return {key: copy_tree(part) for key, part in value.items()} if isinstance(value, dict) else value


def serve(
    master: MasterMethods,
    port: int,
    sockets: List[Socket],
    more: Mapping[str, Callable[..., Any]],
    robot_at: Callable[[str], str],
) -> Tuple[str, Socket]:
    """Answer calls from now on; the URI and the socket. A fitting one of these open sockets is used. Raises OSError.

    `robot_at(address)`: which robot has another computer.
    """
    master.more.update(more)
    door = Door(master.answer, master.refusals.add, master.calls, robot_at)
    server = _Server(door, sockets, (rosgraph.network.get_bind_address(), port))
    master.uri = rosgraph.network.create_local_xmlrpc_uri(server.server_address[1])
    start_thread("server", server.serve_forever)
    return str(master.uri), server.socket


class _Server(rosgraph.xmlrpc.ThreadingXMLRPCServer):  # type: ignore[misc]
    """rosgraph's server, on a socket that systemd may have held."""

    socket: Socket
    server_address: Any

    def __init__(self, door: Door, sockets: List[Socket], address: Tuple[str, int]) -> None:
        self.door, self.sockets = door, sockets
        super().__init__(address)
        base = rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler
        version = getattr(base, "protocol_version", "HTTP/1.0")  # rosgraph knows which kernels are slow
        self.RequestHandlerClass = type("_Handler", (Handler,), {"door": door, "protocol_version": version})

    def server_bind(self) -> None:
        """Take the socket that systemd held, or open one."""
        for other in self.sockets:
            if other.family == self.address_family and other.getsockname()[:2] == self.server_address[:2]:
                self.socket.close()
                self.socket, self.server_address = other, other.getsockname()
                return
        super().server_bind()

    def verify_request(self, request: Socket, client_address: Any) -> bool:
        """True if there is room for this connection."""
        caller = Caller(client_address[0], request.getsockname()[0])
        return self.door.connections.add(request, self.door.find_robot(caller))

    def shutdown_request(self, request: Socket) -> None:
        """Forget a connection that has ended."""
        self.door.connections.remove(request)
        super().shutdown_request(request)

    def handle_error(self, _request: Any, client_address: Any) -> None:
        """Log a connection that breaks: it is no fault of this program."""
        _log.debug("a connection of %s broke: %s", client_address, sys.exc_info()[1])
