# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""rosmaster, in this process: the only file that imports it. Its XML-RPC interface is as it was.

What it calls at its places is ours here: the lock, the tables of registrations, the pool of workers. So each change is
seen where it is made, and all changes of one call are handed on together before the caller has its answer.
"""

import json
import logging
import socket
import sys
import threading
from functools import partial
from itertools import chain, islice
from socket import socket as Socket
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Set, Tuple

import rosgraph.names
import rosgraph.network
import rosgraph.xmlrpc
from rosmaster import master_api, paramserver, registrations

from ..edge import addresses
from ..edge.clock import monotonic
from ..edge.roscore import TOGETHER
from ..protocol import json_text
from ..protocol.plain_text import plain, quote
from . import programs
from .core.bounds import BOUNDS, Refusal, Usage, check_names, is_writable, refuse, weigh, weigh_parameter
from .core.name_guard import NameGuard
from .core.notifications import Call
from .core.registry import NodeKey, Record, Registry, split_name, touches
from .door import Caller, Door, Handler, multicall
from .notifier import Notifier

_log = logging.getLogger("rosfleet.master")

#: what changes something -> where the URI of the calling node stands in its arguments
CHANGES = {
    "registerPublisher": 3,
    "registerSubscriber": 3,
    "registerService": 3,
    "subscribeParam": 1,
    "unregisterPublisher": 0,
    "unregisterSubscriber": 0,
    "unregisterService": 0,
    "unsubscribeParam": 0,
    "setParam": 0,
    "deleteParam": 0,
}
_REGISTERS = {
    "registerPublisher": "publishers",
    "registerSubscriber": "subscribers",
    "registerService": "services",
    "subscribeParam": "param_subscribers",
}
PART = 200  # records that are read at once
TYPES_AGAIN = 5.0  # seconds until types are looked through again
MOST_ENDERS = 1000  # nodes that are to be ended
RESOLVE = 2.0  # seconds to find out where a node is
_READ_TREES = ("getParam",)  # their answers have parts of the tree, which changes while they are written
_KINDS = {
    registrations.Registrations.TOPIC_PUBLICATIONS: "publisher",
    registrations.Registrations.TOPIC_SUBSCRIPTIONS: "subscriber",
    registrations.Registrations.PARAM_SUBSCRIPTIONS: "listener",
    registrations.Registrations.SERVICE: "service",
}
_UNREGISTER = {
    "publisher": "unregister_publisher",
    "subscriber": "unregister_subscriber",
    "listener": "unregister_param_subscriber",
    "service": "unregister_service",
}
_TELLING = {"publisher_update_task": "publisherUpdate", "shutdown_node_task": "shutdown"}

Note = Callable[[Record], None]


class Lock:
    """The lock of the registrations. Who holds it may take it again; what changed is handed on before it is free."""

    def __init__(self, changed: Callable[[], None]) -> None:
        self._lock, self._depth, self._changed = threading.RLock(), 0, changed

    def acquire(self) -> bool:
        """Take it."""
        self._lock.acquire()
        self._depth += 1
        return True

    def release(self) -> None:
        """Give it back."""
        try:
            if self._depth == 1:
                self._changed()
        finally:
            self._depth -= 1
            self._lock.release()

    def __enter__(self) -> "Lock":
        self.acquire()
        return self

    def __exit__(self, *_problem: Any) -> None:
        self.release()


class _Table(registrations.Registrations):  # type: ignore[misc]  # rosmaster has no types
    """Registrations of one kind that tell what changes."""

    def __init__(self, kind: int, note: Note, seen: Note) -> None:
        super().__init__(kind)
        self._note, self._seen, self.kind = note, seen, _KINDS[kind]

    def register(self, key: str, node: str, node_uri: str, service_uri: Optional[str] = None) -> None:
        """As rosmaster's."""
        held = (self.map.get(key), (self.service_api_map or {}).get(key)) if service_uri else len(self.map.get(key, ()))
        super().register(key, node, node_uri, service_uri)
        known = held == ((self.map[key], self.service_api_map[key]) if service_uri else len(self.map[key]))
        record = self._record(key, node, node_uri, service_uri, True)
        self._seen(record)
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
        held = dict(self.service_api_map or {})
        gone = [(key, of) for key, users in self.map.items() for of in users if of[0] == node]
        super().unregister_all(node)
        for key, (_node, node_uri) in gone:
            self._note(self._record(key, node, node_uri, held.get(key, ("", ""))[1], False))

    def _record(self, key: str, node: str, node_uri: str, service_uri: Optional[str], there: bool) -> Record:
        if self.kind == "service":
            return ["service", key, node, service_uri or "", node_uri or "", there]
        return [self.kind, key, node, node_uri, there]


