# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The program that listens, with the parts of ROS that it needs pretended."""

import json
import sys
import threading
import time
import types

from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import listener as probe_listener


def test_the_listener_waits_for_what_this_run_says(monkeypatch, capsys):
    """The program itself, with a rospy that delivers at once: first what an older talker says, then this run's."""
    subscribed = []

    class Message:
        def __init__(self, data):
            self.data, self._connection_header = data, {"callerid": "/talker"}

    def subscriber(topic, kind, hear, argument):
        subscribed.append(topic)
        hear(Message("old"), argument)
        if topic == "/a":
            threading.Timer(0.2, hear, (Message("run a"), argument)).start()

    rospy = types.SimpleNamespace(
        init_node=lambda *arguments, **options: None,
        Subscriber=subscriber,
        is_shutdown=lambda: False,
        signal_shutdown=lambda reason: None,
    )
    message = types.SimpleNamespace(String=object)
    for name, module in (("rospy", rospy), ("std_msgs", types.SimpleNamespace(msg=message)), ("std_msgs.msg", message)):
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(probe_listener.os, "_exit", lambda status: None)
    began = time.monotonic()
    probe_listener.main("listener", time.time() + 60, {"/a": "run a"})
    assert time.monotonic() - began < 50
    probe_listener.main("listener", time.time() + 0.3, {"/b": "run b"})
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert subscribed == ["/a", "/b"]
    assert (first["/a"]["text"], first["/a"]["node"], second["/b"]["text"]) == ("run a", "/talker", "old")
