# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The guide docs/operate/hostile_networks.md: its inventory plans what it says, and its tunnel works."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

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
    assert plan["let_in"] == ["10.77.0.1/32", "10.77.0.2/32"]  # no address of the wifi
    for name, other in (("kobuki1computer", "10.77.0.2"), ("kobuki2computer", "10.77.0.1")):
        own = plan["computers"][name]
        assert own["firewall"]["open_ports"] == ["51820/udp"]
        assert other in own["discovery"]["robot_hosts"] and not own["discovery"]["send_mcast"]


# Where the kernel has no WireGuard, wg-quick takes wireguard-go, if there is one.
NEEDED = ("wg", "wg-quick", "unshare", "nsenter")


def why_not():
    absent = [name for name in NEEDED if not shutil.which(name)]
    if absent:
        return f"needs {', '.join(absent)} (apt-get install wireguard-tools)"
    probe = ["unshare", "--net", "ip", "link", "add", "fleet", "type", "wireguard"]
    if subprocess.run(probe, capture_output=True, check=False).returncode and not shutil.which("wireguard-go"):
        return "this kernel has no WireGuard, and there is no wireguard-go (apt-get install wireguard-go)"
    return ""


# Two network namespaces with a wifi between them; each has a /run of its own for the sockets of wireguard-go.
TUNNEL = """
set -e
unshare --net --mount sleep 50 & there=$!
sleep 0.5
other() { nsenter --net=/proc/$there/ns/net --mount=/proc/$there/ns/mnt "$@"; }
trap 'wg-quick down $DIR/1/fleet.conf; other wg-quick down $DIR/2/fleet.conf; kill $there' EXIT
mount -t tmpfs tmpfs /run; other mount -t tmpfs tmpfs /run
ip link add wifi type veth peer name wifi netns $there
ip address add 192.168.1.229/24 dev wifi; ip link set wifi up
other ip address add 192.168.1.239/24 dev wifi; other ip link set wifi up
wg-quick up $DIR/1/fleet.conf; other wg-quick up $DIR/2/fleet.conf
other timeout 30 python3 -c '
import socket
connection, peer = socket.create_server(("10.77.0.2", 11311)).accept()
connection.sendall(b"heard from " + peer[0].encode())' &
sleep 1
timeout 20 cat </dev/tcp/10.77.0.2/11311
echo; wg show fleet latest-handshakes
"""


@pytest.mark.skipif(bool(why_not()), reason=why_not() or "can run")
def test_the_tunnel_of_the_guide(tmp_path):
    """The file of the guide on one computer, and the other way round on the other: they reach each other."""
    text = re.search(r"```ini\n(.*?)```", PAGE, re.DOTALL).group(1)
    there = {"10.77.0.1/24": "10.77.0.2/24", "10.77.0.2/32": "10.77.0.1/32", "192.168.1.239:": "192.168.1.229:"}
    other = re.sub("|".join(map(re.escape, there)), lambda found: there[found[0]], text)
    keys = [subprocess.run(["wg", "genkey"], capture_output=True, check=True).stdout for _computer in (text, other)]
    public = [
        subprocess.run(["wg", "pubkey"], input=key, capture_output=True, check=True).stdout.decode().strip()
        for key in keys
    ]
    for number, (conf, key, peer) in enumerate(zip((text, other), keys, reversed(public), strict=True), 1):
        folder = tmp_path / str(number)
        folder.mkdir(mode=0o700)
        (folder / "fleet.key").write_bytes(key)
        conf = re.sub("<the public key of .*?>", peer, conf).replace("/etc/wireguard", str(folder))
        (folder / "fleet.conf").write_text(conf)
    done = subprocess.run(
        ["unshare", "--net", "--mount", "bash", "-c", TUNNEL],
        env={"PATH": os.environ["PATH"] + ":/usr/sbin:/sbin", "DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "heard from 10.77.0.1" in done.stdout and public[1] in done.stdout  # the handshake was with this key