class _Nodes(Dict[str, Any]):
    """The nodes, which tell what changes."""

    def __init__(self, note: Note) -> None:
        super().__init__()
        self._note = note

    def __setitem__(self, name: str, node: Any) -> None:
        super().__setitem__(name, node)
        self._note(["node", name, node.api])

    def __delitem__(self, name: str) -> None:
        super().__delitem__(name)
        self._note(["node", name, ""])


class _Types(Dict[str, str]):
    """The types of topics, which tell what changes."""

    def __init__(self, note: Note) -> None:
        super().__init__()
        self._note = note

    def __setitem__(self, topic: str, kind: str) -> None:
        known = self.get(topic) == kind
        super().__setitem__(topic, kind)
        if not known:
            self._note(["type", topic, kind])


class _Manager(registrations.RegistrationManager):  # type: ignore[misc]
    """rosmaster's registrations. Who loses its name loses it in the eyes of its subscribers, too."""

    def __init__(self, pool: Any, note: Note, seen: Note, lost: Callable[[List[str]], None]) -> None:
        super().__init__(pool)
        self.nodes = _Nodes(note)
        kinds = registrations.Registrations
        self.publishers = _Table(kinds.TOPIC_PUBLICATIONS, note, seen)
        self.subscribers = _Table(kinds.TOPIC_SUBSCRIPTIONS, note, seen)
        self.services = _Table(kinds.SERVICE, note, seen)
        self.param_subscribers = _Table(kinds.PARAM_SUBSCRIPTIONS, note, seen)
        self._lost = lost

    def _register(self, table: Any, key: str, node: str, node_uri: str, service_uri: Optional[str] = None) -> None:
        before = self.nodes.get(node)
        topics = list(before.topic_publications) if before is not None and before.api != node_uri else []
        super()._register(table, key, node, node_uri, service_uri)
        self._lost(topics)


class _Pool:
    """In the place of rosmaster's pool of threads."""

    def __init__(self, notifier: Notifier, spared: Callable[[str, str], bool]) -> None:
        self._notifier, self._spared = notifier, spared

    def queue_task(self, _marker: str, task: Any, arguments: Tuple[Any, ...]) -> bool:
        """Have a node told. rosmaster holds the lock of the registrations."""
        name = getattr(task, "__name__", "")
        if name == "param_update_task":
            _node, uri, key, value = arguments
            self._notifier.tell(uri, "paramUpdate", key, (key, copied(value)))
        elif name == "publisher_update_task":
            uri, topic, uris = arguments
            self._notifier.tell(uri, _TELLING[name], topic, (topic, uris))
        elif name == "shutdown_node_task":
            uri, node, reason = arguments
            if not self._spared(node, uri):
                self._notifier.tell(uri, _TELLING[name], node, (f"[{node}] Reason: {reason}",))
        return True

    def join_all(self, **_options: bool) -> None:
        """The workers end with the process."""


