# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs of the packet filter that are broken off, with each back end: nobody confirms, or the module is killed.

About ten minutes.
"""

import json
import re
import sysconfig
import time
from pathlib import Path

import pytest
from killed import UNTIL
from setups.packet_filters import make_filter_lab

ROOT = Path(__file__).resolve().parents[2]

INVENTORY = Path(__file__).with_name("firewall")
ROBOTS = {"ana-pc": "nftables", "bob-pc": "ufw", "cid-pc": "firewalld"}
ANSIBLE, COLLECTIONS = "/opt/ansible", "/opt/collections"
MOUNTS = (
    f"{sysconfig.get_path('purelib')}:{ANSIBLE}",
    f"{ROOT}:{COLLECTIONS}/ansible_collections/rosfleet/multimaster",
)
PYTHON = f"PYTHONPATH={ANSIBLE}:{COLLECTIONS} python3 -B"
MODULE = f"{PYTHON} -m ansible_collections.rosfleet.multimaster.plugins.modules.firewall /run/arguments"
OPTIONS = {
    "members": ["192.168.20.21", "192.168.20.22"],
    "also": [],
    "networks": ["192.168.20.0/28"],
    "open_ports": ["51820/udp"],
    "ssh_ports": [2222],
    "backend": "auto",
    "records": "/var/lib/rosfleet-multimaster",
}
# One run that is ended, as by kill -9, before its command or change of a file of this number.
KILLED = (
    UNTIL
    + """
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall import run
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import contract
contract.run_or_fail = until(contract.run_or_fail)
options, left = json.loads(sys.argv[1]), int(sys.argv[2])
made = run.FirewallRun(options)
made.apply()
print("changed" if made.changed else "right")
"""
)


@pytest.fixture(scope="module")
def lab():
    """The robots with their own packet filters, and with the modules of this checkout."""
    with make_filter_lab("long-firewall-broken-off", INVENTORY, ROBOTS, MOUNTS) as found:
        yield found


def by_hand(lab, host, **arguments):
    lab.run(host, "cat >/run/arguments", stdin=json.dumps({"ANSIBLE_MODULE_ARGS": arguments}))
    return json.loads(lab.run(host, MODULE, check=False))


def state(lab, host):
    """All that a run may change, without what firewalld keeps of former files and without counters of packets."""
    found = json.loads(lab.run(host, "python3 -", stdin=(ROOT / "lab/snapshot.py").read_text()))
    found["file"] = {path: entry for path, entry in found["file"].items() if not path.endswith(".old")}
    found["packet filter"] = re.sub(r"counter packets \d+ bytes \d+", "counter", found["packet filter"]["rules"])
    return {part: found[part] for part in ("file", "unit file", "packet filter")}


@pytest.mark.parametrize("host", ROBOTS)
def test_what_nobody_confirms_is_taken_back(lab, host):
    before = state(lab, host)
    arguments = {
        "members": OPTIONS["members"],
        "confirm_within": 20,
        "confirmation": "word",
    }  # ufw has a command for each rule
    assert by_hand(lab, host, **arguments)["unconfirmed"]
    after = state(lab, host)
    assert after["packet filter"] != before["packet filter"]
    changed = {path for path, entry in after["file"].items() if before["file"].get(path) != entry}
    assert all(path.startswith("/run/rosfleet") for path in changed), changed  # nothing that the next boot reads
    deadline = time.monotonic() + 60
    while lab.run(host, "ls /run/rosfleet-multimaster/rollback-firewall/rolled_back 2>/dev/null", check=False) == "":
        assert time.monotonic() < deadline
        time.sleep(0.3)
    result = by_hand(lab, host, members=[])
    assert "not confirmed within 20 s, were taken back" in json.dumps(result)
    assert state(lab, host) == before


@pytest.mark.parametrize("host", ROBOTS)
def test_a_run_that_is_confirmed_stays(lab, host):
    before = state(lab, host)
    arguments = {"members": OPTIONS["members"], "confirmation": "word"}
    assert by_hand(lab, host, confirm_within=60, **arguments)["unconfirmed"]
    second = by_hand(lab, host, **arguments)
    assert (second["unconfirmed"], second["changed"]) == (False, True)
    assert not by_hand(lab, host, members=OPTIONS["members"])["changed"]
    by_hand(lab, host, members=[])
    assert state(lab, host) == before


def is_whole(host, rules, good):
    """True where a killed run has left the old rules or the new ones. ufw takes them one by one: who is let in comes first."""
    if host != "bob-pc":
        return rules in ("", good)
    ours, wanted = ({line for line in text.splitlines() if "1024" in line} for text in (rules, good))
    return ours <= wanted and ("DENY" not in str(ours) or all("DENY" in line for line in wanted - ours))


@pytest.mark.parametrize("host", ROBOTS)
def test_kill_at_any_moment_leaves_what_the_next_run_mends(lab, host):
    untouched, step, killed = state(lab, host), 1, True
    # ufw has a command for each rule, so it gets few of them.
    wanted = OPTIONS if host != "bob-pc" else dict(OPTIONS, members=["192.168.20.21"], networks=[], open_ports=[])
    nothing = dict(OPTIONS, members=[], networks=[])

    def run(options, left):
        return lab.run(host, f"{PYTHON} - '{json.dumps(options)}' {left}", stdin=KILLED, check=False).strip()

    while killed:
        killed = run(wanted, step) == ""
        left = lab.shows(host)
        run(wanted, 0)
        assert run(wanted, 0) == "right", step
        good = lab.shows(host)
        assert is_whole(host, left, good), (step, left)
        run(nothing, step)
        assert is_whole(host, lab.shows(host), good), step
        run(nothing, 0)
        assert state(lab, host) == untouched, step
        step += 1
    assert step > 5
