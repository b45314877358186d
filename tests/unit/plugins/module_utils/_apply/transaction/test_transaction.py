# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Steps that are all done, or undone in the reverse order."""

import errno

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic, transaction
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.record import Record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.transaction import Step
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions

BACK = "Everything is as it was before."


class Story:
    """Steps that write down what is done and undone."""

    def __init__(self):
        self.told = []

    def step(self, name, do=None, undo=None, **more):
        def call(what, problem):
            def called():
                self.told.append(what)
                if isinstance(problem, Exception):
                    raise problem
                return problem

            return called

        return Step(name, call(f"do {name}", do), call(f"undo {name}", undo), **more)


def failure(*steps):
    with pytest.raises(transaction.StepFailure) as caught:
        transaction.carry_out(steps)
    return caught.value


def test_all_steps_are_done_in_their_order():
    story = Story()
    transaction.carry_out([story.step("a"), story.step("b")])
    assert story.told == ["do a", "do b"]


@pytest.mark.parametrize(
    ("problem", "said"),
    [
        (Problem("No room."), f"No room. {BACK}"),
        (ValueError("odd"), f"odd {BACK}"),
        (
            OSError(errno.ENOSPC, "No space left on device", "/f"),
            "/f cannot be written (No space left on device); expected a writable file: make room on its file system. "
            + BACK,
        ),
    ],
)
def test_a_failure_undoes_the_half_done_and_the_done_in_reverse(problem, said):
    story = Story()
    found = failure(story.step("a"), story.step("b"), story.step("c", do=problem), story.step("d"))
    assert story.told == ["do a", "do b", "do c", "undo c", "undo b", "undo a"]
    assert (str(found), found.cause, found.left) == (said, problem, [])


def test_a_failed_undo_is_told_and_the_others_go_on():
    story = Story()
    found = failure(
        story.step("a", undo=OSError(errno.EROFS, "Read-only file system")),
        story.step("b", undo=["'one'", "'two'"]),
        story.step("c", undo=Problem("refused"), failure="{what} stays: {reason}"),
        story.step("d", do=Problem("No.")),
    )
    assert story.told[4:] == ["undo d", "undo c", "undo b", "undo a"]
    assert found.left == ["c stays: refused", "'one'", "'two'", "a (Read-only file system)"]
    assert mentions(str(found), "c", "refused", "one", "two", "a", "Read-only")


def test_a_step_may_depend_on_the_undo_of_those_after_it():
    story = Story()
    bad = story.step("b", undo=ValueError("stuck"))
    failure(story.step("a", only_if_all_undone=True), bad, story.step("c", do=Problem("No.")))
    assert story.told[3:] == ["undo c", "undo b"]


def test_a_defect_of_the_program_is_no_sentence():
    story = Story()
    with pytest.raises(KeyError):
        transaction.carry_out([story.step("a"), story.step("b", do=KeyError("x"))])
    assert story.told == ["do a", "do b"]


@pytest.mark.parametrize("before", [{}, {"old": 1}])
def test_the_record_holds_intent_owner_and_earlier_state(tmp_path, before):
    record = Record("x", str(tmp_path / "records"))
    record.save(before)
    seen = []
    look = Step("look", lambda: seen.append(record.load()))
    intent, outcome = transaction.intent(record, {"new": "?"}, before), transaction.outcome(record, {"new": 2})

    failed = Step("fail", lambda: int("x"))
    failure(intent, look, failed, outcome)
    assert record.load() == before and (tmp_path / "records").exists() == bool(before)

    transaction.carry_out([intent, look, outcome])
    assert seen == [{"new": "?"}] * 2 and record.load() == {"new": 2}


def test_the_intent_stays_where_something_could_not_be_undone(tmp_path):
    record = Record("x", str(tmp_path))
    stuck = Step("/f", transaction.do_nothing, lambda: ["/f"])
    found = failure(transaction.intent(record, {"new": "?"}, {}), stuck, Step("", lambda: int("x")))
    assert found.left == ["/f"] and record.load() == {"new": "?"}


def test_a_record_that_cannot_be_put_back_is_told(tmp_path, monkeypatch):
    record = Record("x", str(tmp_path))

    def readonly(path):
        raise OSError(errno.EROFS, "Read-only file system", path)

    def failing(*words):
        monkeypatch.undo()
        breaks = Step("", lambda: monkeypatch.setattr(atomic, "remove_for_good", readonly))
        return failure(transaction.intent(record, {"a": 1}, {}, *words), breaks, Step("", lambda: int("x"))).left

    assert failing() == [f"{record.path} (Read-only file system)"]
    assert failing("The {what}: {reason}.") == [f"The {record.path}: Read-only file system."]
