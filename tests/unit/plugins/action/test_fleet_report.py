# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_report: registered results in; what is printed, and which files are where."""

import json
import os
import pathlib
import stat
import tempfile
import types
from xml.etree import ElementTree

import fleets
import pytest
from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain

pytestmark = pytest.mark.whole

TIMES = ("2026-11-21T140200", "2026-11-22T080000", "2026-11-22T090000")


def registered(seen):
    """Return what the tasks of the role would have registered."""
    found = {"verify_probe": to_plain(seen.probe), "multimaster_info": {"os": {"name": "Debian GNU/Linux 12"}}}
    if seen.multicast:
        found["verify_probe"]["multicast"] = to_plain(seen.multicast)
    return found


def judge(change=None, fleet=None, inventory="/home/me/our fleet", source="hosts.yml", **options):
    fleet = fleet or fleets.fig12()
    seen = fleets.observed(fleet)
    if change:
        change(seen)
    task = Task()
    task.action, task.async_val, task.check_mode = "rosfleet.multimaster.fleet_report", 0, False
    task.args = {
        "fleet": to_plain(fleet),
        "multicast": "verify_probe.multicast",
        "probe": "verify_probe",
        "machine": "multimaster_info",
        **options,
    }
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    module = fleet_report.ActionModule(task, connection, None, None, None, None)
    hostvars = {name: registered(entry) for name, entry in seen.items()}
    return act(
        module,
        {
            "hostvars": hostvars,
            "ansible_play_hosts_all": list(seen),
            "inventory_dir": inventory,
            "ansible_inventory_sources": [source],
        },
    )


@pytest.fixture(autouse=True)
def shown(monkeypatch):
    lines = []
    monkeypatch.setattr(
        fleet_report.Display, "display", lambda self, text, color=None, **_more: lines.append((text, color))
    )
    return lines


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setattr(
        fleet_report.constants.config,
        "get_config_value",
        lambda name: {"ANSIBLE_HOME": str(tmp_path / "ansible")}[name],
    )
    return tmp_path / "ansible/rosfleet/reports"


@pytest.fixture
def clock(monkeypatch):
    """The time of the next run."""
    times = {"now": TIMES[0]}
    monkeypatch.setattr(fleet_report.time, "strftime", lambda _format: times["now"])
    return lambda value: times.update(now=value)


def test_all_is_well_is_told_in_few_lines(shown):
    result = judge()
    assert result["passed"] and result["report"] == "" and result["findings"] == []
    lines = [text for text, _color in shown if text]
    assert lines[0] == "VERIFICATION of 10 computers" and len(lines) == 2
    assert (lines[1], "green") in shown and lines[1].startswith("PASSED: none of ")


def test_failures_are_coloured_and_fit_the_terminal(shown, monkeypatch):
    monkeypatch.setenv("COLUMNS", "90")
    result = judge(fleets.wall)
    lines = [text for text, _color in shown]
    assert not result["passed"] and ("Findings:", "red") in shown and max(map(len, lines)) <= 90
    assert any("a packet filter on tibi-visio drops" in line for line in lines) and "from / to" not in "".join(lines)


def test_a_finding_is_explained_in_ten_lines(shown):
    judge(fleets.wall, explain="1")
    text = shown[-1][0]
    assert text.strip().startswith("Finding 1, RF-301: ") and len(text.strip().splitlines()) <= 10
    refused = judge(fleets.wall, explain="7")
    assert refused["failed"] and "expected a number from 1 to 1" in refused["msg"]


def test_commands_have_the_inventory_of_the_run(shown):
    (finding,) = judge(fleets.lost_route)["findings"]
    assert "-i hosts.yml rosfleet.multimaster.site --limit tibi-nav" in finding["do"][0]["text"]


class Placed(str):
    """A value of the inventory, as ansible-core before 2.19 has it."""

    ansible_pos = ("/fleet/group_vars/tibi.yml", 12, 3)


def test_a_change_of_the_inventory_names_the_file_and_the_line(monkeypatch):
    monkeypatch.chdir("/")
    assert fleet_report.find_origin(Placed("networks")) == "fleet/group_vars/tibi.yml, line 12"
    assert fleet_report.find_origin("networks") == fleet_report.find_origin(None) == ""
    if fleet_report.Origin:
        value = fleet_report.Origin(path="/fleet/hosts.yml", line_num=3).tag("networks")
        assert fleet_report.find_origin(value) == "fleet/hosts.yml, line 3"


