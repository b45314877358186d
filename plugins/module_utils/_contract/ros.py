# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The observations of a verification on ROS: roscores, discovery nodes, topics, and the exchange between robots."""

import typing

from .fields import Struct, field
from .outcomes import Outcome


class RoscoreAnswer(Struct):
    """The answer of the roscore that ROS_MASTER_URI names."""

    uri: str = field("C(ROS_MASTER_URI) in O(environment_file).", "http://kobuki1computer:11311")
    answer: str = field(
        "The master URI by which it knows itself, by C(getUri), or empty without an answer.",
        "http://kobuki1computer:11311/",
    )
    error: str = field("Why there was no answer, or empty.", "")
    outcome: Outcome = field("The same as one word, V(answered), or as RV(masters[].outcome).", "answered")
    tcp_outcome: Outcome = field(
        "If no answer came, the outcome of a TCP connection to it, a word of RV(masters[].outcome). V(open) if the kernel takes it.",
        "not_tried",
        added="1.1.0",
    )
    waiting: typing.Optional[int] = field(
        "If no answer came, how many connections wait at its port to be taken, null if it is not on this computer.",
        None,
        added="1.1.0",
    )


class ListedMaster(Struct):
    """A master in the answer of `rosservice call /master_discovery/list_masters`."""

    name: str = field("The name of the master.", "kobuki1computer", needed=True)
    uri: str = field("Its master URI.", "http://kobuki1computer:11311/")
    online: bool = field("Whether the discovery node takes it for online.", True)
    monitoruri: str = field("The URI at which its discovery node answers.", "http://192.168.1.229:11611")


class MasterList(Struct):
    """The answer of `rosservice call /master_discovery/list_masters`."""

    masters: typing.Tuple[ListedMaster, ...] = field("The masters.")
    seconds: float = field(
        "How long it took until all masters of O(present) were online, or until O(patience) was over.", 0.7
    )
    error: str = field("Why the last call failed, or empty.", "")


class TopicPublisher(Struct):
    """A registered publisher of a topic."""

    node: str = field(
        "The name of the node.", "/multimaster_verify_talker_kobuki2computer_verify_1730000000", needed=True
    )
    uri: str = field("The URI of the node, to which a subscriber connects directly.", "http://kobuki2computer:41233/")


class HeardTopic(Struct):
    """The topic of another computer's talker, and the message on it."""

    computer: str = field("The computer of the talker.", "kobuki2computer", needed=True)
    topic: str = field("Its topic.", "/multimaster_verify/kobuki2computer", needed=True)
    publishers: typing.Tuple[TopicPublisher, ...] = field(
        "The publishers of the topic as the roscore of this computer's robot knows them, as C(rostopic info) shows."
    )
    reached: str = field(
        "If a publisher is registered and nothing was heard, V(open) if a TCP connection to its URI opens, else why not; empty "
        "otherwise.",
        "",
    )
    reached_outcome: Outcome = field("The same as one word, as RV(masters[].outcome).", "not_tried")
    step: str = field(
        "If nothing was heard, how far the call to a publisher has come. V(told), the roscore has announced it to the listener; "
        "V(answered), it has named the port of its topic; V(connected), its data port is open. Empty otherwise, and if the "
        "roscore has announced none.",
        "",
    )
    listened: bool = field("Whether the listener of this computer ran.", True, default=True)
    heard: bool = field("Whether a subscriber on this computer hears the text of this run's talker.", True)
    text: str = field("The text that it heard.", "verify-1730000000 kobuki2computer")
    seconds: typing.Optional[float] = field("After how many seconds of listening, or null if it heard nothing.", 0.3)
    error: str = field("Why nothing was heard, or empty.", "")


class IgnoredSender(Struct):
    """A sender of heartbeats that the computer's discovery node ignores."""

    address: str = field("The address from which it sends.", "192.168.1.66", needed=True)
    name: str = field("The name that it says, or empty.", "rogue")
    uri: str = field("The URI of its master, or empty.", "http://rogue:11311/")
    why: str = field("Why it is ignored.", "it is no robot of the fleet")


