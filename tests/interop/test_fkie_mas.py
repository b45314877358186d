# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The feature of fkie_mas alone: a daemon that starts programs for whoever calls its services."""

import shlex

import pytest
from fleet import DIRECTIONS, OURS, ROBOTS, THEIRS, eventually
from upstream import MAS, SETUP, UPSTREAM

pytestmark = pytest.mark.skipif(not MAS, reason="of fkie_mas alone: MAS=<checkout>")
BUTTONS = {f"/mas_daemon/{name}" for name in ("run", "start_launch", "load_launch", "list_nodes")}


def daemon():
    """The command of its daemon, as a person starts it in a terminal."""
    line = f"source {SETUP}; exec env {UPSTREAM.environment} python3 {UPSTREAM.place}/fkie_mas_daemon/nodes/mas-daemon"
    return f"bash -c {shlex.quote(line)}"


def test_each_daemon_serves_its_own_robot_alone():
    """One runs beside our nodes, one beside its own: neither is registered elsewhere, and no name is refused to the other."""
    for robot in (OURS, THEIRS):
        robot.start("daemon", daemon())
    for robot in (OURS, THEIRS):
        assert set(eventually(robot.services, lambda names: set(names) >= BUTTONS)) >= BUTTONS
    for giver, taker in DIRECTIONS:  # when this has crossed, the daemon's names would have too
        giver.publish(f"/after_the_daemon_of_{giver.label}")
        assert taker.hears(f"/after_the_daemon_of_{giver.label}")
    for robot in ROBOTS.values():
        if robot in (OURS, THEIRS):
            assert f"//{robot.host}:" in robot.run("rosservice uri /mas_daemon/run")
            assert robot.active("daemon")
        else:
            assert not BUTTONS & set(robot.services())
