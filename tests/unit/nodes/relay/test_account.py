# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The accounts of robots: a robot whose messages cost too much waits alone, and is named."""

from rosfleet_multimaster.edge.loop import Loop
from rosfleet_multimaster.relay.account import Accounts


def test_only_the_robot_that_has_spent_too_much_waits_and_is_named():
    accounts = Accounts(Loop(), ["bad", "good", "own"], "own")
    accounts.find("bad").spend(5.0)
    accounts.find("good").spend(0.001)
    assert not accounts.find("bad").may_go_on and accounts.find("good").may_go_on
    assert accounts.list_slowed() == ["bad"]
