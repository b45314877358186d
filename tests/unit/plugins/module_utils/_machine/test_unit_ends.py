# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The last end of a service, as the journal has it; tests/systems/test_sandbox.py has that of a real systemd."""

import json

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.unit_ends import (
    UnitEnd,
    list_words,
    read_ends,
)

SYNC, ROSCORE = "multimaster-sync.service", "multimaster-roscore.service"
FAILED, SUCCEEDED, EXITED = (
    "d9b373ed55a64feb8242e02dbe79a49c",
    "7ad2d189f7e94e70a38c781354912448",
    "98e322203f7a4ed290d09fe03c09fe15",
)


def line(at, **fields):
    return json.dumps({"__REALTIME_TIMESTAMP": str(at * 1000000), "__CURSOR": "s=1", **fields})


def failed(at, result, unit=SYNC):
    return line(at, MESSAGE_ID=FAILED, UNIT=unit, UNIT_RESULT=result, MESSAGE="x: Failed with result.")


def exited(at, status, unit=SYNC):
    return line(at, MESSAGE_ID=EXITED, UNIT=unit, EXIT_STATUS=status)


def judged(at, unit=SYNC):
    text = f"{unit} hangs, and is ended: no sign of life for 31 s, and it is stopped"
    return line(at, _SYSTEMD_UNIT="multimaster-watchdog.service", MESSAGE=text)


@pytest.mark.parametrize(
    ("lines", "end"),
    [
        ([failed(90, "oom-kill"), exited(90, "9")], UnitEnd("oom-kill", 9)),
        ([failed(90, "watchdog"), exited(90, "6")], UnitEnd("watchdog", 6)),
        ([failed(90, "core-dump"), exited(90, "6"), judged(89)], UnitEnd("watchdog", 6)),
        ([failed(90, "signal"), exited(90, "9"), judged(79)], UnitEnd("watchdog", 9)),
        ([failed(90, "signal"), exited(90, "9"), judged(9)], UnitEnd("signal", 9)),
        ([failed(90, "signal"), exited(90, "9"), judged(89, ROSCORE)], UnitEnd("signal", 9)),
        ([failed(90, "exit-code"), exited(90, "1"), failed(80, "oom-kill"), exited(80, "9")], UnitEnd("exit-code", 1)),
        ([line(90, MESSAGE_ID=SUCCEEDED, UNIT=SYNC), failed(80, "oom-kill")], UnitEnd("success")),
        ([judged(91), failed(90, "oom-kill"), exited(90, "9")], UnitEnd("oom-kill", 9)),
        ([failed(90, "exit-code"), exited(90, "x" * 99)], UnitEnd("exit-code")),
        ([failed(90, ["a"])], UnitEnd()),
    ],
)
def test_the_last_end_is_told(lines, end):
    assert read_ends(lines, [SYNC, ROSCORE]) == {SYNC: end}


@pytest.mark.parametrize("text", ["", "x", "[]", "7", "{}", line("x"), failed(1, "signal", "ssh.service")])
def test_another_line_tells_nothing(text):
    assert read_ends([text], [SYNC]) == {}


def test_the_words_of_others_are_not_asked_for():
    words = list_words([SYNC])
    of_systemd, _plus, of_the_watchdog = " ".join(words).partition(" + ")
    assert "_PID=1" in of_systemd and of_the_watchdog == "_SYSTEMD_UNIT=multimaster-watchdog.service"
