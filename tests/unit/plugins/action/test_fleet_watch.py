# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_watch: what computers told of a watch in, and no line of a hostile one among ours."""

import random
import re
import types

import pytest
from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_watch
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import is_plain

from tests.unit.test_hostile_texts import MARK, hostile, masked

EVENT = {"kind": "link", "name": "eth0", "well": False, "expected": "up", "found": "down", "time": 1e9, "after": 3.0}
WELL = {"watched": 9, "seconds": 30.0, "events": [], "lost": [], "dropped": 0}
LOST = {**WELL, "events": [EVENT], "lost": [{"kind": "link", "name": "eth0"}]}


@pytest.fixture
def watch(monkeypatch):
    """Run the action over what each computer told; its result, and what it displayed."""

    def run(told, sources=(), **options):
        shown = []
        monkeypatch.setattr(fleet_watch.Display, "display", lambda _self, text, *_more, **_options: shown.append(text))
        task = Task()
        task.action, task.async_val, task.check_mode = "rosfleet.multimaster.fleet_watch", 0, False
        task.args = {"watched": "verify_watch_told", "duration": "1m", **options}
        connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
        action = fleet_watch.ActionModule(task, connection, None, None, None, None)
        variables = {host: {"verify_watch_told": part} for host, part in told.items()}
        result = act(
            action,
            {
                "hostvars": variables,
                "ansible_play_hosts_all": list(told),
                "ansible_inventory_sources": list(sources),
            },
        )
        return result, "\n".join(shown)

    return run


def test_nothing_lost_is_a_line(watch):
    result, shown = watch({"tibi": WELL, "dabo": WELL})
    assert (result["lost"], result["first_loss"], result["msg"]) == (0, "", "Nothing was lost in 1:00.")
    assert "18 values on 2 computers" in shown


def test_the_first_loss_has_our_words_and_names_without_quotes(watch):
    result, shown = watch({"tibi": LOST, "dabo": WELL})
    assert "the link eth0 of tibi is down, and was up" in result["first_loss"] and '"' not in result["first_loss"]
    assert (result["lost"], result["known"]) == (1, {"tibi": 1, "dabo": 0}) and "tibi is down" in shown
    assert result["advice"]["id"] == "RF-803" and result["advice"]["look"][0]["where"] == "tibi"


def test_the_advice_names_the_inventory_of_the_run(watch):
    event = {**EVENT, "kind": "clock", "found": "set back"}
    result, _shown = watch({"tibi": {**WELL, "events": [event]}}, sources=["hosts.yml"])
    assert "-i hosts.yml " in result["advice"]["do"][0]["text"]


def test_who_does_not_answer_any_more_is_told(watch):
    gone = {"unreachable": True, "msg": "no route"}
    result, shown = watch({"tibi": gone, "dabo": WELL}, known={"tibi": 1, "dabo": 0})
    assert 'tibi does not answer: "no route"' in shown and result["known"] == {"tibi": 1, "dabo": 0}
    _result, shown = watch({"tibi": LOST, "dabo": WELL}, known=result["known"])
    assert "the link eth0" not in shown  # it was told before


def test_a_planned_name_is_one_also_where_others_tell_it(watch):
    event = {**EVENT, "kind": "master", "name": "dabo", "found": "", "expected": ""}
    result, _shown = watch({"tibi": {**WELL, "events": [event]}, "dabo": WELL})
    assert "tibi hears no heartbeat of dabo" in result["first_loss"]
    other, _shown = watch({"tibi": {**WELL, "events": [{**event, "name": "none"}]}, "dabo": WELL})
    assert 'tibi hears no heartbeat of "none"' in other["first_loss"]


@pytest.mark.parametrize(
    "failed", [{"failed": True, "msg": "?"}, {"unreachable": True, "msg": "?"}, {**WELL, "events": "?"}]
)
def test_who_does_not_tell_is_lost_with_its_reason_in_quotes(watch, failed):
    draw = random.Random(25)
    for _number in range(20):
        told = {key: hostile(draw) if part == "?" else part for key, part in failed.items()}
        result, shown = watch({"tibi": told, "dabo": WELL})
        assert "tibi does not answer: " in result["first_loss"] and result["lost"] == 1
        assert MARK in result["first_loss"]
        assert not [line for line in (result["msg"], *shown.split("\n")) if MARK in masked(line) or not is_plain(line)]


@pytest.mark.parametrize("seed", range(40))
def test_a_hostile_computer_writes_no_line_of_ours(watch, seed):
    """The same lines as with harmless texts, but for what stands in quotes."""

    def told(text):
        places = [key for key in ("kind", "name", "expected", "found") if draw.random() < 0.7] or ["found"]
        evil = {key: text(key) for key in places if key != "kind"} or {"found": text("found")}
        kind = draw.choice(["link", "service", "master", "group", "setting", "computer", "port", "route"])
        return {
            **WELL,
            "events": [{**EVENT, "kind": kind, **evil}] * draw.randint(1, 9),
            "lost": [{"kind": kind, "name": evil.get("name", "x1")}],
        }

    words = random.Random(f"words {seed}")
    results = []
    for text in (lambda _key: "z harmless " * 3, lambda _key: hostile(words)):
        draw = random.Random(seed)
        result, shown = watch({"tibi": told(text), "dabo": WELL})
        results.append([masked(line) for line in (result["msg"], result["first_loss"], *shown.split("\n"))])
        assert all(is_plain(line) for line in shown.split("\n"))
    assert results[0] == results[1]
    assert not [line for line in results[1] if re.search(MARK, line)]
