# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The files of the catalogue say what the runner, the lab and the diagnosis know."""

import shlex
import subprocess
from pathlib import Path

import catalogue
import pytest
import words
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import FAULTS

ROOT = Path(__file__).resolve().parents[3]

HOSTS = yaml.safe_load((ROOT / "tests" / "faults" / "inventory" / "hosts.yml").read_text())
COMPUTERS = {name for robot in HOSTS["robots"]["children"].values() for name in robot["hosts"]}
ROBOTS = set(HOSTS["robots"]["children"])
FACTS = {
    **{f"{name}{suffix}": "192.0.2.1" for name in COMPUTERS for suffix in ("", ".common")},
    "group": "226.0.0.0",
    "port": "11511",
}
ALL = catalogue.load(FACTS)
SHELL = [(fault.name, step) for fault in ALL for step in (*fault.inject, *fault.settled, *fault.hands, *fault.undo)]


@pytest.mark.parametrize("fault", ALL, ids=lambda fault: fault.name)
def test_a_file_names_parts_and_places_that_exist(fault):
    assert fault.inject and fault.undo
    assert set(fault.parts) <= set(FAULTS)
    assert set(fault.at) & (COMPUTERS | ROBOTS | {words.COMMON, words.STRANGERS_ADDRESS})


def test_steps_are_of_known_places_and_valid_bash():
    for name, step in SHELL:
        if step.where == catalogue.LAB:
            assert step.what in words.WORDS, name
        else:
            assert step.where in COMPUTERS, name
            read = subprocess.run(["bash", "-n", "-c", step.what], capture_output=True, text=True, check=False)
            assert read.returncode == 0 and not read.stderr, f"{name}: {shlex.quote(step.what)}: {read.stderr}"


def test_every_fault_of_the_lab_is_taken_back_by_a_word():
    for fault in ALL:
        assert [step.where for step in fault.inject].count("lab") == [step.where for step in fault.undo].count("lab")


def written(tmp_path, text):
    path = tmp_path / "one.yml"
    path.write_text(text)
    return path


def test_a_key_or_a_placeholder_that_nobody_knows_is_refused(tmp_path):
    head = "title: t\nundo: []\nparts: [clock off]\nat: [a]\n"
    with pytest.raises(catalogue.CatalogueError, match="one.yml: injekt is not known, inject is missing"):
        catalogue.read(written(tmp_path, f"{head}injekt: []"), FACTS)
    with pytest.raises(catalogue.CatalogueError, match="<elsewhere> is not known"):
        catalogue.read(written(tmp_path, f"{head}inject: [{{a: ping <elsewhere>}}]"), FACTS)
