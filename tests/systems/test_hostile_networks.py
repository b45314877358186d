# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The guide docs/hostile_networks.md: its inventory plans what it says, and where the kernel has WireGuard, its tunnel works."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "hostile_networks.md").read_text(encoding="utf-8")
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
    assert plan["let_in"] == ["10.77.0.1/32", "10.77.0.2/32"]  # no address of the wifi
    for name, other in (("kobuki1computer", "10.77.0.2"), ("kobuki2computer", "10.77.0.1")):
        own = plan["computers"][name]
        assert own["firewall"]["open_ports"] == ["51820/udp"]
        assert other in own["discovery"]["robot_hosts"] and not own["discovery"]["send_mcast"]


def has_wireguard():
    probe = ["unshare", "--net", "ip", "link", "add", "fleet", "type", "wireguard"]
    return bool(shutil.which("wg")) and subprocess.run(probe, capture_output=True, check=False).returncode == 0


TUNNEL = """
set -e

unshare --net sleep 60 & there=$!
sleep 0.5
in() { nsenter --net=/proc/$there/ns/net "$@"; }
ip link add wifi type veth peer name wifi netns $there
ip address add 192.168.1.229/24 dev wifi; ip link set wifi up
in ip address add 192.168.1.239/24 dev wifi; in ip link set wifi up
umask 077; for one in 1 2; do wg genkey > $DIR/$one; wg pubkey < $DIR/$one > $DIR/$one.pub; done
ip link add fleet type wireguard; in ip link add fleet type wireguard
wg set fleet private-key $DIR/1 listen-port 51820 peer $(cat $DIR/2.pub) allowed-ips 10.77.0.2/32 endpoint 192.168.1.239:51820
in wg set fleet private-key $DIR/2 listen-port 51820 peer $(cat $DIR/1.pub) allowed-ips 10.77.0.1/32 endpoint 192.168.1.229:51820
ip address add 10.77.0.1/24 dev fleet; ip link set fleet up
in ip address add 10.77.0.2/24 dev fleet; in ip link set fleet up
ping -c 3 -W 2 10.77.0.2
kill $there
"""


@pytest.mark.skipif(not has_wireguard(), reason="this kernel has no WireGuard, or there is no wg (wireguard-tools)")
def test_the_tunnel_of_the_guide(tmp_path):
    words = ["unshare", "--net", "bash", "-c", TUNNEL]
    done = subprocess.run(
        words,
        env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "DIR": str(tmp_path)},
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
