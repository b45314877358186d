# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The topic /diagnostics of the relay, which publishes without rospy."""

from typing import Sequence

from ..edge import diagnostic_classes
from ..edge.addresses import find_own_host
from ..protocol.messages import DiagnosticEntry
from .feed import TopicFeed

TOPIC = "/diagnostics"
TYPE = "diagnostic_msgs/DiagnosticArray"


class DiagnosticsPublisher:
    """The publisher, as edge/display.py wants one."""

    def __init__(self, feed: TopicFeed) -> None:
        self._feed, self._classes = feed, diagnostic_classes.messages()
        kind = self._classes.DiagnosticArray
        self._header = {"type": kind._type, "md5sum": kind._md5sum, "message_definition": kind._full_text}

    def has_listeners(self) -> bool:
        """True if a node has subscribed."""
        return self._feed.has_sinks

    def publish(self, parts: Sequence[DiagnosticEntry], now: float, robot: str) -> None:
        """Publish these entries of a robot; the last message stays for who comes later. `now` is the wall clock."""
        hardware = "/".join(filter(None, (robot, find_own_host())))
        message = diagnostic_classes.build_array(self._classes, parts, now, hardware)
        self._feed.publish(self._header, diagnostic_classes.serialize(message))
