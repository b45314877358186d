# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A master that is not in the inventory, and one that takes the identity of a robot: named, and otherwise ignored."""

import json
import re
import time

import pytest
from links import until
from subject import NODES

VICTIM, PEER = "kobuki1computer", "kobuki2computer"
ADDRESS, ROGUE = "192.168.1.229", "192.168.1.66"
SECONDS = 12
IDENTITIES = {
    "a rogue": ("http://rogue:11311/", "rogue", "it is no robot of the fleet"),
    "a thief": (f"http://{PEER}:11311/", PEER, f"it says that it is {PEER}, which is at 192.168.1.239"),
}


def masters(lab):
    """(name, online, monitor URI) of list_masters."""
    listed = lab.run(VICTIM, "rosservice call /master_discovery/list_masters", check=False)
    return sorted(re.findall(r'(?<!_)name: "?(\w+).*?online: (\w+).*?monitoruri: "?([^"\n]+)', listed, re.DOTALL))


@pytest.fixture(scope="module")
def fleet(lab):
    """Both robots know each other; the second computer has the address of a stranger besides."""
    until(lambda: len(masters(lab)) == 2, 30, "both masters")
    lab.run(PEER, f"ip address add {ROGUE}/24 dev eth0; cat > /run/rogue.py", stdin=(NODES / "rogue.py").read_text())
    yield lab
    lab.run(PEER, f"ip address del {ROGUE}/24 dev eth0")


@pytest.mark.parametrize("who", IDENTITIES)
def test_whoever_does_not_belong_to_the_fleet_is_named_and_ignored(fleet, who):
    uri, name, why = IDENTITIES[who]
    before = masters(fleet)
    fleet.run(VICTIM, "systemctl restart multimaster-discovery")  # what it knows of strangers is of this test alone
    until(lambda: masters(fleet) == before, 30, "the same masters again")
    since = time.time()
    called = json.loads(fleet.run(PEER, f"python3 /run/rogue.py {ROGUE} {ADDRESS} {uri} {name} {SECONDS}"))
    assert 1 <= called["connections"] <= 2 and set(called["methods"]) == {"masterContacts"}, called
    assert called["answers"] == 0, "its datagrams are not answered"
    assert masters(fleet) == before
    held = fleet.run(VICTIM, "rostopic list")
    assert "/rogue/cmd_vel" not in held
    log = fleet.run(VICTIM, f"journalctl --unit multimaster-discovery --output cat --since @{since - 1:.0f}")
    assert log.count(f"{name} ({uri}) at {ROGUE} is ignored: {why}") == 1, log
    ask = f"import xmlrpc.client as x; print(x.ServerProxy('http://{ADDRESS}:11611').getOutsiders()[1])"
    assert f"['{ROGUE}', '{name}', '{uri}', '{why}']" in fleet.run(VICTIM, f'python3 -c "{ask}"')
