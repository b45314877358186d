# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Power that is cut in the middle of site.yml, of a rollback and of a teardown: the emulator is killed at drawn moments.

After the boot each file, unit, setting and rule is the old one or the new one, and the next run mends. LAB_CUTS is the number of
moments, LAB_SEED draws them: a moment is a number of writes to the disk. Each takes two to seven minutes if little else runs.
"""

import hashlib
import json
import os
import random
import re
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from machines import virtual
from machines.layout import hosts_of, read_inventory
from machines.podman import ROOT
from setups.links import wait_until

INVENTORY, HOST = Path(__file__).with_name("one"), "ana-pc"
SITE, ROLLBACK, TEARDOWN = KINDS = ("site.yml", "rollback", "playbooks/teardown.yml")
SEED = int(os.environ.get("LAB_SEED", "48"))
CUTS = [(KINDS[number % 3], f"{SEED}.{number}") for number in range(int(os.environ.get("LAB_CUTS", "3")))]
RECORDS = "/var/lib/rosfleet-multimaster"
LOCK, FAILING = f"{RECORDS}/lock", "/run/failing"
BEGINS = {SITE: LOCK, TEARDOWN: LOCK, ROLLBACK: FAILING}  # the file whose appearance begins a change
# Numbers below these are drawn. site.yml was seen to write about 1,200 times; of the others it is not known: what is not reached is cut at the end.
WRITES = {SITE: 900, TEARDOWN: 500, ROLLBACK: 100}
MAY_FAIL = "/run/may-fail"
# Six services that run, and a seventh that fails until the next boot: the module takes all of them back.
RUNS = "[Service]\nExecStart=/bin/sleep infinity\n[Install]\nWantedBy=multi-user.target\n"
ENDS = f"/bin/sh -c 'touch {FAILING}; ! test -e {MAY_FAIL}'"
FAILS = RUNS.replace("[Install]", "Type=oneshot\nRemainAfterExit=yes\n[Install]").replace("/bin/sleep infinity", ENDS)
UNITS = {**{f"probe-{number}.service": RUNS for number in range(6)}, "probe-fails.service": FAILS}
SERVICES = {"bundle": "probe", "units": [{"name": name, "content": content} for name, content in UNITS.items()]}
# What the power is cut in.
CHANGES = {
    SITE: ("ansible-playbook", SITE),
    TEARDOWN: ("ansible-playbook", TEARDOWN),
    ROLLBACK: ("ansible", HOST, "-m", "rosfleet.multimaster.managed_services", "-a", json.dumps(SERVICES)),
}
# Returns when the disk has had so many writes since a file has appeared; prints that number.
AWAIT = """
import os, sys, time
def count():
    return int(open("/sys/block/vda/stat").read().split()[4])
while not os.path.exists(sys.argv[1]):
    time.sleep(0.05)
first = count()
while count() - first < int(sys.argv[2]):
    time.sleep(0.02)
