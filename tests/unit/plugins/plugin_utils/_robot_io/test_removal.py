# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The summary of a teardown: a computer is as before only if it was looked at, and nothing is left."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.removal import Removal, summarize_removal

ALL = {"owned": ["files-firewall", "files-nodes", "hosts_entries", "routes", "services-multimaster", "sysctl"]}
NOTHING = {"owned": [], "problems": []}


def done(*concerns, failed=False, removed=(), **more):
    runs = {concern: [{"changed": True}] for concern in concerns}
    if removed:
        runs["managed_services"] = [{"changed": True, "removed": list(removed)}]
    return {"changed": True, "concerns": runs, **({"failed": True} if failed else {}), **more}


STOPPED = done(removed=["multimaster-roscore.service", "multimaster-sync.service"])
TAKEN = done("managed_files", "hosts_entries")
CLOSED = done("sysctl", "routes", "firewall")


def test_all_are_as_before_and_a_person_is_told_what_to_do():
    removals = {name: Removal([STOPPED, TAKEN, CLOSED], ALL, NOTHING) for name in ("robo1-nuc", "robo2-nuc")}
    assert summarize_removal(removals) == [
        "TEARDOWN: 2 of 2 computers are as before.",
        "  robo1-nuc, robo2-nuc: as before.",
        "On each robot: log in again, start your roscore and your nodes again (they ran at a roscore that is gone).",
        "Debian packages stay, but for those that the collection installed.",
    ]


def test_a_roscore_of_theirs_stays():
    stopped = done(removed=["multimaster-sync.service"])
    (advice,) = [line for line in summarize_removal({"a": Removal([stopped], ALL, NOTHING)}) if "On each" in line]
    assert "your nodes again" in advice and "roscore" not in advice


def test_a_second_teardown_asks_for_nothing():
    lines = summarize_removal({"a": Removal([done(), done(), done()], NOTHING, NOTHING)})
    assert lines[0] == "TEARDOWN: 1 of 1 computers is as before." and not any("log in" in line for line in lines)


@pytest.mark.parametrize(
    ("removal", "words"),
    [
        (
            Removal([STOPPED, TAKEN, done("routes", failed=True)], ALL, {}, lost=True),
            "FAILED, for the reason above; left: packet filter, routes, kernel settings; repair that, and run this again",
        ),
        (
            Removal([], {}, {}, lost=True),
            "FAILED, for the reason above; left: see there; repair that, and run this again",
        ),
        (
            Removal([STOPPED, TAKEN, CLOSED], ALL, {"owned": ["files-clock", "x\n"]}),
            'left: files, "x"; run this again',
        ),
        (
            Removal([STOPPED, TAKEN, CLOSED], ALL, {}),
            "taken back, but whether something is left could not be read; run this again",
        ),
        (
            Removal([STOPPED, TAKEN, CLOSED], ALL, {"owned": [], "problems": ["The part owned could not be read."]}),
            "taken back, but whether something is left could not be read; run this again",
        ),
        (
            Removal([STOPPED, TAKEN, {**CLOSED, "warnings": ["a route was lost"]}], ALL, NOTHING),
            "taken back, but not all is as before: see the warnings above",
        ),
    ],
)
def test_a_computer_that_is_not_as_before_is_named(removal, words):
    lines = summarize_removal({"good": Removal([STOPPED, TAKEN, CLOSED], ALL, NOTHING), "odd": removal})
    assert lines[0] == "TEARDOWN: 1 of 2 computers is as before."
    assert lines[1:3] == ["  good: as before.", f"  odd: {words}."]


def test_many_names_are_counted():
    removals = {f"robot{number}": Removal([], NOTHING, NOTHING) for number in range(50)}
    assert "robot19 and 30 more: as before." in summarize_removal(removals)[1]
