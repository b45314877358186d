# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The shell of the modules that change a machine: plan, refuse or warn, apply unless in check mode, report.

A module's `main` gives its Concern to `run_module`, which `multimaster_computer` takes, too:

    CONCERN = Concern("routes", OPTIONS, lambda module, memory: Run(module.params, memory), "routes")
"""

import time
import typing

from ..._base import ends
from ..._base.module import Module
from ..._base.problem import Problem, explain_unreadable, sentence
from . import deadman, lock
from .network.state import StateWatch
from .transaction import Step

Fields = typing.Dict[str, typing.Any]


class ModuleRun:
    """One run of a module. Making it reads the machine and plans; it changes nothing and raises Problem or OSError."""

    #: whether anything changes on the machine, and at run time, which a dead-man's switch guards
    changed = runtime_changes = False
    #: all that the run has to know which confirms a change at run time, for JSON
    memory: Fields = {}
    #: the network state over the change, if it may lose something foreign; its step is in `watch_steps`
    watch: typing.Optional[StateWatch] = None

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences that stop the plan, also in check mode; empty if it is carried out."""
        return []

    def foresee(self) -> typing.List[str]:
        """Try the change without a change, only in check mode: some failures show only then.

        Returns the sentences on them.
        """
        return []

    @property
    def warnings(self) -> typing.List[str]:
        """The sentences to warn with; asked for before `apply` and again after it."""
        return []

    @property
    def difference(self) -> typing.Any:
        """The value of `diff`, None if `result` has it."""
        return None

    def watch_steps(self) -> typing.List[Step]:
        """The first steps of a change: its undo ends with a look at the network state."""
        return [self.watch.step] if self.watch else []

    def result(self) -> Fields:
        """The other return values of the module; asked for after `apply`."""
        raise NotImplementedError

    def failure(self, problem: Problem) -> Fields:
        """The return values besides `msg` if the run ends with this problem: by default those of a success."""
        return self.result()

    def summary(self, check_mode: bool) -> str:
        """The sentences of `msg`."""
        raise NotImplementedError

    def apply(self) -> None:
        """Carry out the plan. Raises Problem; then everything is as it was before, or the sentence lists the exceptions."""
        raise NotImplementedError


Make = typing.Callable[[typing.Any, typing.Any], ModuleRun]  # out of a module, and of the memory of an earlier run


class PlainGuard:
    """The frame of a run without a dead-man's switch, with the methods of deadman.DeadmanGuard."""

    waits_for = 0

    def begin(self) -> typing.Any:
        """Return None, since a run without a dead-man's switch has no memory of an earlier run."""
        return None

    def apply(self, run: typing.Any) -> None:
        """Carry out the plan. Raises Problem."""
        run.apply()

    def wait_at_this_pace(self, took: float) -> None:
        """Nothing waits for a confirmation."""

    def failure(self, problem: Problem, **result: typing.Any) -> Fields:
        """Return the result of a module that ends with a sentence."""
        return dict(result, failed=True, msg=str(problem))

    def success(self, **result: typing.Any) -> Fields:
        """Return the result of a module."""
        return result


class Concern(typing.NamedTuple):
    """A module by its name, which is that of its dead-man's switch, too."""

    name: str
    options: Fields  # the argument_spec of its module, without that of a confirmation
    make: Make  # its ModuleRun; only a dead-man's switch has the memory of an earlier run
    guarded: str = ""  # the thing that its switch guards, as in a sentence; empty without a switch
    many: bool = False  # multimaster_computer takes its options several times
    fixed: Fields = {}  # options that its place in the order of multimaster_computer decides

    @property
    def specification(self) -> Fields:
        """The argument_spec of its module."""
        return dict(deadman.OPTIONS, **self.options) if self.guarded else self.options

    def make_guard(self, module: typing.Any) -> typing.Any:
        """Make the frame of its run."""
        return deadman.DeadmanGuard(module, self.guarded, deadman.Switch(self.name)) if self.guarded else PlainGuard()


def run_module(concern: Concern) -> None:
    """Run the module of a concern and end it. Two runs at once on one computer wait for each other."""
    module = Module(argument_spec=concern.specification, supports_check_mode=True)
    guard = concern.make_guard(module)
    folders = [] if module.check_mode else [module.params["records"]]
    try:
        with lock.hold(folders, module._name) as unlocked:
            result = run_locked(module, concern.make, guard, unlocked)
    except Problem as problem:  # of the lock
        result = guard.failure(problem)
    return (ends.fail if result.pop("failed", False) else ends.leave)(module, **result)


def run_locked(module: typing.Any, make: Make, guard: typing.Any, unlocked: typing.Iterable[str]) -> Fields:
    """Run a module if the lock is held already; returns its result. `unlocked`: why it is not held, see lock.hold."""

    def make_run() -> ModuleRun:
        memory = guard.begin()
        with explain_unreadable():
            return make(module, memory)

    run, began = None, time.monotonic()
    try:
        run = lock.read_undisturbed(module.params["records"], make_run) if module.check_mode else make_run()
        _carry_out(module, run, guard, unlocked)
    except (OSError, Problem) as cause:  # OSError: of the dead-man's switch
        problem = cause if isinstance(cause, Problem) else Problem(sentence(cause))
        result: Fields = guard.failure(problem, **(run.failure(problem) if run else {}))
        return result
    guard.wait_at_this_pace(time.monotonic() - began)
    result = run.result()
    if module._diff and run.difference is not None:
        result["diff"] = run.difference
    result = guard.success(changed=run.changed, msg=run.summary(module.check_mode), **result)
    return result


def _carry_out(module: typing.Any, run: ModuleRun, guard: typing.Any, unlocked: typing.Iterable[str]) -> None:
    refusals = run.refusals or (run.foresee() if module.check_mode else [])
    if refusals:
        raise Problem(" ".join(refusals))
    warnings = run.warnings
    _warn(module, [*warnings, *(unlocked if run.changed else ())])
    if not module.check_mode:
        guard.apply(run)
        lost = run.watch.finish() if run.watch else []
        _warn(module, [*(sentence for sentence in run.warnings if sentence not in warnings), *lost])


def _warn(module: typing.Any, sentences: typing.Iterable[str]) -> None:
    for text in sentences:
        ends.warn(module, text)
