# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The connections that may be ended."""

import pytest
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.sync.core.permission import find_refusal

ROBOT2 = {
    "robot": "robot2",
    "name": "robot2",
    "uris": ["http://robot2:11311/"],
    "rpc_port": 11611,
    "addresses": ["192.168.1.2"],
    "hosts": ["robot2", "192.168.1.2", "robot2-arm", "192.168.12.7"],
}
MEMBERS = Members.from_parameters({"members": [ROBOT2], "strangers": "allow", "allow": ["192.168.1.96/29"]})
HERE, OWN = ("192.168.1.1", 41000), {"192.168.1.1", "127.0.0.1", "192.168.1.97"}


@pytest.mark.parametrize(
    ("local", "remote", "why"),
    [
        (HERE, ("192.168.1.2", 40000), ""),
        (HERE, ("192.168.12.7", 40000), ""),  # another computer of the robot
        (HERE, ("192.168.1.98", 40000), ""),  # of who is allowed
        (HERE, ("192.168.1.66", 40000), "192.168.1.66 is no computer of the fleet"),  # whatever ~strangers says
        (HERE, ("127.0.0.1", 40000), "127.0.0.1 is this computer"),
        (HERE, ("192.168.1.97", 40000), "192.168.1.97 is this computer"),
        (HERE, ("192.168.1.2", 22), "port 22 is below 1024"),
        (("192.168.1.1", 22), ("192.168.1.2", 40000), "port 22 is below 1024"),
        (HERE, ("192.168.1.2", 11311), "port 11311 is that of a roscore or of discovery"),
        (("192.168.1.1", 11311), ("192.168.1.2", 40000), "port 11311 is that of a roscore or of discovery"),
        (HERE, ("192.168.1.2", 11611), "port 11611 is that of a roscore or of discovery"),
        (("192.168.1.1", 11611), ("192.168.1.2", 40000), "port 11611 is that of a roscore or of discovery"),
        (HERE, ("robot2", 40000), ""),  # no connection has a name for an address, so nothing is ended
    ],
)
def test_connections_with_computers_of_the_fleet_may_be_ended(local, remote, why):
    assert find_refusal(MEMBERS, local, remote, OWN) == why


def test_without_members_nothing_may_be_ended():
    assert "no computer of the fleet" in find_refusal(Members(), HERE, ("192.168.1.2", 40000), OWN)
