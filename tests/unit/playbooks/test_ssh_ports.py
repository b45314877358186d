# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet filter of every computer leaves the ports alone by which the inventory reaches others: site.yml makes it so, verify.yml expects it so."""

import pytest

from tests.unit.playbooks import test_one_robot

PORTS = '"ssh_ports": [2222]'
FILTERED = {"changed": False, "backend": "nftables", "members": [], "networks": [], "guards": [], "msg": ""}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("playbook", "module"), [("site.yml", "multimaster_computer"), ("verify.yml", "firewall")], ids=["site", "verify"]
)
def test_each_computer_gets_the_ports_of_the_inventory(tmp_path, playbook, module):
    def change(answers):
        answers["firewall"] = FILTERED

    options = (
        "-e",
        f"multimaster_firewall=fleet ansible_port=2222 verify_interval=0.1 verify_report={tmp_path}/report.json",
    )
    run = test_one_robot.played(tmp_path, playbook, change, *options)
    assert run.has_run(test_one_robot.ODD, module, PORTS), run.output
