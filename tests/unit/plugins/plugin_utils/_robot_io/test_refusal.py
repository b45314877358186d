# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Problems as the result of a task."""

import pytest
from ansible.utils.display import Display
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import refusal


@pytest.fixture
def lines(monkeypatch):
    printed = []
    monkeypatch.setattr(Display, "display", lambda self, text, **options: printed.append(text))
    return printed


@pytest.mark.parametrize(
    "version, printed", [("2.16.19", True), ("2.18.0rc1", True), ("2.19.0b2", False), ("2.21.5", False)]
)
def test_several_problems_are_printed_where_ansible_does_not(monkeypatch, lines, version, printed):
    monkeypatch.setattr(refusal, "__version__", version)
    result = refusal.refuse(["robot1: one", "robot2: two"])
    assert result["failed"] and result["msg"] == "2 problems:\n1. robot1: one\n2. robot2: two"
    assert lines == ([result["msg"]] if printed else [])


def test_a_single_problem_is_left_to_ansible(monkeypatch, lines):
    monkeypatch.setattr(refusal, "__version__", "2.16.0")
    assert refusal.refuse(["robot1: one"])["msg"] == "robot1: one" and not lines
