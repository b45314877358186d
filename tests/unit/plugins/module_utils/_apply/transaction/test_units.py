# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The planner of systemd units: what systemd says and what is wanted in, ordered steps out."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import units as units_module
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from hypothesis import given
from hypothesis import strategies as st

CORE, DISC, SYNC = "core.service", "disc.service", "sync.service"
INSTALL = "[Install]\nWantedBy=multi-user.target\n"


def unit(name, inputs="new", part_of="", **options):
    content = f"[Unit]\n{part_of}\n[Service]\nEnvironment=ROSFLEET_INPUTS={inputs}\nExecStart=/bin/true\n{INSTALL}"
    return units_module.Unit(name, content, options.get("enabled", True), options.get("started", True))


UNITS = [unit(CORE), unit(DISC, part_of=f"PartOf={CORE}"), unit(SYNC, part_of=f"PartOf={CORE}\nAfter={DISC}")]
NAMES = [CORE, DISC, SYNC]


def state(name, **changed):
    """A unit of ours that runs as planned, but for what is given."""
    known = units_module.UnitState(
        Id=name,
        LoadState="loaded",
        ActiveState="active",
        SubState="running",
        UnitFileState="enabled",
        FragmentPath=f"/etc/systemd/system/{name}",
        NeedDaemonReload="no",
        MainPID="7",
        NRestarts="0",
        InvocationID="1",
        inputs="new",
    )
    return known._replace(**changed)


def absent(name):
    return state(
        name,
        LoadState="not-found",
        ActiveState="inactive",
        SubState="dead",
        UnitFileState="",
        FragmentPath="",
        MainPID="0",
        inputs="",
    )


def plan(states=(), units=None, removed=(), texts=(), pending=(), written=None):
    known = {name: state(name) for name in [*NAMES, *removed]}
    known.update({entry.Id: entry for entry in states})
    return units_module.plan_actions(
        UNITS if units is None else list(units), list(removed), known, texts, pending, written or {}
    )


def actions(steps):
    return [(step.name, step.switch, step.run) for step in steps]


def test_as_planned_there_is_nothing_to_do():
    assert actions(plan()) == [(name, "", "") for name in NAMES]


def test_new_units_are_enabled_and_started_in_order():
    steps = plan([absent(name) for name in NAMES], texts=NAMES)
    assert actions(steps) == [(name, "enable", "start") for name in NAMES]


def test_a_changed_text_restarts_and_replaces_the_links():
    assert actions(plan(texts={SYNC}))[2] == (SYNC, "reenable", "restart")


def test_who_follows_a_restarted_unit_is_not_restarted_by_us():
    steps = plan(texts={CORE})
    assert [step.run for step in steps] == ["restart", "follow", "follow"]
    assert steps[1].why == f"systemd restarts it with {CORE}"


@pytest.mark.parametrize(
    ("changed", "run", "why"),
    [
        ({"inputs": "old"}, "restart", "it ran with the inputs old"),
        ({"inputs": ""}, "restart", "it ran with the inputs of nobody"),
        ({"MainPID": "0", "inputs": ""}, "", ""),  # without a process there is nothing to compare
        ({"ActiveState": "inactive", "MainPID": "0"}, "start", "it was inactive"),
        ({"ActiveState": "failed", "MainPID": "0"}, "start", "it was failed"),
        ({"ActiveState": "deactivating"}, "start", "it was deactivating"),
        ({"ActiveState": "activating", "SubState": "auto-restart"}, "restart", "waiting for another start"),
        ({"ActiveState": "activating", "SubState": "start"}, "start", "it was starting"),
        (
            {"ActiveState": "activating", "SubState": "start", "inputs": "old"},
            "restart",
            "it ran with the inputs old",
        ),
        ({"ActiveState": "reloading"}, "", ""),
    ],
)
def test_what_runs_decides(changed, run, why):
    step = plan([state(SYNC, **changed)])[2]
    assert step.run == run and why in step.why


def test_a_file_written_after_the_start_has_not_been_read():
    written = {SYNC: "/etc/robots/sync.json"}
    assert plan(written=written)[2][2:] == ("restart", "/etc/robots/sync.json was written after its start")
    assert plan([state(SYNC, MainPID="0")], written=written)[2].run == ""


@pytest.mark.parametrize(
    ("line", "files"),
    [
        ("EnvironmentFile=/etc/robots/environment", ["/etc/robots/environment"]),
        ("EnvironmentFile=-/etc/default/one", ["/etc/default/one"]),
        ("ExecStart=/usr/bin/one --config=/etc/b.json /etc/a.json %t/x", ["/etc/a.json", "/etc/b.json"]),
        ("ExecStart=/bin/sh -c 'exec one \"/etc/a\"; true'", ["/etc/a"]),
        ("# EnvironmentFile=/etc/a", []),
        ("ExecStart=/opt/etc/a /usr/etc/b", []),
        ("", []),
    ],
)
def test_the_files_that_a_text_names(line, files):
    assert units_module.files_read(f"[Service]\n{line}\n") == files


def test_an_interrupted_run_is_continued():
    step = plan(pending={SYNC})[2]
    assert step.run == "restart" and "not come to its end" in step.why
    assert step.switch == "reenable"  # systemd may tell of links that are gone, until it reads its files again
    assert plan([state(SYNC, UnitFileState="disabled")], [], [SYNC], pending={SYNC})[0].switch == "disable"
    assert plan([absent(SYNC)], [], [SYNC], pending={SYNC})[0].switch == ""


