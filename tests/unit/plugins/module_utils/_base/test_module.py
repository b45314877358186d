# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The line of a module in the log of a computer: the names of its options, and none of the values."""

import json
import pathlib

import pytest
from ansible.module_utils import basic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.module import Module, validate_options
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem

MODULES = sorted((pathlib.Path(__file__).resolve().parents[5] / "plugins/modules").glob("[a-z]*.py"))
SPECIFICATION = {
    "multicast": {"type": "dict"},
    "files": {"type": "list", "elements": "dict", "default": []},
    "keep": {"type": "bool", "default": False},
    "name": {"type": "str", "default": ""},
}


@pytest.fixture(name="logged")
def fixture_logged(monkeypatch):
    """Makes a module with these options; returns the lines that go to the log."""

    def logged(**options):
        lines = []
        monkeypatch.setattr(basic, "_ANSIBLE_ARGS", json.dumps({"ANSIBLE_MODULE_ARGS": options}).encode())
        monkeypatch.setattr(basic, "_ANSIBLE_PROFILE", "legacy", raising=False)
        monkeypatch.setattr(
            basic.AnsibleModule, "log", lambda self, line, log_args=None: lines.append((line, log_args))
        )
        Module(argument_spec=SPECIFICATION)
        return lines

    return logged


def test_the_log_has_no_values(logged):
    assert logged(multicast={"run": "a label that seals"}, files=[{"content": "text"}]) == [
        ("Invoked with files, keep, multicast", None)
    ]
    assert logged(multicast={"run": "a label that seals"}, _ansible_no_log=True) == []


@pytest.mark.parametrize("path", MODULES, ids=[path.stem for path in MODULES])
def test_every_module_that_runs_on_computers_has_it(path):
    text = path.read_text(encoding="utf-8")
    assert "AnsibleModule" not in text
    assert ("Module(" in text or "run_module(CONCERN)" in text) == ("def main()" in text)


def test_options_of_another_module_are_as_it_would_have_them():
    assert validate_options("other", {"name": 5}, SPECIFICATION)["name"] == "5"
    with pytest.raises(Problem, match="^other: "):
        validate_options("other", {"strange": 1}, SPECIFICATION)
    with pytest.raises(Problem, match="^other: "):
        validate_options("other", {"items": ["text"]}, {"items": {"type": "list", "elements": "dict", "options": {}}})
