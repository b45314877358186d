# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Robots that an older state of the collection has set up, upgraded by one run of today's site.yml. Ten minutes for each of these.

The states are version 1.0.0, and the last one in which the relay was called border. Both are taken out of git's history.
"""

import json
import re
import subprocess
import time
from typing import NamedTuple

import pytest
from machines.podman import ROOT
from setups.links import wait_until
from snapshot import compare
from subject import lab_of

RELAY = "roles/nodes/files/python/rosfleet_multimaster/master_relay.py"


class Former(NamedTuple):
    """A former state of the collection, and robots that it sets up."""

    file: str  # the commit that has added this file ...
    before: str  # ... or, by "^", the one before it
    inventory: str
    talker: str  # the computer whose nodes are heard
    names: tuple[str, ...]  # the topics and the service by which the others hear it
    listeners: tuple[str, ...]
    longest: float  # silence of a topic, in seconds; relays wait for each other, as one does not serve a node of the former name


FORMER = {
    "1.0.0": Former(
        "CHANGELOG.rst",
        "",
        "tests/long/gateways",
        "ana-arm",
        ("/reset", "/scan", "/map"),
        ("bob-arm", "cid-gate"),
        20.0,
    ),
    "border": Former(
        RELAY,
        "^",
        "tests/systems/restarts",
        "kobuki1-pc",
        ("/kobuki1/reset", "/kobuki1/scan", "/direct/scan", "/kobuki1/map"),
        ("station-pc", "station-desk"),
        90.0,
    ),
}

#: services that this test starts, and one that a timer starts
OTHERS = ("steady.service", "arrivals.service", "systemd-tmpfiles-clean.service")

#: the store of the roscore, and records, whose entries have the order in which they came
UNREAD = ("/var/lib/private/", "/var/lib/rosfleet-multimaster/")

#: a unit of the collection, with the number of its process
PROCESSES = """for unit in $(systemctl list-units --all --plain --no-legend 'multimaster-*.service' | cut -d ' ' -f 1); do
  echo $unit $(systemctl show -P MainPID $unit) $(systemctl show -P InvocationID $unit)
done"""


def git(*words):
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=True).stdout


def export(former, folder):
    """Write a former state as a collection below a folder; returns its path."""
    if git("rev-parse", "--is-shallow-repository").strip() == b"true":
        pytest.skip("this clone has no history")
    commit = git("log", "--diff-filter=A", "--format=%H", "--", former.file).split()[-1].decode()
    tree = folder / "ansible_collections" / "rosfleet" / "multimaster"
    tree.mkdir(parents=True)
    subprocess.run(["tar", "-x", "-C", tree], input=git("archive", commit + former.before), check=True)
    return tree


def read_state(lab):
    """All that a run may change, by computer, without contents of UNREAD and without counters of packets."""
    states = {}
    for host in lab.hosts:
        state = json.loads(lab.run(host, "python3 -", stdin=(ROOT / "lab/snapshot.py").read_text()))
        state["file"] = {
            path: entry.rpartition(" ")[0] if path.startswith(UNREAD) else entry
            for path, entry in state["file"].items()
        }
        state["service"] = {name: state for name, state in state["service"].items() if name not in OTHERS}
        rules = state["packet filter"]["rules"]
        state["packet filter"]["rules"] = re.sub(r"counter packets \d+ bytes \d+", "counter", rules)
        states[host] = state
    return states


def differ(before, after):
    """The differences between two states, a line each."""
    return [f"{host}: {line}" for host in before for line in compare(before[host], after[host])]


def read_processes(lab):
    """The services of the collection: (computer, unit) -> process."""
    lines = {host: lab.run(host, PROCESSES).splitlines() for host in lab.hosts}
    return {(host, line.split()[0]): line for host, found in lines.items() for line in found}


def list_restarts(output, action):
    """The services that a run names in its summary, by computer."""
    summary = output.partition("SUMMARY:")[2]
    named = set()
    for host, text in re.findall(r"(?<=\s)([\w-]+): (.*?)(?=\s[\w-]+: |$)", summary):
        for units in re.findall(rf"{action} (.+?), since", text):
            named |= {(host, f"{unit}.service") for unit in units.split(", ")}
    return named


def start_nodes(lab, former):
    """Start nodes as people do, and wait until all is heard."""
    lab.start(former.talker, "steady", "python3 {script} /scan /direct/scan", "programs/steady.py")
    lab.wait_until_ready(former.talker, "steady")
    for host in former.listeners:
        lab.start(host, "arrivals", f"python3 {{script}} {' '.join(former.names)}", "observers/arrivals.py")
    for host in former.listeners:
        wait_until(lambda host=host: hears_all(lab, former, host), 60, f"{host} hears all")


def hears_all(lab, former, host, since=0.0):
    wanted = {"service", *former.names[1:]}
    return {text for at, text in lab.output(host, "arrivals") if at > since} >= wanted


def find_longest_silence(lab, former, since):
    """The longest silence since a moment, of anything that is published steadily: seconds, computer and name."""
    silences = []
    for host in former.listeners:
        arrivals = lab.output(host, "arrivals")
        for name in (*former.names[1:-1], "service"):
            times = [since, *(at for at, text in arrivals if text == name and at > since)]
            silences.append((max(after - before for before, after in zip(times, times[1:])), host, name))
    return max(silences)


class Upgrade(NamedTuple):
    """The observations of an upgrade."""

    former: Former
    lab: object
    tree: object  # of the former state
    untouched: dict  # states before the former site.yml, and after the upgrade
    upgraded: dict
    before: dict  # processes
    after: dict
    foretold: str  # the output of site.yml --check
    told: str
    began: float  # of the upgrade, in seconds of the steady clock
    silence: tuple


@pytest.fixture(scope="module", params=FORMER)
def upgrade(request, tmp_path_factory):
    """A fleet of a former state whose nodes hear each other, after today's site.yml."""
    former = FORMER[request.param]
    folder = tmp_path_factory.mktemp("former")
    tree = export(former, folder)
    with lab_of("long-upgrade", ROOT / former.inventory) as lab:
        lab.patience = 900
        lab.hosts = list(json.loads(lab.connection.read_text())["all"]["hosts"])
        untouched = read_state(lab)
        status, output = lab.play(str(tree / "site.yml"), environment={"ANSIBLE_COLLECTIONS_PATH": str(folder)})
        assert status == 0, output
        start_nodes(lab, former)
        before = read_processes(lab)
        status, foretold = lab.play("site.yml", "--check")
        assert status == 0, foretold
        assert read_processes(lab) == before
        began = time.monotonic()
        status, told = lab.play("site.yml")
        assert status == 0, told
        print(f"\nthe upgrade took {time.monotonic() - began:.0f} s")
        for host in former.listeners:
            now = time.monotonic()
            wait_until(
                lambda host=host, now=now: hears_all(lab, former._replace(names=former.names[:-1]), host, now), 60, host
            )
        silence = find_longest_silence(lab, former, began)
        after = read_processes(lab)
        yield Upgrade(former, lab, tree, untouched, read_state(lab), before, after, foretold, told, began, silence)


