# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The one door by which answers of robots reach the controller: each module of the collection runs by it, and its answer is data."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import resource
import signal
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

from ansible.errors import AnsibleConnectionFailure, AnsibleError
from ansible.plugins.action import ActionBase
from ansible.release import __version__ as ansible_version

from .._base.plain_text import LINE, plain, plain_lines, quote
from . import answer
from .answer import OldPython
from .documentation import Answer, read_documentation

MODULES = Path(__file__).resolve().parents[2] / "modules"
LONGEST = 1800.0  # seconds for one answer; `timeout` of a task, or ANSIBLE_TASK_TIMEOUT, ends it earlier
MEMORY = 96 << 20  # bytes for one answer while it comes: Ansible keeps all of it, in several copies
# The first release of ansible-core that does without a Python on robots.
FIRST_WITHOUT = {"3.6": "2.17", "3.7": "2.18", "3.8": "2.20"}
NO_ROOM = "No usable temporary directory found"  # of Python, where a disk is full or read-only
BESIDE_DISKS = "/dev/shm"  # a folder in memory, where each user may make files
LAST_WORDS = 20_000  # characters of the output of a module that crashed

Result = dict[str, Any]


class RobotAction(ActionBase):  # type: ignore[misc]  # ansible-core has no types
    """Runs the module of its own name on a robot. Only documented values come back, within bounds."""

    _robot = "this computer"

    def __init_subclass__(cls) -> None:
        """Read the documentation of the module while Ansible loads the action: once, and not in each of its workers."""
        super().__init_subclass__()
        if cls.__name__ == "ActionModule":
            answer_of(cls.__module__.rpartition(".")[2])

    def run(self, tmp: None = None, task_vars: dict[str, Any] | None = None) -> Result:
        """Return the answer of the action; see ActionBase."""
        result: Result = super().run(tmp, task_vars)
        return {**result, **self.answer(self._task.args, task_vars or {})}

    def answer(self, args: Mapping[str, Any], task_vars: dict[str, Any]) -> Result:
        """Return the answer of the module to the options of the task."""
        return self._execute_module(module_args={**args}, task_vars=task_vars)

    def _execute_module(self, *args: Any, task_vars: dict[str, Any] | None = None, **options: Any) -> Result:
        """Run a module; see ActionBase. Ansible first asks the robot for its Python, so that answer has bounds as well."""
        self._robot = str((task_vars or {}).get("inventory_hostname", self._robot))
        result: Result = super()._execute_module(*args, task_vars=task_vars, **options)
        if NO_ROOM not in str(result.get("module_stderr")):
            return result
        # Before a module begins, Ansible's own program makes a folder, below /tmp in most cases.
        self._task.environment = [*(self._task.environment or []), {"TMPDIR": BESIDE_DISKS}]
        result = super()._execute_module(*args, task_vars=task_vars, **options)
        note = f"{self._robot}: no file can be made in /tmp; expected a disk with room that can be written: look there with 'df /tmp' and 'mount'."
        return {**result, "warnings": [*result.get("warnings", []), note]}

    def _low_level_execute_command(self, *args: Any, **options: Any) -> Result:
        """Run a command; see ActionBase. Its output has bounds, and the messages of ssh are plain text."""
        try:
            with limit_run(LONGEST, MEMORY):
                output: Result = super()._low_level_execute_command(*args, **options)
                return output
        except AnsibleConnectionFailure as problem:
            raise type(problem)(plain(problem, LINE)) from None
        except MemoryError:
            pass
        # An AnsibleError from here has no traceback of the place where the memory ended.
        raise AnsibleError(self._explain_strange_answer(f"more than {MEMORY >> 20} MiB"))

    def _parse_returned_data(self, res: Mapping[str, Any], *profile: Any) -> Any:
        """Let Ansible read the output of a module, which has only its answer left; see ActionBase."""
        checked = {**res, "stdout": json.dumps(self._read_result(res)), "stderr": ""}
        return super()._parse_returned_data(checked, *profile)

    def _read_result(self, res: Mapping[str, Any]) -> Result:
        """Return the answer in an output, or a failure with the reason why there is no answer."""
        text = answer.find_answer(str(res.get("stdout") or ""))
        if not text:
            return self._explain_silence(res)
        old = answer.find_old_python(text)
        if old:
            return {"failed": True, "msg": self._explain_old_python(old)}
        try:
            # A play may have a former name of the module, which is a redirect.
            module = (self._task.resolved_action or self._task.action).rpartition(".")[2]
            checked = answer.check_answer(text, answer_of(module))
        except answer.StrangeAnswer as strange:
            return {"failed": True, "msg": self._explain_strange_answer(str(strange))}
        result = dict(checked.result)
        if "warnings" in result:  # Ansible shows them without the name of the robot
            result["warnings"] = [f"{self._robot} warns: {quote(text, LINE)}" for text in result["warnings"]]
        if checked.left_out:
            names = ", ".join(sorted(checked.left_out)[:3])
            note = f"{self._robot}: {self._task.action} does not document {names} of its answer, so they are left out."
            result["warnings"] = [*result.get("warnings", []), note]
        if checked.trace:
            result["exception"] = checked.trace[-LAST_WORDS:]
        return result

    def _explain_silence(self, res: Mapping[str, Any]) -> Result:
        """Return the result of a module without an answer: it could not run, or was killed."""
        words = [plain_lines(str(res.get(name) or "")[-LAST_WORDS:]) for name in ("stdout", "stderr")]
        last = next((line for text in reversed(words) for line in reversed(text.splitlines()) if line.strip()), "")
        ending = f"; it said last: {quote(last, LINE)}" if last else ""
        message = (
            f"{self._robot}: {self._task.action} has not answered (exit status {res.get('rc')}){ending}. Expected that "
            "ansible_python_interpreter is a Python 3.6 or later there, and that nothing ends it."
        )
        return {
            "failed": True,
            "msg": message,
            "module_stdout": words[0],
            "module_stderr": words[1],
            "rc": res.get("rc"),
        }

    def _explain_old_python(self, old: OldPython) -> str:
        bound = FIRST_WITHOUT.get(old.found)
        install = f"on the controller, pip install 'ansible-core<{bound}', or " if bound else ""
        return (
            f"{self._robot}: its Python is {old.found}, and ansible-core {ansible_version} of the controller needs {old.needed} or later "
            f"there; expected two that go together (docs/start/machines.md): {install}set ansible_python_interpreter to a later Python."
        )

    def _explain_strange_answer(self, content: str) -> str:
        return (
            f"{self._robot}: the answer to {self._task.action} is none of this module: found {content}; expected the answer that its "
            "documentation says. Something else than the module answers there: look at this computer before you trust it."
        )