print(count() - first)
"""
# What differs from boot to boot, or from one moment to the next, without us.
VARYING = re.compile(
    r"file /(etc/(machine-id|hostname|fstab|\.pwd\.lock)|run/|root(/\.local.*)?$|home/operator(/\.local.*)?$)"
    r"|file /var/lib/rosfleet-multimaster(/.*)?$"  # the records are looked at one by one
    r"|file /var/lib/private/multimaster-roscore/registrations$"  # those of the nodes that run
    r"|service (systemd-|run-|modprobe@|getty@|multimaster-rollback)"
    r"|kernel value /proc/sys/net/(netfilter/nf_|nf_conntrack_)"  # of a module that stays until the next boot
    r"|kernel value /proc/sys/net/(ipv4/tcp_mem|ipv4/udp_mem|.*/neigh/)"
)
# Half of a file beside it, which the next run removes; and links of a unit that systemd has yet to make or has removed already.
HALF = re.compile(r"file .*\.rosfleet-new-\d+: |unit file (multimaster|probe)-\S+: disabled;")


@pytest.fixture(scope="module")
def lab(new_machines):
    """A machine before any site.yml."""
    with new_machines("machines-power", hosts_of(read_inventory(INVENTORY)), INVENTORY) as found:
        found.write(HOST, "/root/await.py", AWAIT)
        found.write(HOST, "/root/snapshot.py", (ROOT / "lab" / "snapshot.py").read_text())
        yield found


def look(lab):
    """The state of the machine."""

    def ask():
        state = json.loads(lab.run(HOST, "python3 /root/snapshot.py", timeout=300))
        return state if state["unit file"] and state["service"] else None  # else systemd was too busy to answer

    return wait_until(ask, 600, "systemd tells its units")


def add_units(state):
    """A state with the files of the services that are taken back, before any of them has started."""
    made = {}
    for name, content in UNITS.items():
        path = f"/etc/systemd/system/{name}"
        made[path] = f"-rw-r--r-- 0:0 {hashlib.sha256(content.encode()).hexdigest()[:16]}"
        made[f"/etc/systemd/system/multi-user.target.wants/{name}"] = f"0:0 link to {path}"
    return {
        **state,
        "file": {**state["file"], **made},
        "unit file": {**state["unit file"], **dict.fromkeys(UNITS, "enabled")},
        "service": {
            **state["service"],
            **dict.fromkeys(UNITS, "loaded active running"),
            "probe-fails.service": "loaded active exited",
        },
    }


def mend(lab, kind):
    """The next run."""
    status, output = (
        lab.module(HOST, "managed_services", {"bundle": "probe", "units": []}) if kind == ROLLBACK else lab.play(kind)
    )
    assert status == 0, output


class States:
    """The machine before site.yml, and after it: with and without a boot since."""

    def __init__(self, lab):
        self.old, self.new = look(lab), []


@pytest.fixture(scope="module")
def states(lab):
    return States(lab)


def differences(state, known):
    """What is in none of the known states."""
    for part, entries in state.items():
        for name in sorted(set(entries).union(*(other.get(part, {}) for other in known))):
            values = [other.get(part, {}).get(name, "absent") for other in known]
            if not VARYING.match(f"{part} {name}") and entries.get(name, "absent") not in values:
                yield f"{part} {name}: {entries.get(name, 'absent')}; expected one of {values}"


def bring(lab, states, kind):
    """Bring the machine to the state in which a change of this kind is possible."""
    if kind == SITE and states.new:
        mend(lab, TEARDOWN)
        assert not list(differences(look(lab), [states.old]))
    elif kind != SITE and not states.new:
        mend(lab, SITE)
        states.new.append(look(lab))


def cut(lab, kind, writes):
    """Cut the power in a change after so many writes, or at its end; the controller goes with it. Returns a text about it."""
    lab.run(HOST, f"rm -f {FAILING}; touch {MAY_FAIL}")
    with ThreadPoolExecutor() as pool:
        moment = pool.submit(lab.run, HOST, f"python3 /root/await.py {BEGINS[kind]} {writes}", timeout=1800)
        time.sleep(1)  # the watcher of the disk is there before the change begins
        with lab.controller(*CHANGES[kind]) as controller:
            wait_until(lambda: moment.done() or controller.poll() is not None, 1800, "the moment comes")
            virtual.cut_power(lab.name, HOST)
    said = f"after {moment.result().strip()} writes" if not moment.exception() else "at its end"
    virtual.give_power(lab.name, HOST)
    lab.set_clock(HOST)
    return f"{kind}: cut {said} (drawn: {writes} of {WRITES[kind]})"


@pytest.mark.parametrize(("kind", "seed"), CUTS)
def test_power_is_cut_in_the_middle(lab, states, kind, seed):
    bring(lab, states, kind)
    said = cut(lab, kind, random.Random(seed).randrange(WRITES[kind]))
    state, records = look(lab), lab.run(HOST, f"ls {RECORDS} 2>/dev/null", check=False).split()
    print(f"{said}; {len(records)} records", flush=True)
    lab.run(
        HOST,
        f"for record in $(ls {RECORDS}/*.json 2>/dev/null); do python3 -m json.tool $record >/dev/null || exit 1; done",
    )
    mend(lab, kind)
    mended = look(lab)
    if not states.new:
        states.new.append(mended)
        output = lab.play(SITE)[1]
        assert "changed=0" in output and not re.search(r"changed=[1-9]", output), said
    known = [states.old, *states.new] if kind != ROLLBACK else [*states.new, add_units(states.new[0])]
    assert not [text for text in differences(state, known) if not HALF.match(text)], said
    assert not list(differences(mended, [states.old] if kind == TEARDOWN else states.new)), said
    assert lab.run(HOST, f"ls {RECORDS}/services-probe.json {LOCK} 2>/dev/null", check=False) == ""
    if kind == TEARDOWN:
        assert lab.run(HOST, f"ls -d {RECORDS} 2>/dev/null", check=False) == ""
        states.new.clear()
