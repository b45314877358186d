# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The method rosfleetChanges."""

import json
import threading
import time
import types

import pytest
from rosfleet_multimaster.roscore import changes as module
from rosfleet_multimaster.roscore.core.registry import Registry
from running_sync import until

from tests.unit.nodes.roscore.records import rec

NODE = rec("node", "/a", "http://robot:1/")
PUBLISHER = rec("publisher", "/chatter", "/a", "http://robot:1/", True)


class Roscore:
    def __init__(self, own=True):
        self.registry, self.lock, self.away = Registry(), threading.RLock(), False
        self.caller = types.SimpleNamespace(is_own=own, has_left=lambda: self.away)
        self.feed = module.Changes(
            "now",
            self.lock,
            lambda: [*self.registry.facts.values(), rec("parameter", "/watched", None)],
            lambda: self.caller,
        )

    def change(self, *records):
        with self.lock:
            for record in records:
                if record[0] not in ("refused", "parameter"):
                    self.registry.apply(record)
            self.feed.add(list(records))

    def ask(self, epoch="now", revision=0, wait=0, *more):
        code, text, value = self.feed.answer("/me", epoch, revision, wait, *more)
        assert code == 1, text
        return value


def test_who_asks_first_gets_all():
    roscore = Roscore()
    roscore.change(NODE, PUBLISHER)
    assert roscore.ask("") == [
        "now",
        1,
        True,
        [NODE.row, ["publisher", "/chatter", "/a", True], ["parameter", "/watched"]],
    ]


def test_then_what_changed():
    roscore = Roscore()
    roscore.change(NODE)
    roscore.change(PUBLISHER)
    assert roscore.ask(revision=1) == ["now", 2, False, [["publisher", "/chatter", "/a", True]]]
    assert roscore.ask(revision=2) == ["now", 2, False, []]


@pytest.mark.parametrize(("epoch", "revision"), [("", 0), ("now", 1), ("now", 2)])
def test_in_texts_it_is_the_same(epoch, revision):
    roscore = Roscore()
    roscore.change(NODE)
    roscore.change(PUBLISHER, rec("type", "/chatter", "x/Y"))
    *about, records = roscore.ask(epoch, revision)
    *same, texts = roscore.ask(epoch, revision, 0, True)
    assert about == same and roscore.ask(epoch, revision, 0, False)[3] == records
    found = [record[:-1] if record[-1] is None else record for text in texts for record in json.loads(text)]
    assert found == records


def test_what_nobody_is_told_of_is_no_revision():
    roscore = Roscore()
    roscore.change(rec("set", "/speed", 3), rec("listener", "/speed/", "/a", "http://robot:1/", True))
    assert roscore.ask()[1] == 0


def test_a_refused_import_is_told_once_and_left_out_of_the_whole():
    roscore = Roscore()
    roscore.change(rec("refused", "/a", "http://far:1/", "why"))
    assert roscore.ask() == ["now", 1, False, [["refused", "/a", "http://far:1/", "why"]]]
    assert all(record[0] != "refused" for record in roscore.ask("")[3])


def test_a_caller_that_waits_hears_at_once():
    roscore = Roscore()
    timer = threading.Timer(0.2, roscore.change, [NODE])
    began = time.monotonic()
    timer.start()
    assert roscore.ask(wait=30) == ["now", 1, False, [NODE.row]]
    assert 0.1 < time.monotonic() - began < 1.0


def test_a_caller_that_waits_holds_no_lock_and_gets_a_bookmark():
    roscore, answers = Roscore(), []
    thread = threading.Thread(target=lambda: answers.append(roscore.ask(wait=0.5)))
    thread.start()
    time.sleep(0.1)
    assert roscore.lock.acquire(timeout=0.1)
    roscore.lock.release()
    thread.join()
    assert answers == [["now", 0, False, []]]


def test_a_caller_that_is_gone_frees_its_place(monkeypatch):
    monkeypatch.setattr(module, "LOOK", 0.05)
    roscore = Roscore()
    roscore.away = True
    began = time.monotonic()
    roscore.ask(wait=30)
    assert time.monotonic() - began < 1.0


def test_few_wait_at_once_and_others_are_still_answered():
    roscore = Roscore()
    threads = [threading.Thread(target=roscore.ask, kwargs={"wait": 30}) for _number in range(module.WAITING)]
    for thread in threads:
        thread.start()
    until(lambda: roscore.feed._waiting == module.WAITING)
    assert roscore.feed.answer("/me", "now", 0, 30)[0] == -1
    assert roscore.ask("")[2] is True
    roscore.change(NODE)  # so they end
    for thread in threads:
        thread.join()
    assert roscore.ask(revision=1, wait=0.01)[3] == []


def test_programs_of_other_computers_are_not_told():
    assert Roscore(own=False).feed.answer("/me", "", 0, 0)[0] == -1


@pytest.mark.parametrize(
    "arguments", [(), ("/me",), ("/me", "", "1", 0), ("/me", 1, 1, 0), ("/me", "", 1, "x"), ("/me", "", 1, [])]
)
def test_nonsense_is_refused(arguments):
    assert Roscore().feed.answer(*arguments)[0] == -1


def test_who_follows_has_the_state_of_the_roscore():
    """Changes at random, and a follower with a short history: it has what is there, whatever it missed."""
    roscore = Roscore()
    roscore.feed._feed._most = 5
    mirror, known = set(), ("", 0)
    for number in range(300):
        roscore.change(rec("publisher", f"/topic_{number % 7}", "/a", "http://robot:1/", number % 3 != 0))
        if number % 4 == 0:
            epoch, revision, whole, records = roscore.ask(*known)
            known = (epoch, revision)
            mirror = set() if whole else mirror
            for record in records:
                if record[0] == "publisher":
                    (mirror.add if record[3] else mirror.discard)(record[1])
            assert mirror == {record[1] for record in roscore.registry.facts.values()}
