# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The runs before: which files are theirs, which stay, and the difference to the last one."""

import copy
import json
import random
import time

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report import earlier
from reported import reported

OTHERS = ["notes.txt", ".report-x1", "2026-11-24.json", "2026-11-24T0810.json", "20261124T081021.json", "latest.json"]


def files(draw, runs):
    """The files of some runs, in no order, among those of others."""
    moments = draw.sample(range(1_600_000_000, 1_800_000_000), runs)
    names = [time.strftime(earlier.NAME, time.gmtime(moment)) for moment in moments]
    beside = [name + end for name in names for end in (".json", ".html")] + OTHERS
    draw.shuffle(beside)
    return sorted(names), beside


@pytest.mark.parametrize("seed", range(30))
def test_the_last_runs_stay_and_files_of_others_too(seed):
    draw = random.Random(seed)
    names, beside = files(draw, draw.randrange(0, 3 * earlier.KEPT))
    gone = set(earlier.expired(beside))
    kept = names[-earlier.KEPT :]
    assert gone == {name + end for name in names[: -earlier.KEPT] for end in (".json", ".html")}
    assert earlier.latest(set(beside) - gone) == (kept[-1] + ".json" if kept else "")


def test_a_page_without_data_is_no_run_before():
    assert earlier.latest(["2026-11-24T081021.html", "2026-11-23T081021.json"]) == "2026-11-23T081021.json"


def test_two_inventories_of_one_name_have_two_folders():
    one, two = map(earlier.folder_name, ("/home/a/my robots", "/home/b/my robots"))
    assert one != two and one.startswith("my_robots-") and two.startswith("my_robots-")
    assert earlier.folder_name("").startswith("fleet-") and earlier.folder_name("/..").startswith("fleet-")


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "[" * 100_000, '{"a": ' * 100_000])
def test_what_is_no_data_of_a_run_is_empty(text):
    assert earlier.data_of(text) == {}


def test_the_data_of_a_run_is_plain_and_says_when_it_was():
    now = reported(fleets.plan()).document
    before = earlier.data_of(json.dumps({**now, "time": "2026-11-24\x1b[2J"}))
    assert earlier.since(before, now) == {"time": "2026-11-24\\x1b[2J", "differences": []}
    assert earlier.since({}, now) == {"time": "", "differences": []}


def test_nothing_is_different_where_nothing_is():
    document = reported(fleets.plan()).document
    assert earlier.differences(document, copy.deepcopy(document)) == []


def test_what_is_new_and_what_is_gone():
    now = reported(fleets.fig12(), fleets.wall).document
    before = reported(fleets.fig12()).document
    before["computers"].remove("tibi-nav")
    before["robots"][0]["topics"].append("/scan")
    told = earlier.differences(before, now)
    assert told[:2] == ["tibi-nav is new", "topics of tibi: /scan is gone"]
    assert told[2].startswith("new: a packet filter on tibi-visio")
    assert earlier.differences(before=now, now=before)[-1].startswith("no longer: a packet filter on tibi-visio")


def test_a_document_of_another_shape_has_no_difference():
    now = reported(fleets.plan()).document
    for before in ({}, {"computers": 3}, [], {"computers": [], "robots": [3], "findings": []}):
        assert earlier.differences(before, now) == []
