# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A model of rosmaster, where it is not installed: what roscore/master.py replaces, calls, or is called by.

It is as odd as the real one where that matters: a name that comes twice, services that another node has taken, parameters
that are listened to. tests/systems/test_roscore.py runs the tests of roscore/master.py with the real one.
"""

import importlib.util
import sys
import types


class NodeRef:
    """A node, and what it has."""

    KINDS = ("topic_subscriptions", "topic_publications", "services", "param_subscriptions")

    def __init__(self, name, api):
        self.id, self.api = name, api
        for kind in self.KINDS:
            setattr(self, kind, [])

    def held(self, kind):
        return getattr(self, self.KINDS[kind - 1])

    def is_empty(self):
        return not any(getattr(self, kind) for kind in self.KINDS)


class Registrations:
    """Key -> [(name, URI)], and for services where they are."""

    TOPIC_SUBSCRIPTIONS, TOPIC_PUBLICATIONS, SERVICE, PARAM_SUBSCRIPTIONS = 1, 2, 3, 4

    def __init__(self, kind):
        self.type, self.map, self.service_api_map = kind, {}, None

    def get_apis(self, key):
        return [api for _name, api in self.map.get(key, [])]

    def get_state(self):
        return [[key, [name for name, _api in users]] for key, users in self.map.items()]

    def register(self, key, name, api, service_api=None):
        if service_api:
            self.map[key] = [(name, api)]
            self.service_api_map = self.service_api_map or {}
            self.service_api_map[key] = (name, service_api)
        elif (name, api) not in self.map.setdefault(key, []):
            self.map[key].append((name, api))

    def unregister(self, key, name, api, service_api=None):
        if service_api:
            if (self.service_api_map or {}).get(key) != (name, service_api):
                return 1, "no longer the provider", 0
            del self.service_api_map[key], self.map[key]
            return 1, "unregistered", 1
        if (name, api) not in self.map.get(key, []):
            return 1, "not known", 0
        self.map[key].remove((name, api))
        if not self.map[key]:
            del self.map[key]
        return 1, "unregistered", 1

    def unregister_all(self, name):
        for key, users in list(self.map.items()):
            users[:] = [of for of in users if of[0] != name]
            if not users:
                del self.map[key]
                (self.service_api_map or {}).pop(key, None)


def shutdown_node_task(_api, _name, _reason):
    """Only its name counts."""


def publisher_update_task(_api, _topic, _uris):
    """Only its name counts."""


class RegistrationManager:
    """All registrations."""

    def __init__(self, thread_pool):
        self.nodes, self.thread_pool = {}, thread_pool

    def _register(self, table, key, name, api, service_api=None):
        held = self.nodes.get(name)
        changed = held is not None and held.api != api
        if changed:
            self.thread_pool.queue_task(held.api, shutdown_node_task, (held.api, name, "new node with same name"))
        if held is None or changed:
            held = self.nodes[name] = NodeRef(name, api)
        if key not in held.held(table.type):
            held.held(table.type).append(key)
        if changed:
            for each in (self.publishers, self.subscribers, self.services, self.param_subscribers):
                each.unregister_all(name)
        table.register(key, name, api, service_api)

    def _unregister(self, table, key, name, api, service_api=None):
        held = self.nodes.get(name)
        if held is None:
            return 1, "no registered node", 0
        result = table.unregister(key, name, api, service_api)
        if result[2] == 1:
            held.held(table.type).remove(key)
        if held.is_empty():
            del self.nodes[name]
        return result

    def unregister_publisher(self, topic, name, api):
        return self._unregister(self.publishers, topic, name, api)

    def unregister_subscriber(self, topic, name, api):
        return self._unregister(self.subscribers, topic, name, api)

    def unregister_param_subscriber(self, key, name, api):
        return self._unregister(self.param_subscribers, key, name, api)

    def unregister_service(self, service, name, service_api):
        return self._unregister(self.services, service, name, None, service_api)


def parts_of(key):
    return [part for part in key.split("/") if part]


class ParamDictionary:
    """The tree of parameters."""

    def __init__(self, manager):
        self.parameters, self.manager = {}, manager

    def get_param(self, key):
        value = self.parameters
        for part in parts_of(key):
            if not isinstance(value, dict):
                raise KeyError(key)
            value = value[part]
        return value

    def set_param(self, key, value):
        if not parts_of(key):
            self.parameters = value
            return
        within = self.parameters
        for part in parts_of(key)[:-1]:
            within = within.setdefault(part, {})
        within[parts_of(key)[-1]] = value


class ROSMasterHandler:
    """The methods."""

    def __init__(self, _workers):
        self.uri, self.done = None, False

    def _tell(self, name, value):
        for key, users in self.param_subscribers.map.items():
            if key.rstrip("/") == name:
                for node, api in users:
                    self.thread_pool.queue_task(api, self.param_update_task, (node, api, key, value))

    def param_update_task(self, *_arguments):
        """Only its name counts."""

    def setParam(self, _caller, key, value):
        self.param_server.set_param(key, value)
        self._tell(key, value)
        return 1, "set", 0

    def deleteParam(self, _caller, key):
        try:
            del self.param_server.get_param("/".join(["", *parts_of(key)[:-1]]))[parts_of(key)[-1]]
        except KeyError:
            return -1, "not set", 0
        self._tell(key, {})
        return 1, "deleted", 0

    def getParam(self, _caller, key):
        try:
            return 1, "parameter", self.param_server.get_param(key)
        except KeyError:
            return -1, "not set", 0

    def hasParam(self, caller, key):
        return 1, key, self.getParam(caller, key)[0] == 1

    def subscribeParam(self, caller, api, key):
        found = self.getParam(caller, key)
        self.reg_manager._register(self.param_subscribers, key.rstrip("/") + "/", caller, api)
        return 1, "subscribed", found[2] if found[0] == 1 else {}

    def unsubscribeParam(self, caller, api, key):
        self.reg_manager.unregister_param_subscriber(key.rstrip("/") + "/", caller, api)
        return 1, "unsubscribed", 1

    def registerService(self, caller, service, service_api, api):
        with self.ps_lock:
            self.reg_manager._register(self.services, service, caller, api, service_api)
        return 1, "registered", 1

    def unregisterService(self, caller, service, service_api):
        with self.ps_lock:
            return self.reg_manager.unregister_service(service, caller, service_api)

    def registerSubscriber(self, caller, topic, kind, api):
        with self.ps_lock:
            self.reg_manager._register(self.subscribers, topic, caller, api)
            if topic not in self.topics_types:
                self.topics_types[topic] = kind
            return 1, "subscribed", self.publishers.get_apis(topic)

    def unregisterSubscriber(self, caller, topic, api):
        with self.ps_lock:
            return self.reg_manager.unregister_subscriber(topic, caller, api)

    def registerPublisher(self, caller, topic, kind, api):
        with self.ps_lock:
            self.reg_manager._register(self.publishers, topic, caller, api)
            if kind != "*" or topic not in self.topics_types:
                self.topics_types[topic] = kind
            uris = self.subscribers.get_apis(topic)
            self._notify_topic_subscribers(topic, self.publishers.get_apis(topic), uris)
            return 1, "registered", uris

    def unregisterPublisher(self, caller, topic, api):
        with self.ps_lock:
            found = self.reg_manager.unregister_publisher(topic, caller, api)
            if found[2]:
                uris = self.subscribers.get_apis(topic)
                self._notify_topic_subscribers(topic, self.publishers.get_apis(topic), uris)
            return found

    def _notify_topic_subscribers(self, topic, publishers, subscribers):
        for api in subscribers:
            self.thread_pool.queue_task(api, publisher_update_task, (api, topic, publishers))

    def lookupNode(self, _caller, name):
        held = self.reg_manager.nodes.get(name)
        return (1, "node api", held.api) if held else (-1, "unknown node", "")

    def getSystemState(self, _caller):
        return 1, "state", [table.get_state() for table in (self.publishers, self.subscribers, self.services)]


def installed():
    """Return True if rosmaster is there; where it is not, the model takes its place."""
    if importlib.util.find_spec("rosmaster"):
        return True
    names = {
        "rosmaster.master_api": {"ROSMasterHandler": ROSMasterHandler},
        "rosmaster.registrations": {
            "NodeRef": NodeRef,
            "Registrations": Registrations,
            "RegistrationManager": RegistrationManager,
        },
        "rosmaster.paramserver": {"ParamDictionary": ParamDictionary},
        "rosgraph.names": {"resolve_name": lambda name, _namespace: "/" + name.lstrip("/")},
        "rosgraph.network": {},
        "rosgraph.xmlrpc": {
            "SilenceableXMLRPCRequestHandler": type("Handler", (), {}),
            "ThreadingXMLRPCServer": type("Server", (), {}),
        },
    }
    for name, members in names.items():
        package, _dot, last = name.partition(".")
        module = sys.modules[name] = types.ModuleType(name)
        vars(module).update(members)
        setattr(sys.modules.setdefault(package, types.ModuleType(package)), last, module)
    return False
