# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The real master_discovery, with real sockets in a network namespace of its own. Only rospy and the roscore are played.

`python running_discovery.py STORY FOLDER` is called in a new namespace. Each function of `STORIES` is a story: it runs in
a thread beside the program, and the program ends with it.
"""

import functools
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
import types

PLANNED, GROUP, PORT, RPC_PORT = "192.168.1.1", "226.0.0.0", 11511, 11611
MEMBERS = [
    {
        "robot": "robot2",
        "name": "robot2",
        "uris": ["http://robot2:11311/"],
        "rpc_port": RPC_PORT,
        "addresses": ["192.168.1.9"],
        "hosts": ["robot2"],
    }
]


class Lab:
    """The program and what is around it."""

    def __init__(self, folder, parameters):
        from running_sync import Roscore  # it imports the nodes

        self.roscore, self.metrics = Roscore(), folder / "metrics.prom"
        self.notes, self.heard, self.nodes, self.diagnosed = [], [], [], []
        self.program, self.status = None, None
        values = {
            "interface": PLANNED,
            "rpc_port": RPC_PORT,
            "metrics": str(self.metrics),
            "members": MEMBERS,
            **parameters,
        }
        (folder / "parameters.json").write_text(json.dumps(values), encoding="utf-8")
        sys.argv[1:] = ["--parameters", str(folder / "parameters.json")]
        os.environ["NOTIFY_SOCKET"] = str(folder / "notify")
        receiver = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        receiver.bind(os.environ["NOTIFY_SOCKET"])
        for watch in (functools.partial(self.take_notes, receiver), self.listen):
            threading.Thread(target=watch, daemon=True).start()

    def take_notes(self, receiver):
        """Be systemd."""
        while True:
            self.notes += receiver.recv(65536).decode().splitlines()

    def listen(self):
        """Be another computer that hears the group."""
        from rosfleet_multimaster.discovery.udp import Udp
        from rosfleet_multimaster.protocol.heartbeat import decode

        udp = Udp(GROUP, PORT, "10.0.0.1", True)
        while True:
            for opened in udp.sockets:
                self.heard += [(decode(found.data).kind.name, found.source[0]) for found in udp.receive(opened)]
            time.sleep(0.005)

    def rospy(self):
        """The module edge/ros.py, without ROS."""
        ros = types.ModuleType("rosfleet_multimaster.edge.ros")
        ros.master_uri, ros.hostname = lambda: self.roscore.uri, lambda: "robot1"
        ros.node_name, ros.master_name = lambda default: f"/{default}", lambda uri: "robot1"
        ros.start = lambda default: (f"/{default}", "http://robot1:1/")
        ros.on_shutdown = ros.stop = lambda reason: None
        ros.md5sum = ros.sync_info = lambda name: None
        ros.DiscoveryNode = self.make_node
        ros.Diagnostics = lambda: types.SimpleNamespace(has_listeners=lambda: True, publish=self.note_diagnosis)
        return ros

    def note_diagnosis(self, entries, _now, _robot):
        self.diagnosed.append({entry.name: entry for entry in entries})

    def make_node(self, masters, _refresh):
        """The node in ROS. Which masters it lists at its start, and how much was sent and said before, is noted."""
        ready = "READY=1" in self.notes
        self.nodes.append(([master.name for master in masters()], self.program.datagrams.sent > 0, ready))
        service = "/master_discovery/list_masters", "rosrpc://robot1:2"
        self.roscore.call("registerService", "/master_discovery", *service, "http://robot1:1/")
        return types.SimpleNamespace(
            service_uri=lambda: service, publish_change=lambda *_news: None, links=lambda *_links: None
        )

    def run(self, story):
        """Run the program in the main thread, and a story beside it; the exit status."""
        sys.modules["rosfleet_multimaster.edge.ros"] = self.rospy()
        from rosfleet_multimaster import master_discovery

        made, problems = master_discovery.MasterDiscovery, []

        def make(start):
            self.program = made(start)
            return self.program

        def tell():
            try:
                story(self)
            except BaseException:
                problems.append(traceback.format_exc())
            os.kill(os.getpid(), signal.SIGTERM)

        master_discovery.MasterDiscovery = make
        threading.Thread(target=tell, daemon=True).start()
        assert master_discovery.main() == 0
        if not problems:
            until(lambda: ("LEAVE", PLANNED) in self.heard, "the others are told that it leaves")
            until(lambda: "STOPPING=1" in self.notes, "systemd is told that it stops")
            assert not self.metrics.exists()
        sys.stderr.write("".join(problems))
        return len(problems)


def until(condition, what, seconds=20.0):
    """Wait until something has happened. Return the seconds that it took."""
    began = time.monotonic()
    while not condition():
        if time.monotonic() - began > seconds:
            raise AssertionError(f"it does not happen: {what}")
        time.sleep(0.005)
    return time.monotonic() - began


def ip(*lines):
    """Change the network, by `ip` once."""
    subprocess.run(["ip", "-batch", "-"], input="\n".join(lines), text=True, check=True)


def start(lab):
    """Wait until the program is ready, and heard."""
    until(lambda: "READY=1" in lab.notes, "READY=1")
    until(lambda: ("STATE", PLANNED) in lab.heard, "a heartbeat")


def be_ready(lab):
    """READY=1 comes when the own master is listed and announced."""
    from rosfleet_multimaster.edge.rpc_client import Rpc

    start(lab)
    assert lab.nodes == [(["robot1"], True, False)], "listed, announced, and not ready before"
    assert Rpc(f"http://{PLANNED}:{RPC_PORT}", 3.0).call("masterContacts")[2] == "robot1"
    until(lambda: "STATUS=1 master: robot1" in lab.notes, "the status")


def wait_for_network(lab):
    """Without a network the node is ready for its own robot."""
    until(lambda: "READY=1" in lab.notes, "READY=1")
    assert lab.nodes == [(["robot1"], False, False)] and lab.heard == []
    until(lambda: any("; discovery cannot use " in note for note in lab.notes), "the status says why")
    ip(f"address add {PLANNED}/24 dev one")
    until(lambda: ("STATE", PLANNED) in lab.heard, "a heartbeat")
    until(lambda: lab.notes[-1] == "STATUS=1 master: robot1", "the status")


def move(lab):
    """With each new address the sockets are opened again, and not with the look of the next second."""
    start(lab)
    took, before = [], 1
    for number in (2, 3, 4, 5, 1):
        ip(f"address del 192.168.1.{before}/24 dev one", f"address add 192.168.1.{number}/24 dev one")
        moved = ("STATE", f"192.168.1.{number}")
        took.append(until(functools.partial(lab.heard.__contains__, moved), f"a heartbeat from {moved[1]}"))
        lab.heard.clear()
        before = number
    assert sorted(took)[2] < 0.4, took


def send_before_closing(lab):
    """Messages to send leave before the sockets close, since the link has come back."""

    def is_up():  # with its queue: a link with a carrier alone (LOWER_UP) drops what is sent until the kernel has made it
        shown = subprocess.run(["ip", "link", "show", "one"], capture_output=True, text=True, check=True).stdout
        return " state UP " in shown

    def come_back():  # in one pass of the loop: the link is up, a datagram is to be sent, and a look is due
        ip("link set one-end up")
        until(is_up, "the link is up")
        lab.program.core.announcements.leave()
        lab.program.address_looks.due = 0.0

    start(lab)
    datagrams = lab.program.datagrams
    before = datagrams._udp
    ip("link set one-end down")
    # The program closes its sockets then, and opens them in its next pass; in between it has none to send with.
    until(
        lambda: not datagrams.place.running and datagrams._udp not in (None, before),
        "it has sockets for the link that is down",
    )
    lab.program.loop.post(come_back)
    until(lambda: datagrams.place.running, "the link is up")
    until(lambda: ("LEAVE", PLANNED) in lab.heard, "what was to be sent", 3.0)
    lab.heard.clear()


def flap(lab):
    """Many changes of the network at once are looked at a few times."""
    start(lab)
    looks, take = [], lab.program.core.take_networks
    lab.program.core.take_networks = lambda networks: (looks.append(networks), take(networks))
    changes = [f"address {verb} 192.168.2.{number}/24 dev one" for number in range(1, 201) for verb in ("add", "del")]
    began = time.monotonic()
    ip(*changes, "address add 192.168.3.1/24 dev one")
    until(lambda: looks and "192.168.3.7" in looks[-1], "a look after the last change")
    assert len(looks) <= (time.monotonic() - began) / 0.1 + 2, f"{len(changes)} changes, {len(looks)} looks"


def show(lab):
    """/diagnostics and the metrics tell the same."""
    start(lab)
    until(lambda: lab.diagnosed and lab.metrics.exists(), "both are there")
    entries, text = lab.diagnosed[-1], lab.metrics.read_text()
    assert entries["multimaster: roscore"].level == 0 and "\nmultimaster_roscore_up 1\n" in text
    assert (
        entries["multimaster: link to robot2"].message == "not there"
        and '\nmultimaster_link_up{master="robot2"} 0\n' in text
    )
    assert "\nmultimaster_datagrams_sent_total " in text and "\nmultimaster_sent_bytes_total 0\n" in text
    assert lab.metrics.stat().st_mode & 0o777 == 0o644
    lab.roscore.server.stop()
    until(lambda: lab.diagnosed[-1]["multimaster: roscore"].level == 2, "the end of the roscore")


def miss_roscore(lab):
    """A roscore that does not tell its state is told of, from the start."""
    lab.roscore.tables = None
    until(lambda: any("does not answer" in note for note in lab.notes), "the status")
    assert "READY=1" not in lab.notes and lab.nodes == []
    lab.roscore.tables = {"Publisher": {}, "Subscriber": {}, "Service": {}}
    start(lab)


STORIES = {
    "be_ready": (be_ready, {}),
    "wait_for_network": (wait_for_network, {}),
    "move": (move, {"interface": ""}),
    "send_before_closing": (send_before_closing, {}),
    "flap": (flap, {}),
    "show": (show, {}),
    "miss_roscore": (miss_roscore, {}),
}


def main():
    """Prepare the network, and run the program with a story."""
    name, folder = sys.argv[1:]
    ip(
        "link set lo up",
        "link add name one type veth peer name one-end",
        "link set one up",
        "link set one-end up",
        "address add 10.0.0.1/32 dev one scope host",
        "route add 224.0.0.0/4 dev one",
        *([] if name == "wait_for_network" else [f"address add {PLANNED}/24 dev one"]),
    )
    story, parameters = STORIES[name]
    os.environ.pop("ROS_HOSTNAME", None)
    os.environ.pop("ROS_IP", None)
    return Lab(pathlib.Path(folder), parameters).run(story)


if __name__ == "__main__":
    sys.exit(main())
