# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The sentences of multicast_verify about its helper: none has the label of the run, which seals the messages."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import multicast
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.helper import HelperSettings
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast.helper_process import plain

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
