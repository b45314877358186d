# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan for kernel settings: writes, record, drop-in and results. Pure."""

import json

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import plan as settings_plan
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl.record import SettingsRecord
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from hypothesis import given
from hypothesis import strategies as st
from mentioned import mentions

DROP_IN = "/etc/sysctl.d/90-rosfleet-multimaster.conf"
FORWARD, BROADCASTS = "net/ipv4/ip_forward", "net/ipv4/icmp_echo_ignore_broadcasts"
ETH0, LO = "net/ipv4/conf/eth0/forwarding", "net/ipv4/conf/lo/forwarding"
REDIRECTS = "net/ipv4/conf/all/accept_redirects"


def listed(**settings):
    return [{"name": "net.ipv4." + name, "value": value} for name, value in settings.items()]


def settings_of(**settings):
    return settings_plan.settings_of(listed(**settings))


def plan(settings, current, owned=None):
    return settings_plan.plan(settings, current, owned or SettingsRecord(), DROP_IN)


def test_what_is_as_wanted_is_not_written_but_recorded():
    settings = settings_of(ip_forward="1")
    done = plan(settings, {FORWARD: "1"})
    assert done.writes == []
    assert settings_plan.drop_in_text(settings) == settings_plan.HEADER + "net.ipv4.ip_forward = 1\n"
    assert done.final.settings[FORWARD].before == "1"


def test_the_first_value_from_before_stays_in_the_record():
    first = plan(settings_of(ip_forward="1"), {FORWARD: "0"})
    second = plan(settings_of(ip_forward="2"), {FORWARD: "1"}, first.final)
    assert second.final.settings[FORWARD].before == "0"
    assert second.interim.settings[FORWARD].set == ["1", "2"]  # either may be there if the run is killed
    assert second.final.settings[FORWARD].set == ["2"]


def test_taking_back_restores_a_value_of_ours():
    record = plan(settings_of(ip_forward="1"), {FORWARD: "0"}).final
    back = plan([], {FORWARD: "1"}, record)
    assert back.writes == [(FORWARD, "0")]
    assert (settings_plan.drop_in_text([]), back.final) == (None, SettingsRecord())
    assert [(item["state"], item["runtime_after"]) for item in back.removals] == [("restored", "0")]


@pytest.mark.parametrize(
    ("found", "state", "after"), [("7", "left", "7"), ("0", "restored", "0"), (None, "missing", None)]
)
def test_taking_back_leaves_a_value_of_somebody_else(found, state, after):
    record = plan(settings_of(ip_forward="1"), {FORWARD: "0"}).final
    back = plan([], {FORWARD: found}, record)
    assert back.writes == []
    assert [(item["state"], item["runtime_after"]) for item in back.removals] == [(state, after)]


def test_the_other_name_of_a_key_is_the_same_setting():
    record = plan(settings_of(ip_forward="1"), {FORWARD: "0"}).final
    settings = settings_of(**{"conf.all.forwarding": "1"})
    other = plan(settings, {"net/ipv4/conf/all/forwarding": "1", FORWARD: "1"}, record)
    assert (other.removals, other.writes) == ([], [])
    assert other.final.settings[FORWARD].before == "0"
    assert settings_plan.drop_in_text(settings).endswith("net.ipv4.conf.all.forwarding = 1\n")


def test_a_key_that_forwarding_changes_is_set_after_it():
    settings = settings_of(**{"conf.eth0.forwarding": "0", "ip_forward": "1"})
    assert [setting.key for setting in settings] == [FORWARD, ETH0]
    done = plan(settings, {FORWARD: "0", ETH0: "0", LO: "0"})
    assert done.writes == [(FORWARD, "1"), (ETH0, "0")]
    assert done.after == {FORWARD: "1", ETH0: "0", LO: "1"}