@pytest.mark.parametrize(
    ("wanted", "found", "switch"),
    [
        (True, "disabled", "enable"),
        (True, "enabled-runtime", "enable"),
        (True, "enabled", ""),
        (False, "enabled", "disable"),
        (False, "enabled-runtime", "disable"),
        (False, "disabled", ""),
        (False, "static", ""),
    ],
)
def test_enabled_or_not(wanted, found, switch):
    assert plan([state(CORE, UnitFileState=found)], [unit(CORE, enabled=wanted)])[0].switch == switch


@pytest.mark.parametrize("active", ["active", "activating", "inactive", "failed"])
def test_a_unit_that_is_to_be_stopped(active):
    step = plan([state(CORE, ActiveState=active)], [unit(CORE, started=False)], texts={CORE})[0]
    assert step.run == ("stop" if active in ("active", "activating") else "")


def test_removed_units_stop_first_and_last_one_first():
    steps = plan(units=[unit(CORE)], removed=[DISC, SYNC])
    assert actions(steps) == [(SYNC, "disable", "stop"), (DISC, "disable", "stop"), (CORE, "", "")]


def test_a_removed_unit_that_is_gone_needs_nothing():
    assert actions(plan([absent(SYNC)], units=[], removed=[SYNC])) == [(SYNC, "", "")]


@given(st.data())
def test_every_planned_unit_runs_with_its_inputs_after_the_steps(data):
    states = [
        state(
            name,
            ActiveState=data.draw(st.sampled_from(["active", "inactive", "failed", "activating"])),
            inputs=data.draw(st.sampled_from(["old", "new", ""])),
        )
        for name in NAMES
    ]
    steps = plan(states, texts=data.draw(st.sets(st.sampled_from(NAMES))))
    assert [step.name for step in steps] == NAMES
    for step, before in zip(steps, states):
        if step.run == "":
            assert before.ActiveState == "active" and before.inputs == "new"
        if step.run == "follow":
            assert "restart" in [earlier.run for earlier in steps]


def test_foreign_and_masked_units_are_sentences():
    owned = {state(CORE).FragmentPath}
    units_module.check([unit(CORE)], {CORE: state(CORE)}, owned)
    units_module.check([unit(CORE)], {CORE: absent(CORE)}, ())
    with pytest.raises(Problem) as caught:
        units_module.check(
            UNITS,
            {
                CORE: state(CORE),
                DISC: state(DISC, FragmentPath="/lib/systemd/system/disc.service"),
                SYNC: state(SYNC, LoadState="masked", FragmentPath=""),
            },
            owned,
        )
    assert "/lib/systemd/system/disc.service" in str(caught.value)
    assert f"systemctl unmask {SYNC}" in str(caught.value)
    assert CORE not in str(caught.value)
    with pytest.raises(Problem, match="without a file"):
        units_module.check([unit(CORE)], {CORE: state(CORE, FragmentPath="")}, owned)


@pytest.mark.parametrize(
    ("text", "inputs"),
    [
        ("Environment=ROSFLEET_INPUTS=abc", "abc"),
        ('[Service]\n  Environment = "ROSFLEET_INPUTS=abc"\n', "abc"),
        ("Environment=A=1 ROSFLEET_INPUTS=abc B=2\n", "abc"),
        ("Environment=ROSFLEET_INPUTS=a\nEnvironment=ROSFLEET_INPUTS=b\n", "b"),
        ("#Environment=ROSFLEET_INPUTS=abc\n", ""),
        ("Environment=MY_ROSFLEET_INPUTS=abc\n", ""),
        ("ExecStart=/bin/echo ROSFLEET_INPUTS=abc\n", ""),
    ],
)
def test_planned_inputs(text, inputs):
    assert units_module.read_inputs(text) == inputs


def test_followed():
    text = "PartOf=a.service b.service\nBindsTo = c.service\nRequires=d.service\nWants=e.service\nAfter=f.service\n"
    assert units_module.restart_partners(text) == {"a.service", "b.service", "c.service", "d.service"}


@pytest.mark.parametrize(
    ("units", "said"),
    [
        ([{"name": "no-suffix"}], "no-suffix"),
        ([{"name": "a/b.service"}], "a/b"),
        ([{"name": "template@.service"}], "template@"),
        ([{"name": "-x.service; rm"}], "not usable"),
        ([{"name": "a.service"}] * 2, "twice"),
        ([{"name": "a.service", "content": "[Service]\nExecStart=/bin/true\n"}], "WantedBy"),
    ],
)
def test_bad_units_are_sentences(units, said):
    full = [dict({"content": INSTALL, "enabled": True, "started": True}, **entry) for entry in units]
    with pytest.raises(Problem, match=said):
        units_module.parse_units(full)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("[Service]\nType=notify\n", True),
        ("[Service]\nType = oneshot \nExecStart=/bin/true", True),
        ("[Service]\nType=notify\nType=simple\n", False),
        ("[Service]\nExecStart=/usr/bin/x --Type=notify\n", False),
        ("[Service]\nType=forking\n", False),
        ("", False),
    ],
)
def test_who_says_when_it_is_up_needs_no_time_to_die(content, says):
    assert units_module.says_when_up(content) is says
