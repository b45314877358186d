# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The guide docs/operate/hostile_networks.md: its inventory plans what it says."""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "operate" / "hostile_networks.md").read_text(encoding="utf-8")
PLAN = """
- hosts: robots
  gather_facts: false
  tasks:
    - rosfleet.multimaster.fleet_plan:
      register: plan
      run_once: true
    - ansible.builtin.copy: {content: "{{ plan | to_json }}", dest: "{{ inventory_dir }}/../plan.json", mode: "0644"}
      delegate_to: localhost
      run_once: true
"""


def test_the_inventory_of_the_guide(tmp_path):
    files = dict(re.findall(r"```yaml\n# (inventory/\S+)\n(.*?)```", PAGE, re.DOTALL))
    assert sorted(files) == ["inventory/group_vars/robots.yml", "inventory/hosts.yml"]
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "plan.yml").write_text(PLAN)
    program = Path(sys.executable).with_name("ansible-playbook")
    words = [program, "-i", tmp_path / "inventory", tmp_path / "plan.yml"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert plan["transport"] == "unicast"
    assert plan["let_in"] == ["10.77.0.229/32", "10.77.0.239/32"]  # no address of the wifi
    for name, other, endpoint in (
        ("kobuki1computer", "10.77.0.239", None),
        ("kobuki2computer", "10.77.0.229", "192.168.1.229"),
    ):
        own = plan["computers"][name]
        assert own["firewall"]["open_ports"] == ["51820/udp"] and own["services"][0] == "tunnel"
        assert other in own["discovery"]["robot_hosts"] and not own["discovery"]["send_mcast"]
        (peer,) = own["tunnel"]["peers"]
        assert (peer["networks"], peer["endpoint"] or None) == ([f"{other}/32"], endpoint)
