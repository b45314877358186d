# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The last lines of a service: bounded, plain, and a sentence where there are none. The journal itself: tests/systems/test_bundle.py."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import logs


def test_lines_are_plain_and_as_many_as_asked_for(monkeypatch):
    asked = []

    def run(argv, limit):
        asked.append(argv)
        return Answer(0, b"one\n  two\x1b[2J\n" + b"x" * 9000 + b"\n\xff\n", "")

    monkeypatch.setattr(logs, "run", run)
    lines, problem = logs.last_lines("sync", 2)
    assert "--lines=2" in asked[0] and asked[0][-1] == "--unit=multimaster-sync.service"
    assert lines[:2] == ["one", "two\\x1b[2J"] and len(lines[2]) == 2000 and len(lines) == 4 and problem == ""


def test_a_journal_that_cannot_be_read(monkeypatch):
    monkeypatch.setattr(logs, "run", lambda argv, limit: Answer(-1, b"", "journalctl gave no answer within 20 s"))
    assert logs.last_lines("sync", 2) == ([], "journalctl gave no answer within 20 s")