def test_keys_set_apart_are_named_and_come_back():
    before = {FORWARD: "0", ETH0: "1", LO: "0", REDIRECTS: "0"}
    done = plan(settings_of(ip_forward="1"), before)
    assert done.after == {FORWARD: "1", ETH0: "1", LO: "1", REDIRECTS: "0"}
    assert done.side_effects == []
    back = plan([], done.after, done.final)
    assert back.after == before
    off = plan(settings_of(ip_forward="0"), {FORWARD: "1", ETH0: "0", LO: "1", REDIRECTS: "1"})
    assert [(item["name"], item["before"], item["after"]) for item in off.side_effects] == []
    off = plan(settings_of(ip_forward="0"), {FORWARD: "1", ETH0: "1", LO: "1", REDIRECTS: "0"})
    assert off.side_effects == []
    on = plan(settings_of(ip_forward="1"), {FORWARD: "0", ETH0: "0", LO: "0", REDIRECTS: "1"})
    assert on.side_effects == []  # the rest follows by itself, which is no news
    two = plan(settings_of(ip_forward="2"), {FORWARD: "0", ETH0: "1", LO: "0"})
    assert [(item["name"], item["before"], item["after"]) for item in two.side_effects] == [
        ("net.ipv4.conf.eth0.forwarding", "1", "2")
    ]


def test_a_beside_key_that_somebody_changed_meanwhile_stays():
    done = plan(settings_of(ip_forward="0"), {FORWARD: "1", ETH0: "1", LO: "1", REDIRECTS: "0"})
    meanwhile = {**done.after, ETH0: "1"}
    assert done.after[ETH0] == "0"
    back = plan([], {**meanwhile, LO: "0"}, done.final)
    assert back.after == {FORWARD: "1", ETH0: "1", LO: "1", REDIRECTS: "0"}
    on = plan(settings_of(ip_forward="1"), {FORWARD: "0", ETH0: "0", LO: "0", REDIRECTS: "1"})
    back = plan([], {**on.after, REDIRECTS: "1"}, on.final)
    assert back.after == {FORWARD: "0", ETH0: "0", LO: "0", REDIRECTS: "1"}


def test_the_value_from_before_is_not_our_own_doing():
    first = plan(settings_of(ip_forward="1"), {FORWARD: "0", ETH0: "0"})
    both = settings_of(**{"ip_forward": "1", "conf.eth0.forwarding": "1"})
    second = plan(both, {FORWARD: "1", ETH0: "1"}, first.final)
    assert second.final.settings[ETH0].before == "0"
    assert plan([], second.after, second.final).after == {FORWARD: "0", ETH0: "0"}


def test_two_ways_to_say_one_limit():
    start = {"vm/dirty_bytes": "0", "vm/dirty_ratio": "20"}
    settings = settings_plan.settings_of([{"name": "vm.dirty_bytes", "value": 100000000}])
    done = plan(settings, start)
    assert done.after == {"vm/dirty_bytes": "100000000", "vm/dirty_ratio": "0"}
    assert [(item["name"], item["before"], item["after"]) for item in done.side_effects] == [
        ("vm.dirty_ratio", "20", "0")
    ]
    back = plan([], done.after, done.final)
    assert (back.after, dict(back.goals)) == (start, {"vm/dirty_ratio": "20"})


def test_settings_are_taken_back_in_reverse_order():
    settings = settings_of(ip_unprivileged_port_start="80", ip_local_port_range="600 60000", ip_forward="1")
    start = {FORWARD: "0", "net/ipv4/ip_local_port_range": "1 2", "net/ipv4/ip_unprivileged_port_start": "1"}
    done = plan(settings, start)
    stored = json.loads(json.dumps(done.final.plain(), sort_keys=True))
    assert stored["order"] == [setting.key for setting in settings]
    back = plan([], done.after, record.read(stored))
    assert [write.key.rpartition("/")[2] for write in back.writes] == [
        "ip_forward",
        "ip_local_port_range",
        "ip_unprivileged_port_start",
    ]
    del stored["order"]  # as earlier versions wrote it
    assert plan([], done.after, record.read(stored)).after == start
    assert (
        "order" not in plan(settings_of(ip_forward="1", tcp_a="1"), {FORWARD: "0", "net/ipv4/tcp_a": "0"}).final.plain()
    )