class GivenTopics(Struct):
    """The topics that the discovery node of a master gives, of those that it was asked for."""

    computer: str = field("The computer of the discovery node.", "kobuki2computer", needed=True)
    topics: typing.Tuple[str, ...] = field(
        "The topics that it was asked for. Of the own one those of this robot's talkers, and those that it has not, 50 at most.",
        ["/multimaster_verify/kobuki2computer"],
    )
    given: typing.Tuple[str, ...] = field(
        "Those of them that it gives to this computer.", ["/multimaster_verify/kobuki2computer"]
    )
    error: str = field("Why it gave no answer, or empty.", "")
    outcome: Outcome = field(
        "The same as one word, V(answered), V(refused), V(no_answer), V(network_unreachable), V(host_unreachable), V(no_local_port), "
        "V(unknown_name) or V(failed).",
        "answered",
    )


class RegisteredTopic(Struct):
    """A topic with the nodes that registered it."""

    name: str = field("The name of the topic.", "/odom", needed=True)
    type: str = field("Its type as the roscore knows it, or empty.", "nav_msgs/Odometry")
    publishers: typing.Tuple[str, ...] = field("The nodes that publish it.", ["/base"])
    subscribers: typing.Tuple[str, ...] = field("The nodes that subscribe to it.", [])
    md5sum: str = field(
        "The md5 sum of the class of this type on this computer; empty if this computer does not have the class.",
        "cd5e73d190d741a2f92e81eda573aca7",
    )


class RegisteredService(Struct):
    """A service with the node that provides it."""

    name: str = field("The name of the service.", "/base/reset", needed=True)
    node: str = field("The node that provides it.", "/base", needed=True)


class Import(Struct):
    """The registrations that a roscore holds for another master."""

    master: str = field("The URI of the other master.", "http://kobuki2computer:11311/", needed=True)
    topics: typing.Tuple[RegisteredTopic, ...] = field(
        "As RV(exchange.topics), without the md5 sums.",
        [{"name": "/goal", "type": "geometry_msgs/Pose", "publishers": ["/planner"], "subscribers": []}],
    )
    services: typing.Tuple[RegisteredService, ...] = field("As RV(exchange.services).", [])


class SilentNode(Struct):
    """A registered node of the robot that does not answer."""

    node: str = field("The node.", "/camera", needed=True)
    host: str = field("The host in its URI.", "kobuki1computer")
    error: str = field("Why it does not answer.", "Connection refused")
    outcome: Outcome = field("The same as one word of RV(masters[].outcome).", "refused")
    tcp_outcome: Outcome = field(
        "The outcome of a TCP connection to it, V(open) if the node takes it and does not answer.", "refused"
    )
    port: int = field("The port in its URI.", 41233)


class UnreachedNode(Struct):
    """A node of another robot that is registered here, and to whose port no connection opens."""

    node: str = field("The node.", "/odom_pub", needed=True)
    host: str = field("The host in its URI.", "kobuki2computer")
    port: int = field("The port in its URI.", 41233)
    error: str = field("Why it does not open.", "no answer")
    outcome: Outcome = field("The same as one word of RV(masters[].outcome).", "no_answer")


class CrossingTopic(Struct):
    """A topic of another robot, heard here through both relays, as a node of this robot hears it."""

    topic: str = field("The topic, by its name here.", "/kobuki2/scan", needed=True)
    nodes: typing.Tuple[str, ...] = field("The nodes that publish it there.", ["/laser"])
    outcome: Outcome = field(
        "V(answered) if the header of a publisher came through both relays, or as RV(masters[].outcome).", "answered"
    )
    message: bool = field(
        "Whether a message came within a second after the header. Some topics are silent for long.", True
    )
    there: Outcome = field(
        "Where no header came: the same of the relay of the other robot alone, which is asked directly.", "not_tried"
    )
    error: str = field("Why no header came, or empty.", "")
    unlike: typing.Tuple[str, ...] = field(
        "The nodes of this robot that subscribe it with another type than that of its publisher, so nothing reaches them.",
        [],
    )


