# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""`make rehearse` with an inventory as a user has it, from its containers' start to their end; and what ends it early.

About five minutes.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from machines import containers
from machines.podman import list_labelled, podman
from rehearsals import rehearsal

ROOT = Path(__file__).resolve().parents[2]

NAME = "long"
LAB = rehearsal.lab_of(NAME)
SECRET = "$ANSIBLE_VAULT;1.1;AES256\n61626364\n"


def command(inventory, *options):
    return [sys.executable, "lab/rehearse.py", "--name", NAME, "--overlap", "--inventory", str(inventory), *options]


def there():
    """The containers and networks of the rehearsal."""
    label = containers.label(LAB)
    return [entry["Names"][0] for entry in list_labelled("container", label)] + [
        entry["name"] for entry in list_labelled("network", label)
    ]


@pytest.fixture
def fleet(tmp_path):
    """A user's folder, with a file that only he can read."""
    folder = shutil.copytree(ROOT / "tests" / "long" / "rehearsed", tmp_path / "My fleet")
    (folder / "group_vars" / "all.yml").write_text(SECRET)
    with containers.remove_at_end(LAB):
        yield folder


def test_an_inventory_as_a_user_has_it(fleet):
    before = {path: path.read_bytes() for path in fleet.rglob("*") if path.is_file()}
    done = subprocess.run(
        command(fleet, "--faults", "sync_dead"), cwd=ROOT, capture_output=True, text=True, timeout=900, check=False
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr
    for line in (
        "  left aside: group_vars/all.yml: an encrypted file",
        "  left aside: ansible_become: of all 4 computers",
        "  note: device-gateway-ana: a container with Linux stands in for the device at 192.168.30.21, 192.168.31.1",
        "  note: device-router: a container with Linux stands in for the device at 192.168.30.1",
    ):
        assert line in lines
    assert any(
        line.startswith("  note: cid-pc: multimaster_provider is 'fkie_apt'; the containers have") for line in lines
    )
    report = Path(lines[-1])
    assert report.suffix == ".html" and "<html" in report.read_text()
    found = json.loads(report.with_suffix(".json").read_text())
    assert not [finding for finding in found["findings"] if finding["verdict"] == "failed"]
    assert there() == []
    assert {path: path.read_bytes() for path in fleet.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_removes_the_containers(fleet, number):
    process = subprocess.Popen(command(fleet), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_until_playing(process)
    process.send_signal(number)
    assert process.wait(120) in (128 + signal.SIGTERM, 130)
    assert there() == []


def test_lab_down_removes_what_a_killed_rehearsal_left(fleet):
    # In a session of its own, so that its playbook can be found.
    process = subprocess.Popen(command(fleet), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    child = wait_until_playing(process)
    process.kill()
    process.wait()
    os.killpg(child, signal.SIGKILL)
    assert there()
    other = podman("network", "ls", "--quiet", "--format", "{{.Name}}").split()
    subprocess.run([sys.executable, "lab/lab.py", "down", "--name", LAB], cwd=ROOT, check=True)
    assert there() == []
    assert {name for name in other if LAB not in name} <= set(podman("network", "ls", "--format", "{{.Name}}").split())


def wait_until_playing(process):
    """Wait until site.yml runs; returns its process id."""
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        assert process.poll() is None
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        for child in children:
            words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            if b"site.yml" in words:
                return int(child)
        time.sleep(0.3)
    raise AssertionError("site.yml has not begun")
