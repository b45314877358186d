# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The sentences of multicast_verify about its helper: none has the label of the run, which seals the messages."""

import socket
import threading

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.background import Visit, open_door
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import multicast
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.helper import HelperSettings
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.helper_process import (
    HelperSockets,
    plain,
    serve,
)
from visiting import leave_silently

SETTINGS = HelperSettings("secret", "226.0.0.0", 11511, "eth0", "10.0.0.1", ("10.0.0.1",), {"10.0.0.1": "c0"}, 100)
PARAMS = {"rounds": 1, "interval": 0.1, "unicast": True, "icmp": False, "lifetime": 100}


class OtherHelper:
    """The door of a helper that was started with another port."""

    def __init__(self, _path, _request):
        pass

    def reply(self, _seconds):
        return {"settings": plain(SETTINGS._replace(port=11512))}


class SilentHelper(OtherHelper):
    def reply(self, _seconds):
        return None


class NoHelper:
    def __init__(self, path, _request):
        raise FileNotFoundError(2, "No such file or directory", path)


@pytest.mark.parametrize(
    ("door", "expected"),
    [
        (OtherHelper, "The helper of this run was started with other options"),
        (SilentHelper, "No helper of this run is listening on this computer"),
        (NoHelper, "No helper of this run is listening on this computer"),
    ],
)
def test_no_sentence_has_the_label_of_the_run(monkeypatch, door, expected):
    monkeypatch.setattr(multicast, "Visit", door)
    with pytest.raises(Problem, match=expected) as problem:
        multicast.collect(PARAMS, SETTINGS, 1)
    assert "secret" not in str(problem.value)


def test_a_silent_visitor_does_not_end_a_helper(tmp_path):
    path = str(tmp_path / "run" / "multicast.sock")
    copies, other = socket.socketpair()  # nothing comes from the network
    with copies, other, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control, open_door(path) as door:
        control.bind(("127.0.0.1", 0))
        control.setblocking(False)
        settings = SETTINGS._replace(group="127.0.0.1", port=control.getsockname()[1], lifetime=20)  # to itself
        thread = threading.Thread(target=serve, args=(HelperSockets(copies, control, door), settings, path))
        thread.start()
        leave_silently(path)
        reply = Visit(path, {"settings": []}).reply(10)
        Visit(path, {"do": "end"}).reply(10)
        thread.join(10)
    assert reply == {"settings": plain(settings)} and not thread.is_alive()
