# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Steps of a change: done in their order, and undone in the reverse order if one of them fails.

A change that has a record begins with the step `intent`, which saves the planned change. So a run that is killed
leaves nothing on the machine that the next run does not know of. It ends with the step `outcome`, which saves the state that is
owned from then on:

    carry_out([intent(record, planned, before), Step("/etc/example", write, restore), outcome(record, after)])
"""

import functools
import typing

from ..._base.problem import Problem, sentence
from .record import Record

FAILURES = (OSError, ValueError, Problem)  # the exceptions of a step; any other is a defect of the program
Data = typing.Dict[str, typing.Any]


def do_nothing() -> None:
    """Do nothing: for a step that has only one of its two halves."""


class Step(typing.NamedTuple):
    """One step of a change."""

    what: str  # names the step in the sentence on a failed undo
    do: typing.Callable[[], typing.Any]  # raises OSError, ValueError or Problem
    #: brings the state from before back, also after half of `do`; raises as `do`, or returns a sentence per failure
    undo: typing.Callable[[], typing.Optional[typing.List[str]]] = do_nothing
    only_if_all_undone: bool = False  # undo this step only if every step after it could be undone
    failure: str = "{what} ({reason})"  # says that `undo` raised an exception


class StepFailure(Problem):
    """A step has failed, and the steps before it are undone as far as possible. Its text says both."""

    def __init__(self, cause: Exception, left: typing.List[str], text: str) -> None:
        super().__init__(text)
        self.cause = cause
        self.left = left  # a text for everything that could not be undone


#: The cause and the remains, to the text of a StepFailure.
Explain = typing.Callable[[Exception, typing.List[str]], str]


class Sentence(str):
    """A text on something that could not be undone, as a whole sentence."""


class Unseen(Sentence):
    """A sentence on something that the run could not look at, so its state is unknown."""


def explain_failure(cause: Exception, left: typing.List[str]) -> str:
    """Return the sentence of the cause, followed by the steps that were undone."""
    return f"{sentence(cause)} {explain_state(left, 'Everything is as it was before.')}"


def explain_state(left: typing.Sequence[str], good: str) -> str:
    """Return the sentences on the state after an undo; `good` if nothing is left."""
    names = [text for text in left if not isinstance(text, Sentence)]
    sentences = [f"Not put back: {', '.join(names).rstrip('.')}."] if names else []
    sentences += [text for text in left if isinstance(text, Sentence) and not isinstance(text, Unseen)]
    unseen: typing.List[str] = [text for text in left if isinstance(text, Unseen)]
    if unseen and not sentences:
        sentences = ["All that could be looked at is as it was before."]
    return " ".join(sentences + unseen) or good


def carry_out(steps: typing.Iterable[Step], explain: Explain = explain_failure) -> None:
    """Do all steps, or undo those that were done. Raises StepFailure; `explain` is for a module that has its own sentences."""
    started: typing.List[Step] = []
    try:
        for step in steps:
            started.append(step)
            step.do()
    except FAILURES as problem:
        left = undo(started)
        raise StepFailure(problem, left, explain(problem, left)) from problem


def undo(steps: typing.Sequence[Step]) -> typing.List[str]:
    """Undo steps, the last one first; returns a text for everything that could not be undone."""
    left: typing.List[str] = []
    for step in reversed(steps):
        if left and step.only_if_all_undone:
            continue
        try:
            left += step.undo() or []
        except FAILURES as problem:
            reason = getattr(problem, "strerror", None) or problem
            left.append(step.failure.format(what=step.what, reason=reason))
    return left


def intent(record: Record, data: Data, before: Data, failure: str = "{what} ({reason})") -> Step:
    """The step that saves the planned change, before the first change.

    Its undo saves the record of `before`, unless something could not be undone: then the next run needs the
    intent to repair it.
    """
    save, restore = (functools.partial(record.save, content) for content in (data, before))
    return Step(record.path, save, restore, True, failure)


def outcome(record: Record, after: Data) -> Step:
    """The step that saves the owned items after the last change; an undo of it is that of `intent`."""
    return Step(record.path, lambda: record.save(after))