def test_where_a_variable_is_set_is_found_by_host_or_robot():
    class HostVars(dict):
        def raw_get(self, name):
            return self[name]

    found = HostVars({"tibi-nav": {"multimaster_routes": Placed("networks")}})
    inventory = fleet_report.describe_inventory({"hostvars": found, "groups": {"tibi": ["tibi-nav"]}})
    assert inventory.path == ""
    for place in ("tibi-nav", "tibi"):
        assert inventory.find_line(place, "multimaster_routes").endswith("group_vars/tibi.yml, line 12")
    assert inventory.find_line("dabo", "multimaster_routes") == inventory.find_line("tibi", "multimaster_x") == ""


def test_more_is_told_with_v(shown, monkeypatch):
    monkeypatch.setattr(fleet_report.Display(), "verbosity", 1)
    judge()
    assert any("from / to" in text for text, _color in shown)


def test_the_folder_of_the_user(home, shown):
    result = judge(fleets.wall, path="auto")
    page = pathlib.Path(result["report"])
    assert page.parent.parent == home and page.parent.name.startswith("our_fleet-")
    data = page.with_suffix(".json")
    assert {stat.S_IMODE(path.stat().st_mode) for path in (page, data)} == {0o600}
    assert stat.S_IMODE(page.parent.stat().st_mode) == 0o700 and sorted(page.parent.iterdir()) == [page, data]
    document = json.loads(data.read_text())
    assert document["findings"][0]["place"] == "tibi-visio" and document["machines"]["tibi-nav"]["system"]
    assert [text for text, _color in shown if text][-1] == f"Report: {page}\n"
    assert "a packet filter on tibi-visio drops" in page.read_text()


def test_the_difference_to_the_run_before(home, clock):
    judge(path="auto")
    clock(TIMES[1])
    document = json.loads(pathlib.Path(judge(fleets.wall, path="auto")["report"]).with_suffix(".json").read_text())
    assert document["since"] == TIMES[0] and document["differences"][0].startswith("new: a packet filter on tibi-visio")


def test_only_runs_of_one_fleet_are_compared(tmp_path, clock):
    since = []
    for number, inventory in enumerate(("/a", "/b", "/a"), 1):
        clock(f"2026-11-22T08000{number}")
        page = judge(path=str(tmp_path), inventory=inventory)["report"]
        since.append(json.loads(pathlib.Path(page).with_suffix(".json").read_text())["since"])
    assert since == ["", "", "2026-11-22T080001"]


def test_two_inventories_in_one_folder_have_two_histories(home, clock):
    folders, differences = set(), []
    for number, source in enumerate(("ana.yml", "bob.yml"), 1):
        clock(f"2026-11-22T08000{number}")
        fleet = fleets.fig12() if number == 1 else fleets.plan()
        page = pathlib.Path(judge(fleet=fleet, path="auto", source=source)["report"])
        folders.add(page.parent)
        differences += json.loads(page.with_suffix(".json").read_text())["differences"]
    assert len(folders) == 2 and differences == []


def test_a_run_with_a_limit_tells_nobody_as_gone(tmp_path):
    path = tmp_path / "r.json"
    judge(path=str(path))

    def limit(seen):
        for name in [name for name in seen if not name.startswith("tibi")]:
            del seen[name]

    judge(limit, path=str(path))
    assert json.loads(path.read_text())["differences"] == []


def test_a_damaged_run_before_costs_the_difference_alone(home, clock):
    page = pathlib.Path(judge(path="auto")["report"])
    for number, damage in enumerate(("{", "[3]", '{"computers": 3}', "[" * 100_000), 1):
        page.with_suffix(".json").write_text(damage)
        clock(f"2026-11-22T08000{number}")
        page = pathlib.Path(judge(path="auto")["report"])
        assert json.loads(page.with_suffix(".json").read_text())["differences"] == []


