# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The program of a rehearsal, as far as nothing is started. tests/long/test_rehearse.py has the rest."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import rehearse
import seeded
from catalogue import Fault
from machines.layout import Host
from machines.podman import LabError
from rehearsals.rehearsal import Rehearsable

import lab

ROOT = Path(__file__).resolve().parents[3]


def rehearsal():
    return rehearse.Rehearsal("unit", rehearse.Preparation(Rehearsable({}, (), {}, {}), [], []), Path("/nowhere"))


@pytest.mark.slow
def test_a_mistake_ends_it_before_anything_starts(tmp_path):
    mistake = next(found for found in seeded.load() if found.name == "same_address")
    inventory = tmp_path / "hosts.json"
    inventory.write_text(json.dumps(mistake.inventory()))
    done = subprocess.run(
        [sys.executable, "lab/rehearse.py", "--inventory", inventory, "--name", "unit"],
        cwd=ROOT,
        env={"PATH": "/nowhere", "HOME": str(tmp_path), "LC_ALL": "C.UTF-8"},  # no podman either
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert mistake.words[0] in done.stderr and "Traceback" not in done.stderr
    assert "the computers start" not in done.stdout


def test_the_command_line():
    options = rehearse.parse_options(
        ["--inventory", "inventory/x", "--faults", "sync_dead, no_forwarding", "--suites", "a=trixie"]
    )
    assert options.inventory == Path.cwd() / "inventory/x"
    assert (options.faults, options.suites) == (["sync_dead", "no_forwarding"], ["a=trixie"])
    assert rehearse.parse_options(["--inventory", "~/fleet"]).inventory == Path.home() / "fleet"
    with pytest.raises(LabError, match="INVENTORY is not set; expected the folder"):
        rehearse.parse_options(["--inventory", ""])
    with pytest.raises(SystemExit):
        rehearse.parse_options(["--inventory", "x", "--name", "a.b"])


@pytest.mark.parametrize("manager, full", [("ifupdown", 0), ("networkd", 0), ("networkmanager", 1), ("netplan", 1)])
def test_the_full_image_is_for_a_manager_or_a_fault(manager, full):
    hosts = [Host("a", ()), Host("b", (), manager)]
    fault = Fault("clock", "", (), (), (), (), (), quick=False)
    assert rehearse.Preparation(Rehearsable({}, (), {}, {}), hosts, []).full == bool(full)
    assert rehearse.Preparation(Rehearsable({}, (), {}, {}), hosts, [fault]).full


def test_what_cannot_go_on_ends_the_steps(monkeypatch):
    run, played = rehearsal(), []
    monkeypatch.setattr(rehearse.Rehearsal, "start", lambda self: True)
    monkeypatch.setattr(rehearse.Rehearsal, "play", lambda self, name, variables=None: played.append(name))
    assert run.whole() is False
    assert played == ["site.yml"] and run.wrong == ["site.yml: make the fleet talk"]


@pytest.mark.parametrize("keep, last", [(False, "playbooks/teardown.yml"), (True, "site.yml")])
def test_a_fleet_that_is_kept_is_set_up(monkeypatch, keep, last):
    run, played = rehearsal(), []
    run.keep = keep
    for name in ("start", "reboot"):
        monkeypatch.setattr(rehearse.Rehearsal, name, lambda self: True)
    monkeypatch.setattr(rehearse.Rehearsal, "play", lambda self, name, variables=None: not played.append(name))
    assert run.whole() and played[-1] == last and played.count("site.yml") == 1 + keep


def test_the_line_by_which_ansible_reaches_what_is_kept():
    run = rehearsal()
    run.work, run.connection = rehearse.ROOT / ".work/rehearse/my fleet", rehearse.ROOT / ".work/lab/x/hosts.yml"
    command = (
        "ansible-playbook -i '.work/rehearse/my fleet/inventory.yml' -i .work/lab/x/hosts.yml playbooks/verify.yml"
    )
    assert command in run.explain_kept()


def test_a_failed_step_of_the_lab_is_told_and_others_go_on(monkeypatch, capsys):
    run, steps = rehearsal(), []

    def reboot(self):
        raise LabError("ana-nav has not booted well")

    monkeypatch.setattr(rehearse.Rehearsal, "reboot", reboot)
    for name in ("start", "play", "verify", "teardown"):
        monkeypatch.setattr(rehearse.Rehearsal, name, lambda self, *words, name=name: steps.append(name) or True)
    assert run.whole() is False
    assert steps == ["start", "play", "verify", "verify", "teardown"]
    assert run.wrong == ["a reboot of all computers"] and "ana-nav has not booted well" in capsys.readouterr().out


def test_the_path_of_the_report_is_the_last_line():
    run = rehearsal()
    run.seconds, run.report = {"site.yml": 12.0, "verify.yml": 3.0}, Path("/reports/reboot.html")
    assert rehearse.summarize(run).splitlines()[-2:] == [
        "rehearse: 0 computers, 15 s: all went well",
        "/reports/reboot.html",
    ]
    run.wrong, run.report = ["verify.yml"], None
    text = rehearse.summarize(run)
    assert text.endswith("1 of 2 steps failed") and re.search("^  FAILED +3.0 s   verify.yml$", text, re.MULTILINE)


def test_no_lab_has_the_name_of_a_rehearsal_by_accident():
    assert lab._name("demo-2") == "demo-2" and lab._name("rehearse.fleet_1f3c") == "rehearse.fleet_1f3c"
    for text in ("a.b", "rehearse.", "rehearse.a-b", "", "-a", "a/b"):
        with pytest.raises(Exception, match="is not a name"):
            lab._name(text)
