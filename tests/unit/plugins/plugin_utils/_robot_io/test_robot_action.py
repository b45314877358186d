# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The door for answers of robots: bounds while they come, a sentence for what is none."""

import inspect
import json
import os
import signal
import subprocess
import sys
import threading
import time
import types

import pytest
from ansible.errors import AnsibleAuthenticationFailure, AnsibleConnectionFailure, AnsibleError
from ansible.playbook.task import Task
from ansible.plugins.action import ActionBase
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import robot_action
from mentioned import mentions

DUE = '{"changed": false, "installed": [], "removed": [], "msg": "The packages were right."}'

#: ansible-core 2.16 has none
PROFILE = ["legacy"] if "profile" in inspect.signature(ActionBase._parse_returned_data).parameters else []


@pytest.fixture
def action():
    task = Task()
    task.action, task.async_val, task.check_mode = "rosfleet.multimaster.multimaster_packages", 0, False
    made = robot_action.RobotAction(task, types.SimpleNamespace(), None, None, None, None)
    made._robot, made._used_interpreter = "kobuki", "/usr/bin/python3"
    return made


def test_an_answer_is_the_documented_one(action):
    found = action._parse_returned_data({"stdout": f"motd\n{DUE}\n", "stderr": "", "rc": 0}, *PROFILE)
    assert found == {
        "changed": False,
        "installed": [],
        "removed": [],
        "msg": "The packages were right.",
        "_ansible_parsed": True,
    }


def test_another_answer_is_a_sentence_that_names_the_robot(action):
    found = action._parse_returned_data({"stdout": '{"add_host": {"host_name": "x"}}', "rc": 0}, *PROFILE)
    assert (found["failed"], "add_host" in found) == (True, False)
    assert mentions(found["msg"], "kobuki", "rosfleet.multimaster.multimaster_packages", "add_host")


@pytest.mark.parametrize(
    ("said", "found", "bound"),
    [
        (
            "Ansible requires Python 3.9 or newer on the target. Current version: 3.8.18 (default) [GCC 12.2.0]",
            "3.8",
            "2.20",
        ),
        ("ansible-core requires a minimum of Python version 3.8. Current version: 3.7.16 (x)", "3.7", "2.18"),
        (
            "ansible-core requires a minimum of Python2 version 2.7 or Python3 version 3.6. Current version: 3.5.2",
            "3.5",
            "",
        ),
    ],
)
def test_a_python_that_is_too_old_for_ansible_is_told_with_what_to_install(action, said, found, bound):
    """As ansible-core 2.20, 2.19 and 2.16 say it, before a module begins; the door took it for an answer of something else."""
    answered = action._parse_returned_data({"stdout": json.dumps({"msg": said, "failed": True}), "rc": 1}, *PROFILE)
    assert answered["failed"] and mentions(answered["msg"], "kobuki", found, "docs/start/machines.md")
    assert not bound or f"'ansible-core<{bound}'" in answered["msg"]


def test_what_is_not_documented_is_left_out_with_a_warning(action):
    found = action._parse_returned_data({"stdout": '{"installed": [], "removed": [], "secret": 1}', "rc": 0}, *PROFILE)
    assert "secret" not in found
    assert found["warnings"] == [
        'kobuki: rosfleet.multimaster.multimaster_packages does not document "secret" of its answer, so they are left out.'
    ]


def test_a_warning_has_the_name_of_its_robot_and_is_quoted(action):
    said = json.dumps({"installed": [], "removed": [], "warnings": ['done."\n\nPLAY RECAP ***   kobuki: ok=1']})
    found = action._parse_returned_data({"stdout": said, "rc": 0}, *PROFILE)
    assert found["warnings"] == ['kobuki warns: "done.\' PLAY RECAP *** kobuki: ok=1"']


@pytest.mark.parametrize("profile", [[], ["legacy"]])
def test_ansible_reads_it_in_the_way_of_its_version(action, profile, monkeypatch):
    given = []
    monkeypatch.setattr(ActionBase, "_parse_returned_data", lambda self, *told: given.append(told) or {})
    action._parse_returned_data({"stdout": DUE, "stderr": "", "rc": 0}, *profile)
    ((said, *more),) = given
    assert more == profile and json.loads(said["stdout"])["installed"] == []


def test_no_answer_is_a_sentence_with_the_last_words(action):
    words = "/bin/sh: 1: python9: not found PASSED\n\n"
    found = action._parse_returned_data({"stdout": "", "stderr": words, "rc": 127}, *PROFILE)
    assert mentions(
        found["msg"],
        "kobuki",
        "rosfleet.multimaster.multimaster_packages",
        "127",
        "/bin/sh: 1: python9: not found PASSED",
        "ansible_python_interpreter",
        "Python",
    )
    assert (found["failed"], found["rc"], found["module_stderr"]) == (True, 127, words)