def test_a_default_spares_what_was_set_apart():
    names = [f"net/ipv4/conf/{name}/rp_filter" for name in ("all", "default", "eth0", "eth1")]
    start = dict(zip(names, ("0", "0", "1", "0"), strict=True))
    done = plan(settings_of(**{"conf.default.rp_filter": "1"}), start)
    assert list(done.after.values()) == ["0", "1", "1", "1"]
    assert plan([], done.after, done.final).after == start  # eth0 has the value of the default now, and stays


values = st.fixed_dictionaries({key: st.sampled_from(["0", "1"]) for key in (FORWARD, ETH0, LO, REDIRECTS, BROADCASTS)})
some_settings = st.dictionaries(
    st.sampled_from(["ip_forward", "conf.eth0.forwarding", "icmp_echo_ignore_broadcasts", "conf.all.accept_redirects"]),
    st.sampled_from(["0", "1"]),
)


@given(values, st.lists(some_settings, min_size=1, max_size=4))
def test_any_runs_reach_the_settings_and_can_be_taken_back(before, runs):
    current, record = before, SettingsRecord()
    for wanted in runs:
        settings = settings_of(**wanted)
        done = plan(settings, current, record)
        current, record = done.after, done.final
        assert {setting.key: current[setting.key] for setting in settings} == dict(settings)
        again = plan(settings, current, record)
        assert (again.writes, again.final) == ([], record)
    assert plan([], current, record).after == before


@pytest.mark.parametrize(
    ("items", "said"),
    [
        (listed(**{"conf.*.rp_filter": "1"}), "'net.ipv4.conf.*.rp_filter'"),
        ([{"name": "../../etc/passwd", "value": "1"}], "'../../etc/passwd'"),
        ([{"name": "net/../ipv4/x", "value": "1"}], "'net/../ipv4/x'"),
        ([{"name": "net.ipv4.ip_forward = 1", "value": "1"}], "without patterns"),
        ([{"name": "", "value": "1"}], "''"),
        ([{"name": "ip_forward", "value": "1"}], "'ip_forward'"),
        ([{"name": "net.ipv4.ip_forward", "value": "1\x00"}], "printable"),
        ([{"name": "net.ipv4.ip_forward\x00", "value": "1"}], "one key"),
        ([{"name": "net.ipv4.\ud800", "value": "1"}], "one key"),
        (listed(ip_forward="1") + [{"name": "-net/ipv4/ip_forward", "value": "0"}], "-net/ipv4/ip_forward = 0"),
        (listed(**{"ip_forward": "1", "conf.all.forwarding": "0"}), "one key kernel"),
    ],
)
def test_settings_that_cannot_be_meant(items, said):
    with pytest.raises(Problem, match="settings: ") as problem:
        settings_plan.settings_of(items)
    assert mentions(str(problem.value), *said.split())


def test_one_key_in_many_spellings_is_one_setting():
    names = ["net/ipv4/tcp_rmem", "-net.ipv4.tcp_rmem", "net.ipv4.tcp_rmem"]
    found = settings_plan.settings_of([{"name": name, "value": "4096 \t 8192  16384"} for name in names])
    assert found == [("net/ipv4/tcp_rmem", "4096 8192 16384")]


@given(st.text(alphabet="1\n\r=#; \x0b\u2028", max_size=8))
def test_a_value_never_adds_a_line_to_the_drop_in(value):
    try:
        text = settings_plan.drop_in_text(settings_plan.settings_of([{"name": "net.ipv4.x", "value": value}]))
    except Problem:
        return
    assert len(text.splitlines()) == 2


@pytest.mark.parametrize(
    "path",
    [
        "/etc/sysctl.conf",
        "/run/sysctl.d/90-a.conf",
        "/etc/sysctl.d/90-a",
        "/etc/sysctl.d/.conf",
        "/etc/sysctl.d/a\x00b.conf",
    ],
)
def test_a_drop_in_that_nothing_would_read(path):
    with pytest.raises(Problem, match="drop_in: found " + path):
        settings_plan.check_drop_in(path)
