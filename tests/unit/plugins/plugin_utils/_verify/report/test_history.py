# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The runs before: which files are theirs, which stay, and the difference to the last one."""

import copy
import json
import random
import time

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import history
from reports import make_report

OTHERS = ["notes.txt", ".report-x1", "2026-11-24.json", "2026-11-24T0810.json", "20261124T081021.json", "latest.json"]


def files(draw, runs):
    """The files of some runs, in no order, among those of others."""
    moments = draw.sample(range(1_600_000_000, 1_800_000_000), runs)
    names = [time.strftime(history.NAME, time.gmtime(moment)) for moment in moments]
    beside = [name + end for name in names for end in (".json", ".html")] + OTHERS
    draw.shuffle(beside)
    return sorted(names), beside


@pytest.mark.parametrize("seed", range(30))
def test_the_last_runs_stay_and_files_of_others_too(seed):
    draw = random.Random(seed)
    names, beside = files(draw, draw.randrange(0, 3 * history.KEPT))
    gone = set(history.find_expired(beside))
    kept = names[-history.KEPT :]
    assert gone == {name + end for name in names[: -history.KEPT] for end in (".json", ".html")}
    assert history.list_latest(set(beside) - gone) == [f"{name}.json" for name in reversed(kept)][: history.KEPT]


def test_a_page_without_data_is_no_run_before():
    assert history.list_latest(["2026-11-24T081021.html", "2026-11-23T081021.json"]) == ["2026-11-23T081021.json"]


def test_two_inventories_of_one_name_have_two_folders():
    one, two = map(history.name_folder, ("/home/a/my robots", "/home/b/my robots"))
    assert one != two and one.startswith("my_robots-") and two.startswith("my_robots-")
    assert history.name_folder("").startswith("fleet-") and history.name_folder("/..").startswith("fleet-")


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "[" * 100_000, '{"a": ' * 100_000])
def test_what_is_no_data_of_a_run_is_empty(text):
    assert history.read_data(text, "fleet", ["a"]) == {}


def test_the_data_of_a_run_is_plain():
    now = make_report(fleets.plan()).document
    before = history.read_data(json.dumps({**now, "time": "2026-11-24\x1b[2J"}), "fleet", now["computers"])
    assert before["time"] == "2026-11-24\\x1b[2J" and history.compare(before, now) == []


def test_nothing_is_different_where_nothing_is():
    document = make_report(fleets.plan()).document
    assert history.compare(document, copy.deepcopy(document)) == []


@pytest.mark.slow
def test_what_is_new_and_what_is_gone():
    now = make_report(fleets.fig12(), fleets.wall).document
    before = make_report(fleets.fig12()).document
    before["computers"].remove("tibi-nav")
    before["robots"][0]["computers"].remove("tibi-nav")
    before["robots"][0]["topics"].append("/scan")
    sentences = history.compare(before, now)
    assert sentences[:2] == ["tibi-nav is new", "topics of tibi: /scan is gone"]
    assert sentences[2].startswith("new: a packet filter on tibi-visio")
    assert history.compare(before=now, now=before)[-1].startswith("no longer: a packet filter on tibi-visio")


def test_two_files_of_one_folder_are_two_fleets():
    folder = "/home/a/fleets"
    names = [history.name_folder(folder, sources) for sources in ([f"{folder}/a.yml"], [f"{folder}/b.yml"], [folder])]
    assert len(set(names)) == 3 and names[2] == history.name_folder(folder)
    assert history.name_folder("", ["ana,"]) != history.name_folder("", ["bob,"])


def test_data_without_a_fleet_is_that_of_its_computers():
    """As version 1.0.0 wrote it."""
    text = json.dumps({"computers": ["ana", "bob"]})
    assert history.read_data(text, "fleet", ["bob", "cid"])
    for computers in (["cid"], []):
        assert history.read_data(text, "fleet", computers) == {}
    for strange in (3, [["ana"]], [{"name": "ana"}], [None]):  # the folder of verify_report may have files of others
        assert history.read_data(json.dumps({"computers": strange}), "fleet", {"ana": 1}) == {}


def test_computers_that_a_run_left_out_are_not_gone():
    """With --limit; and what was found there before is not told as mended, nor later as new."""
    whole = {**make_report(fleets.fig12(), fleets.wall).document, "planned": list(fleets.fig12().computers)}
    part = copy.deepcopy(whole)
    part["computers"], part["findings"] = ["tibi-nav"], []
    assert history.compare(whole, part) == history.compare(part, whole) == []
    smaller = copy.deepcopy(whole)
    smaller["computers"].remove("car-ext")
    smaller["planned"].remove("car-ext")
    assert history.compare(whole, smaller) == ["car-ext is gone"]
    assert history.compare(smaller, whole) == ["car-ext is new"]
    assert history.compare(smaller, part) == []


def test_the_time_since_the_last_run_is_counted():
    now = 1_000_000_000.0
    assert history.count_seconds({"time": "2001-09-09 03:36:40 +0200"}, now) == 600
    assert history.count_seconds({"time": "2001-09-09 01:46:41 +0000"}, now) == 0  # the clock was set back
    for text in ("", "yesterday", None, 7, "9999-12-31 23:59:59 -2359"):
        assert history.count_seconds({"time": text}, now) == 0
    assert history.count_seconds({}, now) == 0


def test_a_document_of_another_shape_has_no_difference():
    now = make_report(fleets.plan()).document
    for before in ({}, {"computers": 3}, [], {"computers": [], "robots": [3], "findings": []}):
        assert history.compare(before, now) == []