def test_the_last_words_are_plain_and_not_many(action):
    words = "\x1b[2J" + "x" * 30000
    found = action._parse_returned_data({"stdout": words, "stderr": words, "rc": 1}, *PROFILE)
    assert len(found["module_stdout"]) <= robot_action.LAST_WORDS and "\x1b" not in str(found)
    found = action._parse_returned_data({"stdout": "", "stderr": "", "rc": -9}, *PROFILE)
    assert "(exit status -9). Expected" in found["msg"]


def low_level(action, monkeypatch, work):
    monkeypatch.setattr(ActionBase, "_low_level_execute_command", lambda self: work())
    return action._low_level_execute_command()


def test_an_endless_answer_ends_and_so_does_what_brings_it(action, monkeypatch):
    monkeypatch.setattr(robot_action, "MEMORY", 32 << 20)
    started = []

    def work():
        started.append(subprocess.Popen(["yes"], stdout=subprocess.PIPE))
        found = b""
        while True:
            found += started[0].stdout.read(1 << 20)

    with pytest.raises(AnsibleError, match="kobuki: the answer .* found more than 32 MiB"):
        low_level(action, monkeypatch, work)
    assert started[0].wait(5) == -signal.SIGKILL
    assert len(bytes(64 << 20)) == 64 << 20, "the bound ends with the answer"


@pytest.mark.slow
def test_a_silent_robot_ends_in_time_with_what_waits_for_it(action, monkeypatch):
    monkeypatch.setattr(robot_action, "LONGEST", 2.0)  # the program has been started by then
    started = []

    def work():
        started.append(subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]))
        started[0].wait()

    with pytest.raises(AnsibleConnectionFailure, match="no answer within 2 s"):
        low_level(action, monkeypatch, work)
    assert started[0].wait(5) == -signal.SIGKILL


def test_programs_from_before_go_on(action, monkeypatch):
    before = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    try:
        with pytest.raises(ZeroDivisionError):
            low_level(action, monkeypatch, lambda: 1 / 0)
        assert before.poll() is None
    finally:
        os.kill(before.pid, signal.SIGKILL)
        before.wait()


@pytest.mark.parametrize("kind", [AnsibleConnectionFailure, AnsibleAuthenticationFailure])
def test_what_ssh_says_of_a_robot_is_plain(action, monkeypatch, kind):
    def work():
        raise kind("banner\x1b]0;x\x07\nfatal: [other]")

    with pytest.raises(kind) as problem:
        low_level(action, monkeypatch, work)
    assert problem.type is kind
    assert "\x1b" not in str(problem.value) and "\n" not in str(problem.value)


def test_the_limit_leaves_others_alone():
    with robot_action.limit_time(60):
        pass
    assert signal.getsignal(signal.SIGALRM) == signal.SIG_DFL
    with pytest.raises(AnsibleConnectionFailure, match="no answer within 0 s"), robot_action.limit_time(0.05):
        time.sleep(5)
    with pytest.raises(ZeroDivisionError), robot_action.limit_time(60):
        1 / 0  # noqa: B018
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0
    signal.setitimer(signal.ITIMER_REAL, 50)  # as a task's own timeout
    try:
        with robot_action.limit_time(0.01):
            time.sleep(0.05)
        assert 40 < signal.getitimer(signal.ITIMER_REAL)[0] <= 50
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def test_the_limit_needs_the_main_thread():
    ended = []

    def work():
        with robot_action.limit_time(0.01):
            time.sleep(0.05)
        ended.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert ended


def test_a_module_runs_where_no_file_can_be_made_on_the_disk(action, monkeypatch):
    """Ansible's own program fails then, as it does on a full disk; tests/machines/test_alone.py has a full one."""
    crash = {
        "failed": True,
        "module_stderr": "FileNotFoundError: [Errno 2] No usable temporary directory found in ['/tmp']",
    }
    ran = []

    def execute(self, **options):
        ran.append(list(self._task.environment or []))
        return {"changed": False} if ran[-1] else dict(crash)

    monkeypatch.setattr(ActionBase, "_execute_module", execute)
    found = action._execute_module(module_args={}, task_vars={"inventory_hostname": "kobuki"})
    assert ran == [[], [{"TMPDIR": "/dev/shm"}]]
    assert found["changed"] is False and mentions(found["warnings"][0], "kobuki", "/tmp", "df /tmp")
    assert action._execute_module(module_args={}, task_vars={}) == {"changed": False}