@functools.cache
def answer_of(module: str) -> Answer:
    """Return the documented answer of a module of the collection."""
    return read_documentation(module, lambda name: (MODULES / f"{name}.py").read_text(encoding="utf-8"))


class _Timeout(BaseException):
    """A timeout. It is no Exception, since connection plugins catch those and try again."""


@contextlib.contextmanager
def limit_run(seconds: float, memory: int) -> Iterator[None]:
    """Give the block so many seconds and bytes. After an error, the programs that it started end.

    Raises AnsibleConnectionFailure after the time, and MemoryError beyond the memory.
    """
    before = set(_list_children())
    try:
        with limit_time(seconds), _limit_memory(memory):
            yield
    except BaseException:
        for process in set(_list_children()) - before:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        raise


@contextlib.contextmanager
def limit_time(seconds: float) -> Iterator[None]:
    """Raise AnsibleConnectionFailure after this time. Without an answer, ssh waits as long as TCP does, for hours.

    The `timeout` of a task uses the same alarm. If it is set, it limits the time already.
    """

    def ring(number: int, frame: FrameType | None) -> None:
        raise _Timeout

    if threading.current_thread() is not threading.main_thread() or signal.getitimer(signal.ITIMER_REAL)[0]:
        yield
        return
    former = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    except _Timeout:
        raise AnsibleConnectionFailure(f"no answer within {seconds:.0f} s") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, former)


@contextlib.contextmanager
def _limit_memory(memory: int) -> Iterator[None]:
    """Let this process, one of Ansible's workers, grow by so many bytes; MemoryError beyond. Only Linux counts them."""
    used = _measure_memory()
    if not used:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limits = [used + memory, *(limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY)]
    resource.setrlimit(resource.RLIMIT_DATA, (min(limits), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _measure_memory() -> int:
    """Return the bytes of data that this process has (proc_pid_status(5), VmData); 0 if the system does not say it."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) << 10 for line in lines if line.startswith("VmData:")), 0)


def _list_children() -> list[int]:
    """Return the processes that this one has started (proc_pid_task_children(5)); an empty list if the system does not say it."""
    children: list[int] = []
    for path in Path("/proc/self/task").glob("*/children"):
        with contextlib.suppress(OSError):
            children += map(int, path.read_text(encoding="ascii").split())
    return children