class Callbacks(NamedTuple):
    """What the program hears of, in the thread of a call."""

    handed_on: Callable[[List[Record]], None]  # the changes of a call; the lock of the registrations is held
    left: Callable[[str, str], None]  # a node, by name and URI, has withdrawn everything
    refused: Callable[[Refusal], None]
    not_ended: Callable[[str, str], None]  # a node, by name and URI, is not told to end
    wait: Callable[[], None]  # before a change; raises Beyond where there is no room for it now


class Master(master_api.ROSMasterHandler):  # type: ignore[misc]
    """The methods of rosmaster, and more of them. Others can call no other names."""

    def __init__(
        self,
        watched: Tuple[str, ...],
        imports: str,
        imported: Callable[[Any], Any],
        callbacks: Callbacks,
    ) -> None:
        """`watched`: parameters whose changes are told. `imported(value)`: the nodes in the parameter `imports`."""
        super().__init__(0)
        self.guard = NameGuard()
        self._spare = False
        self._records: List[Record] = []
        self._last: Dict[str, Any] = dict.fromkeys(watched)
        self._imports, self._imported = imports, imported
        self.calls = threading.local()
        self._restored: Dict[Tuple[Any, ...], None] = {}  # registrations that nobody has confirmed yet
        self._notifier = Notifier(self._may_tell)
        self._enders: Dict[
            Tuple[str, str], Set[Tuple[str, bool]]
        ] = {}  # (URI, name) of a node to be ended -> from where
        self._own, self._types_due = "/" + imports.strip("/").partition("/")[0], 0.0
        self.callbacks = callbacks
        self.more: Dict[str, Callable[..., Any]] = {
            "system.listMethods": self._methods,
            "system.multicall": partial(multicall, self.answer),
            TOGETHER: self._together,
        }

        note = self._note
        self.usage = Usage()
        self.thread_pool = _Pool(self._notifier, self._is_spared)
        self.ps_lock = self._lock = Lock(self._commit)
        self.reg_manager = _Manager(self.thread_pool, note, self._seen, self._tell_topics)
        self.publishers, self.subscribers = self.reg_manager.publishers, self.reg_manager.subscribers
        self.services, self.param_subscribers = self.reg_manager.services, self.reg_manager.param_subscribers
        self.topics_types = _Types(note)
        self.param_server = paramserver.ParamDictionary(self.reg_manager)
        self._known = {
            name
            for name in dir(master_api.ROSMasterHandler)
            if not name.startswith("_") and name != "param_update_task"
            if callable(getattr(master_api.ROSMasterHandler, name))
        }

    # Calls

    def answer(self, name: str, arguments: Tuple[Any, ...]) -> Any:
        """Each call of others comes here, also those of a multicall. What is beyond a bound has an answer that says so."""
        try:
            if name in CHANGES or name == TOGETHER:
                self.callbacks.wait()
            return self._dispatch(name, arguments)
        except Refusal as problem:
            self.callbacks.refused(problem)
            return -1, str(problem), 0

    def _dispatch(self, name: str, arguments: Tuple[Any, ...]) -> Any:
        if name in self.more:
            return self.more[name](*arguments)
        if name not in self._known:
            raise Exception(f'method "{name}" is not supported')  # in the words of the standard library
        if name in CHANGES:
            with self._lock:
                return self._change(name, arguments)
        if name in _READ_TREES:
            with self._lock:
                code, text, value = getattr(self, name)(*arguments)
                return code, text, copied(value)
        return getattr(self, name)(*arguments)

    def call(self, name: str, *arguments: Any) -> Any:
        """A call of this process itself."""
        return self._dispatch(name, arguments)

    def _together(self, _caller_id: str, texts: List[str]) -> Any:
        """Carry out changes, [method, caller, argument, ...], which come in texts of JSON, and so do the results.

        Those of one text are made together: nobody sees some of them alone, and they are handed on at once.
        """
        if not self.caller().own:
            return -1, "only programs of this computer may use it", 0
        try:
            parts = [_calls(text) for text in texts]
        except Refusal:
            raise
        except (ValueError, TypeError) as problem:
            return -1, f"expected: texts of JSON, each a list of calls: {plain(problem)}", 0
        return 1, "", [json.dumps(self._part(calls), default=str) for calls in parts]

    def _part(self, calls: List[Any]) -> List[Any]:
        """The results; of a call that fails, why, as a text."""
        results: List[Any] = []
        with self._lock:
            for name, *arguments in calls:
                try:
                    if name not in CHANGES:
                        raise ValueError(f"{name} changes nothing")
                    results.append(self._dispatch(name, tuple(arguments)))
                except Refusal as refusal:
                    self.callbacks.refused(refusal)
                    results.append((-1, str(refusal), 0))
                except Exception as problem:  # as in a multicall: one that fails does not end the others
                    results.append(f"{type(problem).__name__}: {problem}")
        return results

    def _methods(self) -> List[str]:
        return sorted([*self._known, *self.more])

    def caller(self) -> Caller:
        return getattr(self.calls, "caller", Caller())

    def _note(self, record: Record) -> None:
        self._records.append(record)
        self.usage.count(record)

    def _change(self, name: str, arguments: Tuple[Any, ...]) -> Any:
        at = CHANGES[name]
        check_names(arguments[:-1] if name == "setParam" else arguments)
        self._check_room(name, arguments)
        arguments = self._guarded(name, arguments)
        heavier = self._heavier(name, arguments)
        texts = len(arguments) > max(at, 1) and all(isinstance(arguments[place], str) for place in (0, at))
        if at and texts:
            refused = self._refusal(arguments[0], arguments[at])
            if refused:
                return -1, refused, 0
        try:
            code, text, value = getattr(self, name)(*arguments)
        finally:
            self._spare = False
        if code == 1:
            self.usage.parameters += heavier
            self._changed(name, arguments)
        elif code == 0 and heavier:  # rosmaster failed on its way, and nobody knows how far it came
            self.usage.parameters = weigh(self.param_server.parameters)
        return code, text, copied(value)

    def _changed(self, name: str, arguments: Tuple[Any, ...]) -> None:
        """Note what a call has changed."""
        if not CHANGES[name] and name.endswith("Param"):
            self._parameter(name, arguments)
        elif name in _REGISTERS:
            self._registered_by(arguments[0])
        if name.startswith("unregister") and self.has_ended(arguments[0]):
            self.callbacks.left(arguments[0], self.reg_manager.nodes[arguments[0]].api)

    def _heavier(self, name: str, arguments: Tuple[Any, ...]) -> int:
        """How much heavier the parameters get by a call. Raises Beyond. Wrong arguments have their answer from rosmaster."""
        key = _key_of(name, arguments)
        if not key:
            return 0
        if name == "deleteParam":
            return -weigh_parameter(self.param_server.parameters, key)
        value = arguments[2]
        heavier = self.usage.growth(self.param_server.parameters, key, value)
        for watched in self._last:
            if touches(key, watched):
                part = value if split_name(key) else dict(value).get(split_name(watched)[0]) if value else None
                if weigh(part) > BOUNDS["watched"].most:
                    raise refuse("watched", watched)
        return heavier

    def _check_room(self, name: str, arguments: Tuple[Any, ...]) -> None:
        """Raise Beyond where there is no room for a registration that is not there yet."""
        kind, at = _REGISTERS.get(name), CHANGES[name]
        if kind is None or len(arguments) <= at or not all(isinstance(text, str) for text in arguments):
            return
        node, uri, key = arguments[0], arguments[at], arguments[2 if kind == "param_subscribers" else 1]
        key = rosgraph.names.resolve_name(key, node) + ("/" if kind == "param_subscribers" else "")
        users = getattr(self, kind).map.get(key, ())
        texts = [text for text in arguments if isinstance(text, str)]
        full = self.usage.is_full(*texts)
        if (full or len(users) >= BOUNDS["users"].most) and (node, uri) not in users:
            self._forget_types()
            if self.usage.is_full(*texts):
                raise refuse("registrations", key)
            if kind != "services" and len(users) >= BOUNDS["users"].most:
                raise refuse("users", key)

    def _forget_types(self) -> None:
        """rosmaster keeps the type of each topic that there ever was. Where there is no room, those of unused ones go."""
        if monotonic() < self._types_due:
            return
        self._types_due = monotonic() + TYPES_AGAIN
        for topic in list(self.topics_types):
            if topic not in self.publishers.map and topic not in self.subscribers.map:
                del self.topics_types[topic]
                self.usage.count(["type", topic, ""])

    def _guarded(self, name: str, arguments: Tuple[Any, ...]) -> Tuple[Any, ...]:
        """The arguments without what others may not set: what is below the collection's own name. Raises Beyond."""
        key = _key_of(name, arguments)
        if not key or not touches(key, self._own) or self._is_own_program():
            return arguments
        held = self._value(self._own)
        if split_name(key):
            if name == "setParam" and arguments[2] == self._value(key):
                return arguments
            raise Refusal(f"{key} is set by master_sync of this computer alone", "own")
        if name != "setParam" or not isinstance(arguments[2], dict):
            return arguments
        tree = {part: value for part, value in arguments[2].items() if part.strip("/") != self._own.strip("/")}
        return (*arguments[:2], tree if held is None else {**tree, self._own.strip("/"): held})

    def _is_own_program(self) -> bool:
        caller = self.caller()
        return not caller.address or (caller.own and programs.is_own(*caller.ends))

    def _registered_by(self, name: str) -> None:
        """Note from which address a node was registered first: it may be ended from there."""
        node = self.reg_manager.nodes.get(name)
        if node is not None and not hasattr(node, "by"):
            node.by = (self.caller().address, self.caller().own)

    def _is_spared(self, name: str, uri: str) -> bool:
        """True where a node whose name another one takes is not to be ended at all."""
        by = getattr(self.reg_manager.nodes.get(name), "by", ("", False))
        if len(self._enders) >= MOST_ENDERS:
            self._enders.clear()
        self._enders[uri, name] = {by, (self.caller().address, self.caller().own)}
        return self._spare

    def _may_tell(self, call: Call) -> bool:
        """True where a node may be told that; asked in the notifier's thread.

        A node is ended only where it is on the computer from which it was registered, or from which its successor was. Else
        anybody could have any node of any robot ended by this roscore: by a registration in its name, and one more.
        """
        if call.method != "shutdown":
            return True
        callers = self._enders.get((call.uri, call.key[1]), set())
        if any(own for _address, own in callers) and addresses.local_uris([call.uri], RESOLVE):
            return True
        host = addresses.host_of(call.uri)
        if addresses.addresses_of_all([host]).get(host) in {address for address, _own in callers}:
            return True
        self.callbacks.not_ended(call.key[1], call.uri)
        return False

    def _refusal(self, node: str, uri: str) -> str:
        held = self.reg_manager.nodes.get(node)
        verdict = self.guard.judge(node, held.api if held is not None else "", uri, monotonic())
        self._spare = verdict.spared
        if verdict.import_lost and held is not None:
            self._records.append(["refused", node, held.api, f"an own node at {quote(uri)} has taken the name"])
        if verdict.refusal:
            self._records.append(["refused", node, uri, verdict.refusal])
            return f"refused: {verdict.refusal}"
        return ""

    def _parameter(self, name: str, arguments: Tuple[Any, ...]) -> None:
        """A parameter was set or deleted."""
        if name == "unsubscribeParam":
            return
        key = _key_of(name, arguments)
        self._records.append(["set", key, arguments[2]] if name == "setParam" else ["delete", key])
        for watched, last in self._last.items():
            if touches(key, watched):
                value = self._value(watched)
                if value != last:
                    self._last[watched] = value
                    self._records.append(["parameter", watched, value])
                    if watched == self._imports:
                        self.guard.set_imports(self._imported(value))

    def _value(self, name: str) -> Any:
        try:
            return copied(self.param_server.get_param(name))
        except KeyError:
            return None

    # Changes

    def _seen(self, record: Record) -> None:
        """A registration was made, or made again by who has it."""
        if self._restored:
            self._restored.pop(_key(record), None)

    def _commit(self) -> None:
        """Hand on what was changed; the lock is about to be free."""
        if self._records:
            records = self._records[:]
            self._records.clear()
            for record in records:
                if record[0] == "node" and not record[2]:
                    self.guard.forget(record[1])
            self.callbacks.handed_on(records)

    def _tell_topics(self, topics: List[str]) -> None:
        for topic in topics:
            self._notify_topic_subscribers(topic, self.publishers.get_apis(topic), self.subscribers.get_apis(topic))

    def registered(self) -> Iterator[Record]:
        """All registrations, as records. The lock is held while one is asked for; in between they may change."""
        for topic, kind in list(self.topics_types.items()):
            yield ["type", topic, kind]
        for name, node in list(self.reg_manager.nodes.items()):
            yield ["node", name, node.api]
        for table in (self.publishers, self.subscribers, self.param_subscribers):
            for key, users in list(table.map.items()):
                for of in list(users):
                    yield [table.kind, key, *of, True]
        uris = dict(self.services.service_api_map or {})
        for service, users in list(self.services.map.items()):
            if service in uris and users:
                node, node_uri = users[0]
                yield ["service", service, node, uris[service][1], node_uri, True]

    def parameters(self) -> List[Record]:
        """The parameters whose changes are told, with their values."""
        return [["parameter", name, value] for name, value in self._last.items()]

    def parts(self) -> Iterator[List[Record]]:
        """All there is, a few records at a time, so that nobody waits long for the lock.

        What changes meanwhile may be in it or not. Who notes the changes since, and carries them out after it, has what is.
        """
        records = chain([["set", "/", {}]], _records_of("", self.param_server.parameters), self.registered())
        while True:
            with self._lock:
                part = list(islice(records, PART))
            if not part:
                return
            yield part

    # After a start

    def restore(self, found: Registry) -> None:
        """Have what an earlier life knew. Before the first call."""
        manager = self.reg_manager
        with self._lock:
            for name, uri in found.nodes.items():
                manager.nodes[name] = registrations.NodeRef(name, uri)
            self.topics_types.update(found.types)
            for topic in found.publishers:  # rosmaster lists no topics where one of them has no type
                self.topics_types.setdefault(topic, "*")
            self.param_server.parameters = found.parameters
            for table, users_of, held in (
                (self.publishers, found.publishers, "topic_publications"),
                (self.subscribers, found.subscribers, "topic_subscriptions"),
                (self.param_subscribers, found.listeners, "param_subscriptions"),
            ):
                for key, users in users_of.items():
                    table.map[key] = list(users)  # as its method does it, without a search for each
                    for name, uri in users:
                        getattr(self._node(name, uri), held).append(key)
                        self._restored[table.kind, key, name, uri] = None
            for key, of in found.services.items():
                self.services.register(key, of.node, of.node_uri, of.uri)
                self._node(of.node, of.node_uri).services.append(key)
                self._restored["service", key, of.node, of.uri] = None
            for watched in self._last:
                self._last[watched] = self._value(watched)
            self.guard.set_imports(self._imported(self._last.get(self._imports)))
            for name, uri in found.nodes.items():
                self.guard.judge(name, "", uri, monotonic())
            self._records.clear()
            self.usage = Usage()
            self.usage.parameters = weigh(found.parameters)
            for record in found.records():
                if record[0] != "set":
                    self.usage.count(record)

    def _node(self, name: str, uri: str) -> Any:
        nodes = self.reg_manager.nodes
        if name not in nodes:
            nodes[name] = registrations.NodeRef(name, uri)
        return nodes[name]

    def tell_all(self) -> None:
        """Tell every node what it may have missed: the queue of an earlier life is lost."""
        with self._lock:
            self._tell_topics(list(self.subscribers.map))
            for key, users in self.param_subscribers.map.items():
                value = self._value(key)
                for _name, uri in users:
                    self._notifier.tell(uri, "paramUpdate", key, (key, {} if value is None else value))

    def come_back(self, found: Registry) -> None:
        """Register nodes as if they did it themselves, and tell them what they would hear then. Names that others have stay theirs."""
        with self._lock:
            for topic, users in found.publishers.items():
                for name, uri in self._unopposed(users):
                    self.call("registerPublisher", name, topic, found.types.get(topic, "*"), uri)
            for topic, users in found.subscribers.items():
                for name, uri in self._unopposed(users):
                    uris = self.call("registerSubscriber", name, topic, found.types.get(topic, "*"), uri)[2]
                    self._notifier.tell(uri, "publisherUpdate", topic, (topic, uris))
            for service, of in found.services.items():
                if service not in self.services.map and list(self._unopposed([(of.node, of.node_uri)])):
                    self.call("registerService", of.node, service, of.uri, of.node_uri)
            for key, users in found.listeners.items():
                for name, uri in self._unopposed(users):
                    value = self.call("subscribeParam", name, uri, key)[2]
                    self._notifier.tell(uri, "paramUpdate", key, (key, value))

    def _unopposed(self, users: Iterable[NodeKey]) -> Iterator[NodeKey]:
        """Those whose name nobody else has by now."""
        return (of for of in users if of[0] not in self.reg_manager.nodes or self.has(*of))

    def has(self, name: str, uri: str) -> bool:
        """True while this node has the name."""
        held = self.reg_manager.nodes.get(name)
        return held is not None and held.api == uri

    def end_node(self, name: str, uri: str) -> None:
        """A node is dead, or another one has its port: nothing restored of it stays. What it registered since does."""
        with self._lock:
            if not self.has(name, uri):
                return
            for key in [key for key in self._restored if key[2] == name]:
                self.end_registration(list(key))
            if self.has(name, uri) and self.reg_manager.nodes[name].is_empty():
                del self.reg_manager.nodes[name]

    def has_ended(self, name: str) -> bool:
        """True where a node has withdrawn everything and is still known: it may have ended.

        rospy and roscpp leave their parameter subscriptions, and rosmaster leaves services that another node has taken.
        So their names would be taken for ever, also by an import.
        """
        node = self.reg_manager.nodes.get(name)
        if node is None or node.topic_publications or node.topic_subscriptions:
            return False
        return all((name, node.api) not in self.services.map.get(service, ()) for service in node.services)

    def bury(self, name: str, uri: str) -> None:
        """A node that had withdrawn everything is dead."""
        with self._lock:
            if self.has(name, uri) and self.has_ended(name):
                node = self.reg_manager.nodes[name]
                for key in list(node.param_subscriptions):
                    self.reg_manager.unregister_param_subscriber(key, name, uri)
                if self.has(name, uri):
                    del self.reg_manager.nodes[name]

    def end_registration(self, record: Record) -> bool:
        """A restored registration is not true any more, unless it was made anew since. Whether it was there."""
        kind, key, name, uri = record[:4]
        with self._lock:
            if _key(record) not in self._restored:
                return False
            del self._restored[_key(record)]
            getattr(self.reg_manager, _UNREGISTER[kind])(key, name, uri)
            if kind == "publisher":
                self._tell_topics([key])
        return True