class SeenRelay(Struct):
    """The relay of another robot, as that of this robot reaches it."""

    robot: str = field("The robot.", "kobuki2", needed=True)
    host: str = field("Its address.", "192.168.1.239")
    port: int = field("The TCP port of its relay.", 11911)
    outcome: Outcome = field(
        "The outcome of the question for its offers, V(answered), or as RV(masters[].outcome).", "answered"
    )
    data_port: int = field("The TCP port of its data, as it answers, or 0.", 40811)
    data_outcome: Outcome = field("The outcome of a TCP connection to that port, as RV(masters[].outcome).", "open")
    error: str = field("Why one of the two failed, or empty.", "")
    crossing: typing.Tuple[CrossingTopic, ...] = field(
        "Two of the topics that come from that robot alone, none of images or point clouds if there are others."
    )


class AnnouncedHost(Struct):
    """An own node of a robot that announces a host which the plan does not have for its robot, or services elsewhere."""

    node: str = field("The node.", "/odom_pub", needed=True)
    host: str = field("The host in its URI.", "127.0.0.1")
    port: int = field("The port in its URI, 0 without one.", 41233)
    addresses: typing.Tuple[str, ...] = field(
        "The addresses of that host on the computer of the roscore, if it is a name.", []
    )
    services: str = field(
        "The host of its services, if that is another computer than the one of the node; else empty.", ""
    )


class HostOfNodes(Struct):
    """A host that nodes announce, and how many do."""

    host: str = field("The host, or empty for nodes whose URI has none.", "kobuki1computer", needed=True)
    nodes: int = field("The number of nodes.", 3)


class NodeCount(Struct):
    """The number of a robot's own nodes, and how many were asked for an answer."""

    registered: int = field("How many are registered.", 3)
    asked: int = field("How many of them were asked for an answer. Of more than 1000, one of every so many is.", 3)
    hosts: typing.Tuple[HostOfNodes, ...] = field("How many announce each host, 100 hosts at most.")


class NodeConnection(Struct):
    """A connection of an own node with a node of another robot."""

    node: str = field("The own node.", "/base", needed=True)
    topic: str = field("The topic.", "/goal", needed=True)
    direction: str = field("V(in), if the own node is the subscriber, or V(out).", "in", needed=True)
    peer: str = field("The other node, or its URI if this roscore does not know it.", "/planner", needed=True)
    host: str = field("The other end as the own node names it.", "kobuki2computer", needed=True)
    robot: str = field("The robot of that host.", "kobuki2", needed=True)


class Exchange(Struct):
    """The content of a roscore: own registrations, those for other masters, and connections with other robots."""

    error: str = field("Why it could not be read, or empty.", "")
    types_error: str = field("Why the md5 sums are not known, or empty.", "")
    topics: typing.Tuple[RegisteredTopic, ...] = field("The topics that the robot's own nodes have registered.")
    services: typing.Tuple[RegisteredService, ...] = field("The services of the robot's own nodes.")
    imports: typing.Tuple[Import, ...] = field(
        "The registrations for other masters, by the parameter C(/rosfleet_multimaster/imports), or by the service C(get_sync_info) of"
        " another implementation of master_sync."
    )
    silent: typing.Tuple[str, ...] = field(
        "The robot's own nodes that are registered and do not answer at their URI.", []
    )
    silences: typing.Tuple[SilentNode, ...] = field("The same, with the reason of each.", [])
    announced: typing.Tuple[AnnouncedHost, ...] = field(
        "The robot's own nodes that announce another host than the planned names and addresses of their robot, or whose services are on"
        " another computer, 100 at most.",
        added="1.1.0",
    )
    unreached: typing.Tuple[UnreachedNode, ...] = field(
        "The nodes of other robots that are registered here, and to whose port no TCP connection opens from here; of more than 300, one of "
        "every so many is tried.",
        [],
        added="1.1.0",
    )
    nodes: NodeCount = field("The number of the robot's own nodes.", added="1.1.0")
    connections: typing.Tuple[NodeConnection, ...] = field(
        "The connections of the robot's own nodes with nodes of other robots, by C(getBusInfo)."
    )
    types_outcome: Outcome = field(
        "What became of the question for the md5 sums, V(answered), V(no_answer) where its time was over, or V(failed).",
        "answered",
    )


