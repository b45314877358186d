# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The matrix of versions, as far as nothing is started."""

import json
import sys

import cells
import controllers
import pytest
from controllers import Controller

RECAP = """
PLAY RECAP *********************************************************************
kobuki1computer            : ok=12   changed={}    unreachable=0    failed=0    skipped=1    rescued=0    ignored=0
kobuki2computer            : ok=12   changed=0    unreachable=0    failed=0    skipped=1    rescued=0    ignored=0
"""


@pytest.mark.parametrize(
    "status, output, unchanged, problem",
    [
        (0, RECAP.format(3), False, ""),
        (0, RECAP.format(0), True, ""),
        (0, RECAP.format(3), True, "changes 3 things"),
        (2, RECAP.format(0), False, "ends with 2"),
        (0, "skipping: no hosts matched", False, "ran on no computer"),
    ],
)
def test_the_end_of_a_playbook(status, output, unchanged, problem):
    assert cells.find_problem(status, output, unchanged=unchanged) == problem


def test_cells_of_a_former_version_are_forgotten():
    kept = {}
    cells.note(kept, "2.16", "2.16.18", "3.11", "bullseye", cells.OK)
    cells.note(kept, "2.16", "2.16.18", "3.11", "trixie", cells.OK)
    cells.note(kept, "2.16", "2.16.19", "3.11", "trixie", "site.yml ends with 2")
    assert kept == {"2.16": {"version": "2.16.19", "python": "3.11", "trixie": "site.yml ends with 2"}}


def test_the_table_says_what_was_not_tried():
    kept = {}
    cells.note(kept, "2.16", "2.16.19", "3.11", "bookworm", cells.OK)
    lines = cells.table(["2.16", "newest"], kept).splitlines()
    assert lines[2].startswith("| 2.16.19 | 3.11 | not tried | works | not tried |")
    assert lines[3].count("not tried") == len(cells.ROBOTS)


def test_the_page_has_the_marks_of_the_table():
    page = cells.PAGE.read_text(encoding="utf-8")
    assert cells.fill(cells.fill(page, "x"), "y") == cells.fill(page, "y")
    with pytest.raises(ValueError, match="no pair of lines"):
        cells.fill("nothing", "x")


def test_a_controller_in_a_container_has_its_own_python(tmp_path):
    path = tmp_path / "hosts.yml"
    variables = {"ansible_ssh_common_args": f"-o 'ProxyCommand={sys.executable} -IS enter.py'"}
    path.write_text(json.dumps({"all": {"hosts": {"a": variables}}}))
    assert controllers.write_connection(path, Controller("2.16", in_image=False)) == path
    other = controllers.write_connection(path, Controller("2.20", in_image=True))
    assert "ProxyCommand=/usr/bin/python3 -IS" in other.read_text() and sys.executable not in other.read_text()
