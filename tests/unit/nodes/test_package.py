# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes as a package of their own: what pyproject.toml says is so, and the robots get none of it."""

import pathlib
import re

import pytest
import yaml

ROOT = pathlib.Path(__file__).parents[3]
ROLE = ROOT / "roles/nodes"
tomllib = pytest.importorskip("tomllib")  # since Python 3.11
PROJECT = tomllib.loads((ROLE / "pyproject.toml").read_text(encoding="utf-8"))


def test_its_version_is_that_of_the_collection():
    version = PROJECT["tool"]["hatch"]["version"]
    found = re.search(version["pattern"], (ROLE / version["path"]).read_text(encoding="utf-8"))
    assert found["version"] == yaml.safe_load((ROOT / "galaxy.yml").read_text(encoding="utf-8"))["version"]


def test_it_has_all_that_the_robots_have():
    packages = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    there = {path for path in (ROLE / "files/python").iterdir() if path.name != "__pycache__"}
    assert {ROLE / name for name in packages} == there


def test_it_needs_no_more_than_the_robots_have():
    assert PROJECT["project"]["requires-python"] == ">=3.8" and PROJECT["project"]["dependencies"] == []