class SentTopic(Struct):
    """The traffic of a topic from a node of the robot to the subscribers on another robot, by the node's own counters."""

    node: str = field("The publishing node.", "/camera", needed=True)
    topic: str = field("The topic.", "/image", needed=True)
    robot: str = field("The robot of the subscribers.", "kobuki2", needed=True)
    subscribers: int = field("The number of connections.", 1)
    bytes_s: float = field("The bytes a second on all of them.", 100000.0)
    messages_s: float = field("The messages a second on all of them.", 10.0)


class NodeTraffic(Struct):
    """The traffic from the nodes of a robot to nodes of other robots, measured for some seconds."""

    seconds: float = field("The time between the two readings.", 3.0)
    flows: typing.Tuple[SentTopic, ...] = field(
        "The topics of each node that subscribers on another robot get, those with most bytes first, 200 at most."
    )


class ParameterDifference(Struct):
    """A parameter of a node that is not as planned."""

    node: str = field("The node.", "master_discovery", needed=True)
    name: str = field("The parameter.", "mcast_port", needed=True)
    expected: str = field("The planned value as JSON, 200 characters at most.", "11511")
    found: str = field("The value as JSON, 200 characters at most, or C(not set).", "11512")


class CrossingParameter(Struct):
    """A parameter that two robots are to have alike."""

    name: str = field("The parameter.", "/robot_description", needed=True)
    digest: str = field(
        "A SHA-256 of its value, the same on each robot with that value; empty if it is not set.",
        "5feceb66ffc86f38d952786c6d696c79c2dbc239dd4e91b46729d73a27fb57e9",
    )


class NodeParameters(Struct):
    """The parameters of the nodes on the roscore, compared with the plan; `nodes` names the compared nodes."""

    nodes: typing.Tuple[str, ...] = field(
        "The nodes whose parameters were compared.", ["master_discovery", "master_sync"]
    )
    differing: typing.Tuple[ParameterDifference, ...] = field("The parameters with another value than planned.")
    crossing: typing.Tuple[CrossingParameter, ...] = field("The parameters of O(crossing).", added="1.1.0")
    simulated: bool = field(
        "Whether C(/use_sim_time) is true, so that nodes take their time from C(/clock).", False, added="1.1.0"
    )
    error: str = field("Why they could not be read, or empty.", "")


class Talker(Struct):
    """The talker of the computer itself."""

    running: bool = field("Whether it runs.", True, default=True)
    error: str = field("Why it does not run, or the last line that it wrote.", "")
    failed: bool = field(
        "Whether it should run and could not be started.", False, returned="when O(action=start)", kept=False
    )
    msg: str = field(
        "The same as a sentence.",
        "No talker: there is no command rostopic in the PATH of /etc/rosfleet-multimaster/environment; install it.",
        returned="when O(action=start) and it was not started",
        kept=False,
    )


class Stream(Struct):
    """The rate of a stream to another computer; None if it was not measured."""

    computer: str = field("The computer.", "kobuki2computer", needed=True)
    mbit_s: typing.Optional[float] = field("How many megabits came there in a second; null if that is not known.", 93.4)
    error: str = field("Why it is not known, or empty.", "")
