# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Problems as the result of a task, and as ansible-playbook itself prints them."""

import pytest
from ansible.utils.display import Display
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import refusal

from tests.unit.playbooks.played_robots import run_tasks

ACTION = """
from ansible.plugins.action import ActionBase
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.refusal import refuse

class ActionModule(ActionBase):
    _requires_connection = False

    def run(self, tmp=None, task_vars=None):
        super().run(tmp, task_vars)
        return refuse(self._task.args["problems"], warnings=["the clock is late"], noted=[])
"""

TOLD = "told.failed and told.problems == problems and told.warnings == ['the clock is late']"


@pytest.fixture
def lines(monkeypatch):
    printed = []
    monkeypatch.setattr(Display, "display", lambda self, text, **options: printed.append(text))
    return printed


@pytest.mark.parametrize(
    "version, raises", [("2.16.19", False), ("2.18.0rc1", False), ("2.19.0b2", True), ("2.21.5", True)]
)
def test_several_problems_are_printed_one_by_one(monkeypatch, lines, version, raises):
    monkeypatch.setattr(refusal, "__version__", version)
    found, words = ["robot1: one", "robot2: two"], "2 problems:\n1. robot1: one\n2. robot2: two"
    if raises:
        with pytest.raises(refusal.PlainFailure) as failure:
            refusal.refuse(found)
        result = {**failure.value.result, "failed": True, "msg": failure.value.message}
        result.pop("exception", None)  # of ansible-core before 2.19
    else:
        result = refusal.refuse(found)
    assert result == {"changed": False, "failed": True, "msg": words, "problems": found} and lines == [words]


def test_a_single_problem_is_left_to_ansible(monkeypatch, lines):
    monkeypatch.setattr(refusal, "__version__", "2.16.0")
    assert refusal.refuse(["robot1: one"])["msg"] == "robot1: one" and not lines


@pytest.mark.whole
@pytest.mark.parametrize("problems", [["a is b"], ["a is b", "c is d"]], ids=["one", "two"])
def test_people_read_problems_and_warnings_without_an_origin(tmp_path, problems):
    (tmp_path / "action_plugins").mkdir()
    (tmp_path / "action_plugins" / "refused.py").write_text(ACTION)
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "refused.py").touch()
    status, output = run_tasks(
        tmp_path,
        {"name": "Refuse", "refused": {"problems": problems}, "register": "told", "ignore_errors": True},
        {"name": "Look", "ansible.builtin.assert": {"that": TOLD}, "vars": {"problems": problems}},
    )
    assert status == 0, output
    assert all(text in output for text in problems), output
    assert "[WARNING]: the clock is late" in output and "FAILED! =>" in output
    numbered = [f"{place}. {text}" for place, text in enumerate(problems, 1)] if len(problems) > 1 else []
    assert [line for line in output.splitlines() if line in numbered] == numbered, output
    assert not [word for word in ("[ERROR]", "Origin", "play.yml", "Traceback") if word in output], output
