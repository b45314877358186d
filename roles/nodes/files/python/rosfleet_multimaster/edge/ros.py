# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The ROS side of the two nodes: the only module that imports rospy and the message classes."""

import logging
import os
import sys
import urllib.parse
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

# rospy would write log files: its configuration is replaced before it is imported.
_PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
os.environ["ROS_PYTHON_LOG_CONFIG_FILE"] = os.path.join(_PACKAGE, "logging.conf")
if "RUNTIME_DIRECTORY" in os.environ:  # systemd's: the only folder that a service may write
    os.environ.setdefault("ROS_HOME", os.environ["RUNTIME_DIRECTORY"])
    os.environ.setdefault("ROS_LOG_DIR", os.environ["RUNTIME_DIRECTORY"])

import rosgraph
import rosgraph.network
import roslib.message
import rospy
import std_srvs.srv
from fkie_multimaster_msgs import msg, srv

from ..protocol.messages import AnnouncedMaster, DiagnosticEntry, LinkQuality, Registration
from . import diagnostic_classes
from .patience import run_with_limit
from .rpc_client import cut

_log = logging.getLogger("rosfleet.ros")


def master_uri() -> str:
    """ROS_MASTER_URI."""
    return str(rosgraph.get_master_uri())


def hostname() -> str:
    """The name of this computer in URIs: ROS_HOSTNAME, ROS_IP or its own name."""
    return str(rosgraph.network.get_host_name())


def node_name(default: str) -> str:
    """The full name that the node will have, remappings considered."""
    mappings = rosgraph.names.load_mappings(sys.argv)
    namespace = mappings.get("__ns", os.environ.get("ROS_NAMESPACE", "/"))
    return str(rosgraph.names.ns_join(rosgraph.names.make_global_ns(namespace), mappings.get("__name", default)))


def start(default_name: str) -> Tuple[str, str]:
    """Become a ROS node. Return its name and URI. Signals stay with the program."""
    rospy.init_node(default_name, disable_signals=True, log_level=rospy.WARN)
    return rospy.get_name(), str(rospy.get_node_uri())


def on_shutdown(callback: Callable[[str], None]) -> None:
    """Call back with the reason when another program ends the node (another node with its name, `rosnode kill`)."""
    rospy.core.add_preshutdown_hook(lambda reason: callback(str(reason)))


def stop(reason: str) -> None:
    """Withdraw the node's registrations."""
    rospy.signal_shutdown(reason)


def md5sum(type_name: str) -> Optional[str]:
    """The md5 sum of a message type, None if it is not installed."""
    try:
        found = roslib.message.get_message_class(type_name)
    except Exception:  # whatever the import of a foreign package raises
        return None
    return str(found._md5sum) if found else None


# Messages


def _to_ros_master(master: AnnouncedMaster) -> Any:
    return msg.ROSMaster(
        name=master.name,
        uri=master.uri,
        last_change=diagnostic_classes.to_time(master.stamp),
        last_change_local=diagnostic_classes.to_time(master.local_stamp),
        online=master.online,
        discoverer_name=master.discoverer,
        monitoruri=master.monitor_uri,
    )


def _from_ros_master(master: Any) -> AnnouncedMaster:
    stamp, local_stamp = master.last_change.to_sec(), master.last_change_local.to_sec()
    return AnnouncedMaster(
        master.name, master.uri, master.monitoruri, master.discoverer_name, stamp, local_stamp, master.online
    )


class Diagnostics:
    """The topic /diagnostics."""

    def __init__(self) -> None:
        self._messages = diagnostic_classes.messages()
        self._topic = rospy.Publisher("/diagnostics", self._messages.DiagnosticArray, queue_size=1, latch=True)

    def has_listeners(self) -> bool:
        """True if a node has subscribed."""
        return bool(self._topic.get_num_connections())

    def publish(self, parts: Sequence[DiagnosticEntry], now: float, robot: str) -> None:
        """Publish these entries of a robot; the last message stays for who comes later. `now` is the wall clock."""
        hardware = "/".join(filter(None, (robot, hostname())))
        self._topic.publish(diagnostic_classes.build_array(self._messages, parts, now, hardware))


# master_discovery


