# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Network files as people have them: our routes come and go, they are there after a boot, and nothing of others changes.

The managers are real. Each example is a computer of its own, in namespaces on a computer of the lab (network_files/inside.py).
"""

import base64
import json
import subprocess
from pathlib import Path

import drawn_files
import field
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machines import containers
from machines.podman import environment

HERE = Path(__file__).parent / "network_files"
HOST = "ana-pc"
BEGIN = f"cd /tmp && PYTHONPATH=/tmp/ansible:/tmp/collections exec python3 -B /tmp/fleet/{HERE.relative_to(HERE.parents[2])}/inside.py"


class Computers:
    """The program that tries files, one computer for each question."""

    def __init__(self, container):
        words = ["podman", "exec", "-i", container, "bash", "-c", BEGIN]
        self.program = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment()
        )

    def boot(self, manager, files):
        """Boot a computer with these files, and return what happened."""
        spelt = {path: [base64.b64encode(content).decode(), 0o600] for path, content in files.items()}
        self.program.stdin.write(json.dumps({"manager": manager, "files": spelt}) + "\n")
        self.program.stdin.flush()
        answer = json.loads(self.program.stdout.readline())
        assert "crash" not in answer, answer["crash"]
        return answer

    def end(self):
        self.program.stdin.close()
        self.program.wait()


@pytest.fixture(scope="module")
def computers(request, new_lab, bring):
    with new_lab(request.config.getoption("--lab"), HERE / "robot.yml") as lab:
        bring(lab, HOST)
        found = Computers(containers.container(lab.name, HOST))
        yield found
        found.end()


def comes_and_goes(answer, rewritten=()):
    """The promises that each manager keeps: a second run changes nothing, and all is as before in the end, but for files that the manager writes anew."""
    before, taken, removed = (
        {path: file for path, file in tree.items() if path not in rewritten} for tree in answer["files"]
    )
    assert removed == before and all(taken.get(path) == file for path, file in before.items())
    kernel, with_ours, without = answer["kernel"]
    assert without == kernel and not set(kernel) - set(with_ours)
    assert answer["again"] == [False, ""] and answer["removed"] == [bool(answer["ours"]), ""]
    assert all(any(line.startswith(route) for line in with_ours) for route in answer["ours"])


def is_back(answer, rewritten=()):
    """The kernel has our routes and those of others after a boot, and nobody says more than before."""
    comes_and_goes(answer, rewritten)
    if answer["ours"]:
        missing = [route for route in answer["ours"] if not any(line.startswith(route) for line in answer["booted"])]
        assert not missing, missing
        assert not set(answer["kernel"][0]) - set(answer["booted"])
        assert answer["said"][1] == answer["said"][0]


@given(drawn=drawn_files.interfaces())
@field.tries(0.25, shrink=False)
def test_routes_by_ifupdown_are_back_after_a_boot(computers, drawn):
    files, silent = drawn
    answer = computers.boot("ifupdown", files)
    is_back(answer)
    assert set(answer["refused"]) <= silent and not silent & {route.split()[-1] for route in answer["ours"]}
    assert all("no-scripts" in refusal for refusal in answer["refused"].values())


@given(files=drawn_files.mixed_interfaces())
@field.tries(0.25, shrink=False)
def test_a_mixture_of_interfaces_is_taken_or_refused_in_words(computers, files):
    answer = computers.boot("ifupdown", files)
    is_back(answer)
    assert all("manages" in refusal for refusal in answer["refused"].values())  # ifup has not brought it up


def without_ours(text):
    """The sections of a file without our routes."""
    return [part.strip() for part in text.split("\n\n") if "\nDestination=10.2" not in part]


def is_generated(answer):
    """With netplan, the files for the manager behind it have our routes more, and nothing else."""
    comes_and_goes(answer)
    if not answer["ours"]:
        return
    before, after = (
        {path: base64.b64decode(file[0]).decode() for path, file in tree.items()} for tree in answer["generated"][:2]
    )
    assert set(after) == set(before)
    told = "".join(text for text in after.values())
    assert all(f"Destination={route.split()[0]}\n" in told for route in answer["ours"])
    for path, text in after.items():
        assert without_ours(text) == without_ours(before[path])


@given(files=drawn_files.netplans())
@field.tries(0.15, shrink=False)
def test_routes_by_netplan_are_added_to_what_it_generates(computers, files):
    answer = computers.boot("netplan", files)
    is_generated(answer)
    assert not answer["refused"], answer["refused"]


@given(names=st.lists(st.sampled_from(sorted(field.read("netplan"))), min_size=1, max_size=3, unique=True))
@field.tries(0.15, shrink=False)
def test_files_of_netplan_are_taken_or_refused_in_words(computers, names):
    files = {f"/etc/netplan/{name}": field.read("netplan")[name] for name in names}
    answer = computers.boot("netplan", files)
    is_generated(answer)
    assert all("is that of" in refusal for refusal in answer["refused"].values())


@given(files=drawn_files.keyfiles())
@field.tries(0.1, shrink=False)
def test_routes_by_networkmanager_are_back_and_its_profiles_keep_their_settings(computers, files):
    answer = computers.boot("networkmanager", files)
    changed = {path for path, file in answer["files"][0].items() if answer["files"][1][path] != file}
    assert len(changed) <= len({route.split()[-1] for route in answer["ours"]})
    is_back(answer, changed)
    assert not answer["refused"], answer["refused"]
    if answer["ours"]:
        before, with_ours, without = answer["generated"]
        assert before == without and set(with_ours) == set(before)
        assert all(len(with_ours[name]) >= len(text) for name, text in before.items())
