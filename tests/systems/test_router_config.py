# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""playbooks/router_config.yml with the shipped inventory, and FRR reads what it writes for Cisco IOS."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HOST = "kobuki1computer"

# FRR has the routes of IOS, and leaves redirects to the kernel.
NOT_OF_FRR = {"no ip redirects", "ip redirects"}


def playbook(folder, *options):
    """Run the playbook; returns its output."""
    done = subprocess.run(
        [
            Path(sys.executable).with_name("ansible-playbook"),
            *("-i", "inventory/multi_computer", "playbooks/router_config.yml"),
            *("-e", json.dumps({"router_config_folder": str(folder)})),
            *options,
        ],
        cwd=ROOT,
        env={**os.environ, "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"), "ANSIBLE_NOCOLOR": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder after the playbook."""
    folder = tmp_path_factory.mktemp("router") / "config"
    checked = playbook(folder, "--check", "--diff")
    assert "+ip route 192.168.11.0 255.255.255.0 192.168.1.201" in checked and not folder.exists()
    assert "changed=2 " in playbook(folder)
    return folder


@pytest.mark.costly
def test_a_second_run_changes_nothing(written):
    before = {path: path.stat().st_mtime_ns for path in written.rglob("*")}
    assert "changed=0 " in playbook(written)
    assert {path: path.stat().st_mtime_ns for path in written.rglob("*")} == before


def test_a_part_by_choice(tmp_path):
    playbook(tmp_path, "-e", json.dumps({"router_config_dialects": ["linux"]}))
    assert sorted(path.name for path in tmp_path.rglob("*.*")) == ["linux.remove.sh", "linux.sh"]


def refused(untouched, text):
    """The commands that FRR does not know, out of a dry run of its shell."""
    output = untouched.run(HOST, "vtysh -C -f /dev/stdin 2>&1", check=False, stdin=text)
    assert "vtysh: command not found" not in output
    return [line.strip() for line in re.findall(r"^line \d+: % .*?: (.*)$", output, re.MULTILINE)]


@pytest.mark.parametrize("file", ["ios.txt", "ios.remove.txt"])
def test_frr_reads_the_routes_of_ios(untouched, written, file):
    text = (written / "router" / file).read_text()
    assert set(refused(untouched, text)) <= NOT_OF_FRR
    assert text.count("ip route 192.168.") == 3


def test_frr_refuses_what_is_wrong(untouched, written):
    text = (written / "router" / "ios.txt").read_text().replace("255.255.255.0", "255.255.300.0")
    assert len(set(refused(untouched, text)) - NOT_OF_FRR) == 3