class DiscoveryNode:
    """The topics and services of master_discovery."""

    def __init__(self, masters: Callable[[], Sequence[AnnouncedMaster]], refresh: Callable[[], None]) -> None:
        """`masters` and `refresh` are called in threads of rospy."""
        self._changes = rospy.Publisher("~changes", msg.MasterState, queue_size=100)
        self._links = rospy.Publisher("~linkstats", msg.LinkStatesStamped, queue_size=1)

        def list_masters(_request: Any) -> Any:
            return srv.DiscoverMastersResponse([_to_ros_master(master) for master in masters()])

        def handle_refresh(_request: Any) -> Any:
            refresh()
            return std_srvs.srv.EmptyResponse()

        self.list_masters = rospy.Service("~list_masters", srv.DiscoverMasters, list_masters)
        rospy.Service("~refresh", std_srvs.srv.Empty, handle_refresh)

    def service_uri(self) -> Tuple[str, str]:
        """Name and URI of a service of this node: the entry at the roscore."""
        return str(self.list_masters.resolved_name), str(self.list_masters.uri)

    def publish_change(self, change: str, master: AnnouncedMaster) -> None:
        """Publish that a master is new, changed or removed."""
        self._changes.publish(msg.MasterState(state=change, master=_to_ros_master(master)))

    def links(self, own_name: str, links: Callable[[], Iterable[LinkQuality]], now: float) -> None:
        """Publish the quality of the links if a node listens; `now` is the wall clock."""
        if self._links.get_num_connections() == 0:
            return
        message = msg.LinkStatesStamped()
        message.header.stamp, message.header.frame_id = diagnostic_classes.to_time(now), own_name
        message.links = [
            msg.LinkState(link.name, link.quality, diagnostic_classes.to_time(now - link.silent)) for link in links()
        ]
        self._links.publish(message)


SYNC_INFO_TIMEOUT, LIST_TIMEOUT = 1.0, 5.0  # seconds


def _end(proxy: Any) -> None:
    """Cut the connection of a service: rospy waits for its answer for ever."""
    connection = getattr(proxy.transport, "socket", None)
    if connection is not None:
        cut(connection)
    proxy.close()


def sync_info(service: str) -> Dict[Tuple[str, str], str]:
    """(node, URI) -> URI of its master: the registrations of another implementation of master_sync. Blocks; may raise."""
    # Persistent: only then its connection is known.
    proxy = rospy.ServiceProxy(service, srv.GetSyncInfo, persistent=True)
    try:
        hosts = run_with_limit(SYNC_INFO_TIMEOUT, proxy).hosts
    finally:
        _end(proxy)
    parts = ((host, entry) for host in hosts for entry in [*host.publisher, *host.subscriber, *host.services])
    return {(entry.node, entry.nodeuri): host.masteruri for host, entry in parts}


# master_sync


class SyncNode:
    """The topics and services of master_sync."""

    def __init__(self, held: Callable[[], Mapping[Registration, str]]) -> None:
        """`held` is called in threads of rospy."""
        self._subscriber: Any = None
        self._subscribed = ""
        self._service = rospy.Service("~get_sync_info", srv.GetSyncInfo, lambda _request: _sync_info(held()))

    def service_uri(self) -> Tuple[str, str]:
        """Name and URI of a service of this node: the entry at the roscore."""
        return str(self._service.resolved_name), str(self._service.uri)

    def subscribe(self, topic: str, callback: Callable[[str, AnnouncedMaster], None]) -> None:
        """Listen to `~changes` of the discovery node; `callback` is called in a thread of rospy."""
        if topic != self._subscribed:
            if self._subscriber is not None:
                self._subscriber.unregister()
            self._subscriber = rospy.Subscriber(
                topic,
                msg.MasterState,
                lambda message: callback(message.state, _from_ros_master(message.master)),
                queue_size=1000,
            )
            self._subscribed = topic


class ListMasters:
    """The list of a discovery node, which is asked for again and again: over one connection. For one thread at a time."""

    def __init__(self) -> None:
        self._service = ""
        self._proxy: Any = None

    def __call__(self, service: str) -> List[AnnouncedMaster]:
        """Ask for the list. Blocks; may raise."""
        if service != self._service or self._proxy is None:
            self._drop()
            self._service, self._proxy = service, rospy.ServiceProxy(service, srv.DiscoverMasters, persistent=True)
        try:
            return [_from_ros_master(master) for master in run_with_limit(LIST_TIMEOUT, self._proxy).masters]
        except Exception:
            self._drop()
            raise

    def _drop(self) -> None:
        proxy, self._proxy = self._proxy, None
        if proxy is not None:
            _end(proxy)


def _sync_info(held: Mapping[Registration, str]) -> Any:
    hosts: Dict[str, Any] = {}
    nodes: Dict[str, Dict[str, None]] = {}  # of each host, once
    for entry, master in sorted(held.items()):
        host = hosts.setdefault(master, msg.SyncMasterInfo(masteruri=master))
        nodes.setdefault(master, {})[entry.node] = None
        if entry.kind == "service":
            host.services.append(msg.SyncServiceInfo(entry.name, entry.service_uri, entry.node, entry.node_uri))
        else:
            part = host.publisher if entry.kind == "publisher" else host.subscriber
            part.append(msg.SyncTopicInfo(entry.name, entry.node, entry.node_uri))
    for master, host in hosts.items():
        host.nodes = list(nodes[master])
    return srv.GetSyncInfoResponse(list(hosts.values()))


def master_name(uri: str) -> str:
    """The name of a master by upstream's rule: the host of its URI, and the port of ROS_MASTER_URI if it is unusual."""
    port = urllib.parse.urlsplit(master_uri()).port
    host = urllib.parse.urlsplit(uri).hostname or ""
    return host if port in (None, 11311) else f"{host}_{port}"