def _calls(text: str) -> List[Any]:
    """The calls in a text of JSON. Raises ValueError."""
    calls = json_text.from_json(text) if isinstance(text, str) else None
    if not isinstance(calls, list) or not all(isinstance(call, list) and call for call in calls):
        raise ValueError("something else")
    if len(calls) > BOUNDS["together"].most:
        raise refuse("together", f"a text with {len(calls):,} calls")
    if not is_writable(calls):
        raise ValueError("a text with characters that XML has not")
    return calls


def _key_of(name: str, arguments: Tuple[Any, ...]) -> str:
    """The name of the parameter of setParam or deleteParam; "" where it is another call, or none that rosmaster takes."""
    if len(arguments) != {"setParam": 3, "deleteParam": 2}.get(name):
        return ""
    if not all(isinstance(text, str) for text in arguments[:2]) or not arguments[1]:
        return ""
    return str(rosgraph.names.resolve_name(arguments[1], arguments[0]))


def _key(record: Record) -> Tuple[Any, ...]:
    return tuple(record[:4])


def _records_of(name: str, tree: Dict[str, Any]) -> Iterator[Record]:
    """The records of a tree of parameters: many, so that no line of the store is larger than one value."""
    if not tree or any(not key or "/" in key for key in tree):  # no path leads to such a member
        yield ["set", name or "/", copied(tree)]
        return
    for key, value in list(tree.items()):
        if isinstance(value, dict):
            yield from _records_of(f"{name}/{key}", value)
        else:
            yield ["set", f"{name}/{key}", value]


