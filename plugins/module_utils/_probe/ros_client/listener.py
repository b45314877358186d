# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A node that subscribes many topics of texts, like `rostopic echo` for each, and needs no rospy.

It is registered at the roscore, which sends it the publishers; it asks each of them for its topic, and reads a message.
"""

import os
import queue
import re
import threading
import time
import typing
from functools import partial

from ..._base.plain_text import quote
from ..._base.problem import explain_error
from . import node, tcpros
from .hosts import spell_host
from .ros import Ros
from .xml_rpc import server

WORKERS = 32  # publishers that are asked at the same time: one that does not answer takes its worker for some seconds
AGAIN = 0.5  # seconds until a publisher is asked again that did not answer
FAREWELL = 30.0  # seconds in which a busy roscore may take the registrations back
# How far a call has come: the roscore has announced a publisher, that has named the port of its topic, its data port is open.
TOLD, ANSWERED, CONNECTED = "told", "answered", "connected"

Message = typing.Dict[str, typing.Any]


def place_of(topic: str, uri: str, caller: str) -> typing.Tuple[str, int]:
    """Ask a publisher for the port of its topic. Raises OSError, and the errors of a strange answer."""
    code, answer, place = server(uri).requestTopic(caller, topic, [["TCPROS"]])
    if code != 1:
        raise OSError(f"it does not give the topic: {quote(answer)}")
    host, port = spell_host(str(place[1])), int(place[2])
    if not host:
        raise OSError(f"it gives the topic at {quote(place[1])}, which is no usual spelling of a host")
    return host, port


def listener_of(computer: str) -> str:
    """Return the beginning of the node name of a computer's listener."""
    return re.sub(r"\W", "_", f"multimaster_verify_listener_{computer}")


class TopicListener:
    """Subscribes topics until each has said its text."""

    def __init__(self, ros: Ros, name: str, wanted: typing.Mapping[str, str]) -> None:
        """`wanted`: {topic: its text}. Raises OSError."""
        self.ros, self.wanted = ros, wanted
        self.heard: typing.Dict[str, Message] = {}  # topic -> text, node, seconds
        self.errors: typing.Dict[str, str] = {}  # topic -> why a publisher of it could not be heard
        self.steps: typing.Dict[str, str] = {}  # topic -> how far the call to a publisher of it has come
        self._began = time.monotonic()
        self._publishers: typing.Dict[str, typing.Set[str]] = {topic: set() for topic in wanted}
        self._due: queue.PriorityQueue[typing.Tuple[float, str, str]] = queue.PriorityQueue()  # when, topic, publisher
        self._lock = threading.Lock()
        self._open = set(wanted)  # topics whose publisher has yet to say it
        self._done = threading.Event()
        self.name = f"/{name}_{os.getpid()}_{int(time.time() * 1000)}"
        self.node = node.ProbeNode(self.name, node.host_of(ros.variables, ros.uri), ros.uri, {}, self._on_publishers)

    def run(self, deadline: float) -> None:
        """Listen until everything is heard, or until the deadline (monotonic seconds). Raises OSError without a roscore."""
        for work in [self.node.serve] + [self._work] * min(WORKERS, len(self.wanted)):
            threading.Thread(target=work, daemon=True).start()
        topics: typing.List[str] = []
        try:
            for topic in self.wanted:
                topics.append(topic)  # also if the answer does not come in time: the roscore may carry it out
                self._on_publishers(
                    topic, self.ros.ask("registerSubscriber", topic, node.TYPE, self.node.uri, caller=self.name)
                )
            self._done.wait(max(0.0, deadline - time.monotonic()))
        finally:
            self._done.set()
            self._leave(topics, time.monotonic() + FAREWELL)
            self.node.ended = True

    def _leave(self, topics: typing.Sequence[str], deadline: float) -> None:
        """Take the registrations back. A registration that stays would be a node that does not answer, on every robot."""
        for topic in topics:
            while time.monotonic() < deadline:
                try:
                    self.ros.ask("unregisterSubscriber", topic, self.node.uri, caller=self.name, patient=True)
                    break
                except OSError as problem:
                    if isinstance(problem.__cause__, ConnectionRefusedError):
                        return  # the roscore has ended
                    time.sleep(AGAIN)

    def _on_publishers(self, topic: str, publishers: typing.Any) -> None:
        """Ask the publishers that are new."""
        if topic not in self.wanted or not isinstance(publishers, list):
            return
        now = {uri for uri in publishers if isinstance(uri, str)}
        with self._lock:
            new, self._publishers[topic] = now - self._publishers[topic], now
        for uri in sorted(new):
            self.steps.setdefault(topic, TOLD)
            self._due.put((time.monotonic(), topic, uri))  # behind those that wait: who names ever more delays no other

    def _work(self) -> None:
        while not self._done.is_set():
            try:
                due, topic, uri = self._due.get(timeout=0.1)
            except queue.Empty:
                continue
            if due > time.monotonic():
                self._due.put((due, topic, uri))
                self._done.wait(0.05)
                continue
            if topic not in self._open or uri not in self._publishers[topic]:
                continue
            steps = [TOLD]
            try:
                place = place_of(topic, uri, self.name)
                steps.append(ANSWERED)
                self._hear(topic, *tcpros.hear(place, topic, self.name, partial(steps.append, CONNECTED)))
            except Exception as problem:  # whatever a stranger answers
                self.errors[topic], self.steps[topic] = f"{quote(uri)}: {quote(explain_error(problem))}", steps[-1]
                self._due.put((time.monotonic() + AGAIN, topic, uri))

    def _hear(self, topic: str, text: str, publisher: str) -> None:
        """Note a message; an older talker may come first."""
        with self._lock:
            if self.heard.get(topic, {}).get("text") != self.wanted[topic]:
                seconds = round(time.monotonic() - self._began, 1)
                self.heard[topic] = {"text": text, "node": publisher, "seconds": seconds}
            if text == self.wanted[topic]:
                self._open.discard(topic)
                if not self._open:
                    self._done.set()