@pytest.mark.slow
def test_the_last_twenty_runs_are_kept_and_what_is_of_others(home, clock):
    first = pathlib.Path(judge(path="auto")["report"])
    (first.parent / "notes.txt").write_text("mine")
    for number in range(1, 25):
        clock(f"2026-11-22T0800{number:02}")
        judge(path="auto")
    names = sorted(path.name for path in first.parent.iterdir())
    assert len(names) == 41 and "notes.txt" in names and names[0] == "2026-11-22T080005.html"


def test_a_folder_that_cannot_be_made_is_told_in_passing(home, shown):
    home.parent.parent.mkdir()
    home.parent.write_text("")  # a file where the folder is to be
    result = judge(path="auto")
    assert result["passed"] and not result.get("failed") and result["report"] == ""
    assert any("cannot be written to" in text for text, _color in shown)


def test_a_file_of_its_own_name_has_all_results(tmp_path):
    path = tmp_path / "verification.json"
    result = judge(path=str(path))
    assert result["report"] == str(tmp_path / "verification.html")
    assert {row["verdict"] for row in json.loads(path.read_text())["rows"]} == {"ok"}
    judge(fleets.wall, path=str(path))  # it is the run before, too
    assert json.loads(path.read_text())["differences"] and sorted(tmp_path.iterdir()) == [
        tmp_path / "verification.html",
        path,
    ]


@pytest.mark.parametrize("option", ["path", "junit"])
def test_a_file_that_cannot_be_written_is_an_error(tmp_path, shown, option):
    result = judge(fleets.wall, **{option: str(tmp_path / "none" / "x.json")})
    assert result["failed"] and "name another file" in result["msg"]
    assert any("a packet filter on tibi-visio drops" in text for text, _color in shown)  # a long run is not for nothing


def test_a_folder_of_somebody(tmp_path, clock):
    result = judge(path=str(tmp_path))
    assert result["report"] == str(tmp_path / f"{TIMES[0]}.html")


def test_a_large_fleet_keeps_what_is_not_ok(home):
    fleet = fleets.plan(21, 2)
    page = pathlib.Path(judge(fleet=fleet, path="auto", pairs="auto")["report"])
    assert (
        json.loads(page.with_suffix(".json").read_text())["rows"] == [] and "A cell is two robots" in page.read_text()
    )


def test_junit(tmp_path):
    path = tmp_path / "verify.xml"
    result = judge(fleets.wall, junit=str(path))
    assert not result["passed"] and list(tmp_path.iterdir()) == [path]
    assert int(ElementTree.parse(path).getroot()[0].get("failures")) > 0


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "report.json"
    fleet_report.write(str(path), "whole", 0o600)
    with pytest.raises(UnicodeEncodeError):
        fleet_report.write(str(path), "half\ud800", 0o600)
    assert path.read_text() == "whole" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("module", "name"), [(tempfile, "mkstemp"), (os, "chmod"), (os, "replace")])
def test_a_failure_names_the_file_that_was_asked_for(tmp_path, monkeypatch, module, name):
    def full(*_words, **_more):
        raise OSError(28, "No space left on device", "/somewhere/.report-x")

    monkeypatch.setattr(module, name, full)
    with pytest.raises(OSError, match="No space left") as caught:
        fleet_report.write(str(tmp_path / "report.json"), "x", 0o600)
    monkeypatch.undo()
    assert caught.value.filename == str(tmp_path / "report.json") and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("marks", "told"),
    [
        ({"start": "100.5", "measurement": 103}, "start 2.5 s, measurement 7.0 s; together 9.5 s"),
        ({"start": 100.5, "measurement": ""}, "start 9.5 s; together 9.5 s"),
        ({}, ""),
        (None, ""),
    ],
)
def test_durations(marks, told):
    assert fleet_report.format_durations(marks, 110.0) == told


@pytest.mark.parametrize(
    ("rivals", "told"),
    [([], "a link is down"), ([{"sentence": "a switch is off"}], "one of these: a link is down; or a switch is off")],
)
def test_a_finding_told_alone_says_what_it_may_be_instead(rivals, told):
    found = fleet_report.join_rivals({"sentence": "a link is down", "rivals": rivals, "verdict": "failed"})
    assert (found["sentence"], found["verdict"]) == (told, "failed")
