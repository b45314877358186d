# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The view that computers have of ROS: roscores, discovery, sync, talkers. A small model of what these do, over the network's packets."""

from __future__ import annotations

from functools import lru_cache
from ipaddress import IPv4Address

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import Packet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.registrations import (
    Flows,
    RegisteredItem,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe import observations as seen
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome

from tests.simulator import people
from tests.simulator.network import CONNECTED, NODES
from tests.simulator.state import DEAD, HUNG, RUNS

TALKS = "diagnostic_msgs/DiagnosticStatus"  # of a topic that all robots publish: of this type it is meant
SUMS = {TALKS: "d0ce08bc6e5ba34c7754f563a9cabaf1", "nav_msgs/Odometry": "cd5e73d190d741a2f92e81eda573aca7"}


def topic_of(computer):
    return "/multimaster_verify/" + computer.replace("-", "_").replace(".", "_")


def talker_of(computer):
    return "/multimaster_verify_talker_" + computer.replace("-", "_").replace(".", "_")


class Ros:
    """ROS of a state, as its computers see it. `run`: the computers of the run, whose talkers were started."""

    def __init__(self, network, run):
        self.network, self.state, self.fleet = network, network.state, network.fleet
        self.flows = Flows(self.fleet)
        self.known = {entry.robot: entry for entry in self.fleet.belonging.robots}
        self.roscore_at = {
            (self.state.master(robot), self.fleet.computers[self.state.master(robot)].roscore_port): robot
            for robot in self.state.robots
        }
        for name in ("asks", "lists", "takes", "registered"):
            setattr(self, name, lru_cache(None)(getattr(self, "_" + name)))
        self.run = [name for name in run if self.fleet.computers[name].robot and name not in self.state.without_ros]

    # Names of nodes

    def environment(self, computer):
        return self.state.world.machines[computer].environment

    def advertised(self, computer):
        """The host in the URIs of nodes of a computer (ROS: ROS_HOSTNAME, else ROS_IP, else the host's name)."""
        variables = self.environment(computer)
        return variables.get("ROS_HOSTNAME") or variables.get("ROS_IP") or computer

    def started_as(self, computer):
        """The host in the URIs of what was started before: the services, and the robot's own nodes."""
        variables = self.fleet.computers[computer].environment
        return variables.get("ROS_HOSTNAME") or variables["ROS_IP"]

    def reach(self, computer, host, port):
        """Open a connection to a host of a URI: an error or "", the machine, and the address."""
        addresses = self.network.resolve(computer, host, user=True)
        if not addresses:
            return "Name or service not known", "", None
        error, machine = self.network.connect(computer, addresses[0], port)
        return error, machine, addresses[0]

    # Roscores

    def _asks(self, computer):
        """Ask the roscore of ROS_MASTER_URI: an error or "", its robot, and whether large answers arrive."""
        uri = self.environment(computer).get("ROS_MASTER_URI", "")
        if not uri:
            return "the environment has no ROS_MASTER_URI", "", False
        host, _colon, port = uri.split("//")[1].partition(":")
        error, machine, address = self.reach(computer, host, int(port))
        robot = self.roscore_at.get((machine, int(port)), "")
        if error or not robot:
            return f"{uri}: {error or 'something else than a roscore'}", "", False
        if self.state.robots[robot].roscore == HUNG:
            return f"{uri}: timed out", "", False
        return "", robot, self._large(machine, computer, address)

    def _large(self, server, client, address):
        """Return True if a large answer comes back from a server to a client that has called it at an address."""
        if server == client or address.is_loopback:
            return True
        way = self.network.echo(client, Packet("tcp", address, port=NODES, size=60))
        source = way.there.packet.source
        if not way.ok or source is None:
            way = self.network.trace(client, Packet("tcp", address, port=NODES, size=60))
            source = way.packet.source
        return source is not None and self.network.carries(server, source)

    def works(self, robot):
        """Return True if the roscore of a robot serves the nodes beside it."""
        error, found, _large = self.asks(self.state.master(robot))
        return not error and found == robot

    def uri(self, robot):
        """The roscore's own URI."""
        its = self.state.robots[robot]
        return f"http://{its.calls_itself}:{self.fleet.computers[self.state.master(robot)].roscore_port}/"

    # Discovery

    def announces(self, robot):
        return self.state.robots[robot].discovery == RUNS and self.works(robot)

    def heartbeats(self, source, target):
        """The address from which a robot's heartbeats reach another one's discovery node; None where none arrives."""
        one, other = self.state.robots[source], self.state.robots[target]
        sender, hearer = self.state.master(source), self.state.master(target)
        network, fleet = self.network, self.fleet
        same = one.port == other.port
        if fleet.transport in ("both", "multicast") and same and one.group == other.group:
            came = network.heard(sender, one.port).get(hearer)
            device = network.world.machines[hearer].find_interface(network.members[hearer].discovery_address)
            if came and device is not None and came[0] == device.name and came[2] < 0.7:
                return came[1]
        if fleet.transport in ("both", "unicast") and same:
            way = network.datagram(sender, fleet.master_of[target].address, one.port)
            if way.ok and way.where == hearer:
                return way.packet.source
        return None

    def _lists(self, target, source):
        """The entry of another master at a robot's discovery node, listed or ignored: a ListedMaster, an Outsider or None."""
        master = self.fleet.master_of[source]
        if self.state.robots[target].discovery != RUNS or not self.announces(source):
            return None
        if target == source:
            return seen.ListedMaster(master.name, self.uri(source), True, master.monitor_uri)
        address = self.heartbeats(source, target)
        if address is None:
            return None
        error, machine = self.network.connect(self.state.master(target), address, master.rpc_port)
        if error or machine != self.state.master(source):
            return None
        uri, known = self.uri(source), self.known[source]
        if self.fleet.belonging.strangers == "ignore" and self._bundled(target):
            if address not in known.addresses:
                return seen.IgnoredSender(str(address), master.name, uri, "it is not at its planned address")
            if uri.rstrip("/") not in {one.rstrip("/") for one in known.uris}:
                return seen.IgnoredSender(str(address), master.name, uri, "its master has another URI than planned")
        return seen.ListedMaster(master.name, uri, True, f"http://{address}:{master.rpc_port}")

    def _bundled(self, robot):
        return self.fleet.computers[self.state.master(robot)].provider == "bundled"

    def listed(self, robot):
        """The masters that a robot's discovery node lists."""
        entries = [self.lists(robot, other) for other in self.state.robots]
        return tuple(entry for entry in entries if isinstance(entry, seen.ListedMaster))

    def outsiders(self, computer):
        """Whom the discovery node of a computer ignores."""
        robot = self.fleet.computers[computer].robot
        if (
            computer != self.state.master(robot)
            or self.state.robots[robot].discovery != RUNS
            or not self._bundled(robot)
        ):
            return ()
        entries = [self.lists(robot, other) for other in self.state.robots]
        found = [entry for entry in entries if isinstance(entry, seen.IgnoredSender)]
        strangers = self.state.strangers if self.fleet.belonging.strangers == "ignore" else ()
        found += [
            seen.IgnoredSender(address, "stranger", "http://stranger:11311/", "it is not in the inventory")
            for address in strangers
        ]
        return tuple(found)

    def list_masters(self, computer):
        """The answer of `rosservice call /master_discovery/list_masters`."""
        error, robot, _large = self.asks(computer)
        if error:
            return seen.MasterList(error="ERROR: Unable to communicate with master!", seconds=10.0)
        its, master = self.state.robots[robot], self.state.master(robot)
        if its.discovery == DEAD:
            return seen.MasterList(
                error="ERROR: Service [/master_discovery/list_masters] is not available.", seconds=10.0
            )
        error, machine, _address = self.reach(computer, self.started_as(master), NODES)
        if error or machine != master:
            return seen.MasterList(error="ERROR: Unable to communicate with service [/master_discovery/list_masters]")
        if its.discovery == HUNG:
            return seen.MasterList(error="rosservice printed nothing within 10 s", seconds=10.0)
        return seen.MasterList(self.listed(robot), 0.7)

    def masters_seen(self, computer):
        """The discovery node of every master, as multimaster_verify looks at it."""
        return tuple(self._master_seen(computer, master) for master in self.fleet.masters)

    def _master_seen(self, computer, master):
        error, machine = self.network.connect(computer, master.address, master.rpc_port)
        entry = {"computer": master.computer, "address": str(master.address), "port": master.rpc_port}
        if computer != master.computer:
            entry["route"] = self.network.route(computer, master.address)
            refused, _machine = self.network.connect(
                computer, master.address, self.fleet.computers[master.computer].roscore_port
            )
            entry["roscore"], entry["roscore_outcome"] = refused or "open", CONNECTED[refused]
        entry["outcome"] = CONNECTED[error]
        if error:
            return seen.SeenMaster(**entry, error=error)
        if machine != master.computer or self.state.robots[master.robot].discovery != RUNS:
            return seen.SeenMaster(**entry, open=True, connect_ms=0.3, clock_error="getCurrentTime failed: timed out")
        clocks = self.state.world.machines
        noise = (self.network.chance("clock", computer, master.computer) - 0.5) / 200
        offset = clocks[machine].clock - clocks[computer].clock + noise
        return seen.SeenMaster(
            **entry, open=True, connect_ms=0.3, clock_offset_s=round(offset, 6), clock_uncertainty_s=0.001
        )

    # Talkers

    def _registered(self, computer):
        """The robot with whose roscore the talker of a computer has registered; empty where it could not."""
        error, robot, _large = self.asks(computer)
        return "" if error else robot

    def talkers(self, robot):
        """The computers whose talkers are registered with a robot's roscore by themselves."""
        return [name for name in self.run if self.registered(name) == robot]

    def _takes(self, target, source):
        """Return True if the sync node of a robot has fetched the registrations of another one."""
        its = self.state.robots[target]
        entry = self.lists(target, source)
        if its.sync != RUNS or not self.works(target) or not isinstance(entry, seen.ListedMaster):
            return False
        address = IPv4Address(entry.monitoruri.split("//")[1].partition(":")[0])
        return self._large(self.state.master(source), self.state.master(target), address)

    def passes(self, source, target, item, kind):
        """Return True if the plan and the robots' own state let a registration pass from `source` to `target`."""
        if not (self.state.robots[target].takes and self.state.robots[source].gives) and item.name.endswith("/odom"):
            return False
        return self.flows.rules(source, target).passes(item, kind)

    def imported_talkers(self, target, source):
        if not self.takes(target, source) or self.state.robots[target].stale:
            return []
        return [
            name
            for name in self.talkers(source)
            if self.passes(source, target, RegisteredItem("publisher", topic_of(name), talker_of(name)), TALKS)
        ]

    def topics(self, computer, started):
        """The topics of the talkers that are to be heard on a computer."""
        robot = self.fleet.computers[computer].robot
        if computer in self.state.without_ros:
            return ()
        error, at, large = self.asks(computer)
        published = {}
        if not error:
            own = [(name, at) for name in self.talkers(at)]
            others = [
                (name, other) for other in self.state.robots if other != at for name in self.imported_talkers(at, other)
            ]
            published = {name: self.advertised(name) for name, _robot in own + others}
        found = []
        for name in self.fleet.talkers_by_robot(started)[robot]:
            if name != computer:
                found.append(self._topic(computer, name, error, large, published))
        return tuple(found)

    def _topic(self, computer, name, error, large, published):
        uri = self.environment(computer).get("ROS_MASTER_URI", "")
        topic, host = topic_of(name), published.get(name)
        if error:
            told = "the listener failed: Unable to communicate with master!"
            return seen.HeardTopic(name, topic, listened=False, error=told)
        if host is None:
            told = f"the topic is not registered at {uri}" if large and published else "nothing"
            return seen.HeardTopic(name, topic, error=told if large else f"{uri}: no whole answer within 5 s")
        problem, machine, _address = self.reach(computer, host, NODES)
        heard = not problem and machine == name
        publisher = seen.TopicPublisher(talker_of(name), f"http://{host}:{NODES}/")
        publishers = (publisher,) if large or heard else ()
        if heard:
            return seen.HeardTopic(name, topic, publishers, heard=True, text=f"run {name}", seconds=0.2)
        step = "told" if publishers else ""
        reached = ("open" if not problem else problem) if publishers else ""
        outcome = CONNECTED.get(problem, Outcome.UNKNOWN_NAME) if publishers else Outcome.NOT_TRIED
        return seen.HeardTopic(
            name,
            topic,
            publishers,
            reached,
            outcome,
            step,
            error="nothing" if large else f"{uri}: no whole answer within 5 s",
        )

    # What roscores hold

    def own_topics(self, robot):
        """The registrations of a robot's own nodes, without talkers."""
        its = self.state.robots[robot]
        base, talker = f"/{robot}/base", f"/{robot}/talker"
        sums = {**SUMS, **its.sums}
        chatters = [talker, *its.ghosts, *([its.node] if its.node else [])]
        return [
            seen.RegisteredTopic(f"/{robot}/odom", "nav_msgs/Odometry", (base,), (), sums["nav_msgs/Odometry"]),
            seen.RegisteredTopic("/chatter", TALKS, tuple(chatters), (base,), sums[TALKS]),
            seen.RegisteredTopic("/rosout", "rosgraph_msgs/Log", (base, talker), ("/rosout",)),
        ]

    def node_services(self, robot):
        base = f"/{robot}/base"
        return [seen.RegisteredService(f"/{robot}/reset", base), seen.RegisteredService(f"{base}/get_loggers", base)]

    def exchange(self, computer):
        """The content of the roscore of a master's computer."""
        robot = self.fleet.computers[computer].robot
        if not self.works(robot):
            return seen.Exchange(error=self.asks(computer)[0])
        if self.state.robots[robot].sync != DEAD:
            return people.add(self, computer, self._exchange(computer, robot))
        return self._exchange(computer, robot)

    def _exchange(self, computer, robot):
        its = self.state.robots[robot]
        if its.sync == DEAD:
            return seen.Exchange(error=f"{self.uri(robot)}: no master_sync reports its registrations")
        topics = self.own_topics(robot)
        topics += [
            seen.RegisteredTopic(topic_of(name), TALKS, (talker_of(name),), (), SUMS[TALKS])
            for name in self.talkers(robot)
        ]
        imports, connections = [], []
        for other in self.state.robots:
            if other == robot or not (self.takes(robot, other) or (its.sync == HUNG and self.lists(robot, other))):
                continue
            component = self._import(robot, other)
            if component.topics or component.services:
                imports.append(component)
            if any(entry.name == "/chatter" and entry.publishers for entry in component.topics) and self._connected(
                computer, other
            ):
                host = self.state.master(other)
                connections.append(
                    seen.NodeConnection(f"/{robot}/base", "/chatter", "in", f"/{other}/talker", host, other)
                )
        return seen.Exchange(
            topics=tuple(topics),
            services=tuple(self.node_services(robot)),
            imports=tuple(imports),
            silent=(*its.ghosts, *self._hung(its)),
            silences=(
                *(seen.SilentNode(node, computer, "Connection refused", Outcome.REFUSED) for node in its.ghosts),
                *(seen.SilentNode(node, computer, "timed out", Outcome.NO_ANSWER) for node in self._hung(its)),
            ),
            connections=tuple(connections),
        )

    def sources(self, computer):
        """The answers of the discovery nodes about the talkers' topics: of the own ones, and of those that are missing here."""
        robot = self.fleet.computers[computer].robot
        if not self.works(robot):
            return ()
        found = []
        for master in self.fleet.masters:
            topics = tuple(map(topic_of, self.talkers(master.robot)))
            if master.robot != robot:
                here = set(map(topic_of, self.imported_talkers(robot, master.robot)))
                wanted = map(topic_of, self.fleet.talkers_by_robot(self.run)[robot])
                its = {topic_of(entry.name) for entry in self.fleet.members if entry.robot == master.robot}
                topics = tuple(sorted((its & set(wanted)) - here))
            if topics:
                found.append(self._source(computer, master, topics))
        return tuple(found)

    def _source(self, computer, master, topics):
        error, machine = self.network.connect(computer, master.address, master.rpc_port)
        its = self.state.robots[master.robot]
        if error or machine != master.computer or its.discovery != RUNS or not self.works(master.robot):
            return seen.GivenTopics(master.computer, topics, error=error or "timed out", outcome=Outcome.NO_ANSWER)
        if computer != master.computer and not self._large(machine, computer, master.address):
            return seen.GivenTopics(master.computer, topics, error="timed out", outcome=Outcome.NO_ANSWER)
        has = set(map(topic_of, self.talkers(master.robot)))
        return seen.GivenTopics(master.computer, topics, tuple(sorted(has & set(topics))), outcome=Outcome.ANSWERED)

    @staticmethod
    def _hung(its):
        """The nodes of the collection that are registered and do not answer."""
        nodes = {"/master_discovery": its.discovery, "/master_sync": its.sync}
        return tuple(node for node, state in nodes.items() if state == HUNG)

    def parameters(self, computer):
        """The parameters on the roscore of a master's computer that are not as planned."""
        error, robot, _large = self.asks(computer)
        if error:
            return seen.NodeParameters(error=error)
        its, planned = self.state.robots[robot], self.fleet
        entries = [
            ("master_discovery", "mcast_group", planned.multicast_group, its.group),
            ("master_discovery", "mcast_port", planned.multicast_port, its.port),
            ("master_discovery", "exports", True, its.gives),
            ("master_sync", "ignore_topics", [], [] if its.takes else ["*/odom"]),
        ]
        nodes = ("master_discovery", "master_sync")
        return seen.NodeParameters(
            nodes,
            tuple(seen.ParameterDifference(*map(str, entry)) for entry in entries if str(entry[2]) != str(entry[3])),
        )

    def _connected(self, computer, other):
        error, machine, _address = self.reach(computer, self.started_as(self.state.master(other)), NODES)
        return not error and machine == self.state.master(other)

    def _import(self, target, source):
        """The registrations that a robot has of another one."""
        topics = []
        for entry in self.own_topics(source):
            ends = {
                kind: tuple(
                    node
                    for node in getattr(entry, kind + "s")
                    if self.passes(source, target, RegisteredItem(kind, entry.name, node), entry.type)
                    and not self._refused(target, source, entry, node)
                )
                for kind in ("publisher", "subscriber")
            }
            if ends["publisher"] or ends["subscriber"]:
                topics.append(seen.RegisteredTopic(entry.name, entry.type, ends["publisher"], ends["subscriber"]))
        for name in self.imported_talkers(target, source):
            topics.append(seen.RegisteredTopic(topic_of(name), TALKS, (talker_of(name),)))
        services = tuple(
            entry
            for entry in self.node_services(source)
            if self.passes(source, target, RegisteredItem("service", entry.name, entry.node), "")
        )
        return seen.Import(self.uri(source), tuple(topics), services)

    def _refused(self, target, source, entry, node):
        """Return True if the bundled sync node refuses it: another type, and the name of an own node."""
        one, other = self.state.robots[target], self.state.robots[source]
        if node in (one.node, other.node) and one.node == other.node:
            return True
        sums = [{**SUMS, **its.sums}.get(entry.type, "") for its in (one, other)]
        return sums[0] != sums[1] and any(entry.name == own.name for own in self.own_topics(target))
