# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Fig. 10 and 12 of the report set up by hand on twelve computers and a router, then adopted. About three minutes."""

from pathlib import Path

import pytest
from setups import adoption, manual_setup
from subject import lab_of

ROOT = Path(__file__).resolve().parents[2]

INVENTORY = ROOT / "inventory" / "multi_computer"
ROUTER = "router"


@pytest.fixture(scope="module")
def lab():
    with lab_of("long-adopt", INVENTORY) as found:
        yield found


def set_up(lab, plan):
    """Sections 3.2 and 4.1 of the report: the environment of a person, forwarding, and routes until the next boot."""
    networks = {entry["network"]: entry["common_address"] for entry in plan["networks"]}
    gateways = {entry["robot"]: entry["gateway"] for entry in plan["networks"]}
    masters = {entry["robot"]: entry["computer"] for entry in plan["masters"]}
    for name, computer in plan["computers"].items():
        ways = {to: via for to, via in networks.items() if via != computer["common_address"]}
        lines = [f"ip route replace {to} via {via}" for to, via in ways.items()]
        if computer["is_gateway"] or computer["is_router"]:
            lines += ["sysctl -q -w net.ipv4.ip_forward=1 net.ipv4.conf.all.send_redirects=0"]
        else:
            lines = [f"ip route replace default via {gateways[computer['robot']]}"]
        if name != ROUTER:
            uri = f"http://{masters[computer['robot']]}:11311"
            lines += [f"printf 'export ROS_MASTER_URI={uri}\\nexport ROS_HOSTNAME={name}\\n' >> /root/.bashrc"]
        lab.run(name, "set -e; " + "; ".join(lines))


def test_twelve_computers_that_were_set_up_by_hand_are_adopted(lab, tmp_path):
    shipped = adoption.plan(lab, INVENTORY)
    addresses = {member["name"]: member["address"] for member in shipped["members"]}
    masters = [master["computer"] for master in shipped["masters"]]
    set_up(lab, shipped)
    with manual_setup.robots(lab, addresses, manual_setup.BUNDLED, masters=masters):
        folder = tmp_path / "adopted"
        status, output = adoption.adopt(lab, folder)
        assert status == 0 and "3 robots with 12 computers, a router; " in output, output
        assert "left out" not in output
        assert adoption.plan(lab, folder) == shipped
        for host in masters:
            lab.run(
                host, f"systemctl stop {manual_setup.SYNC} {manual_setup.DISCOVERY} {manual_setup.ROSCORE}", check=False
            )
        status, output = adoption.site_check(lab, folder)
        assert status == 0, output
    for host in shipped["computers"]:
        assert lab.run(host, "ls /etc/rosfleet-multimaster 2>/dev/null | wc -l").strip() == "0"