def copied(value: Any) -> Any:
    """A value whose mappings are others: those of rosmaster change."""
    return {key: copied(part) for key, part in value.items()} if isinstance(value, dict) else value


def serve(
    master: Master, port: int, held: List[socket.socket], more: Mapping[str, Callable[..., Any]]
) -> Tuple[str, socket.socket]:
    """Answer calls from now on; the URI and the socket. `held`: open sockets, of which a fitting one is used. Raises OSError."""
    master.more.update(more)
    problems: List[Exception] = []
    settled = threading.Event()

    def failed(problem: Exception) -> None:
        problems.append(problem)
        settled.set()

    def ready(uri: str) -> None:
        master.uri = uri
        settled.set()

    _Server.door, _Server.held = Door(master.answer, master.callbacks.refused, master.calls), held
    rosgraph.xmlrpc.ThreadingXMLRPCServer = _Server
    master._ready = ready  # rosgraph calls it
    node = rosgraph.xmlrpc.XmlRpcNode(port, master, failed)
    node.start()
    settled.wait()
    if problems:
        raise problems[0] if isinstance(problems[0], OSError) else OSError(str(problems[0]))
    return str(node.uri), node.server.socket


class _Server(rosgraph.xmlrpc.ThreadingXMLRPCServer):  # type: ignore[misc]
    """rosgraph's, on a socket that systemd may have held."""

    door: Door
    held: List[Socket] = []
    socket: Socket
    server_address: Any

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        base = rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler
        version = getattr(base, "protocol_version", "HTTP/1.0")  # rosgraph knows which kernels are slow
        self.RequestHandlerClass = type("_Handler", (Handler,), {"door": self.door, "protocol_version": version})

    def server_bind(self) -> None:
        """Take the socket that is there, or open one."""
        for other in self.held:
            if other.family == self.address_family and other.getsockname()[:2] == self.server_address[:2]:
                self.socket.close()
                self.socket, self.server_address = other, other.getsockname()
                return
        super().server_bind()

    def verify_request(self, request: Socket, client_address: Any) -> bool:
        """True where there is room for one more connection."""
        own = Caller(client_address[0], request.getsockname()[0]).own
        return self.door.lines.opened(request, own)

    def shutdown_request(self, request: Socket) -> None:
        """A connection has ended."""
        self.door.lines.closed(request)
        super().shutdown_request(request)

    def handle_error(self, _request: Any, client_address: Any) -> None:
        """A connection that breaks is nobody's fault here."""
        _log.debug("a connection of %s broke: %s", client_address, sys.exc_info()[1])