def test_what_was_heard_is_heard_again(upgrade):
    seconds, host, name = upgrade.silence
    print(f"{host} missed {name} for {seconds:.1f} s")
    assert seconds < upgrade.former.longest
    *_steady, latched = upgrade.former.names
    for host in upgrade.former.listeners:
        assert upgrade.lab.run(host, f"timeout -k 5 20 rostopic echo -n 1 -p {latched}", check=False).endswith(
            ",map\n"
        ), host


def test_what_restarts_is_said_before(upgrade):
    both = upgrade.before.keys() & upgrade.after.keys()
    restarted = {key for key in both if upgrade.before[key] != upgrade.after[key]}
    print("restarted:", *sorted(restarted))
    print(
        "gone:",
        *sorted(upgrade.before.keys() - upgrade.after.keys()),
        "new:",
        *sorted(upgrade.after.keys() - upgrade.before.keys()),
    )
    assert list_restarts(upgrade.told, "restarted") == restarted
    assert list_restarts(upgrade.foretold, "would restart") == restarted


def test_the_fleet_is_verified_and_a_second_run_changes_nothing(upgrade):
    status, output = upgrade.lab.play("site.yml")
    assert status == 0 and not re.search(r"changed=[1-9]", output), output
    status, output = upgrade.lab.play("playbooks/verify.yml")
    assert status == 0 and "PASSED" in output, output


def test_no_service_and_file_has_the_former_name(upgrade):
    for host, state in upgrade.upgraded.items():
        named = [name for part in ("file", "unit file", "service") for name in state[part] if "border" in name]
        assert named == [], host


def test_the_teardown_leaves_each_machine_as_it_was(upgrade):
    for host in upgrade.former.listeners:
        upgrade.lab.stop(host, "arrivals")
    upgrade.lab.stop(upgrade.former.talker, "steady")
    status, output = upgrade.lab.play("playbooks/teardown.yml")
    assert status == 0, output
    assert differ(upgrade.untouched, read_state(upgrade.lab)) == []


def test_a_robot_that_was_new_has_the_same(upgrade):
    """After the teardown, site.yml makes of these machines the same as the upgrade has made."""
    status, output = upgrade.lab.play("site.yml")
    assert status == 0, output
    assert differ(upgrade.upgraded, read_state(upgrade.lab)) == []
