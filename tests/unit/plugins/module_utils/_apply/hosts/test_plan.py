# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan of /etc/hosts: the report's figures, a file with a history, conflicts, and any bytes at all."""

import pathlib
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import bindings as hosts_entries
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import plan as hosts_module
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from hypothesis import assume, example, given
from hypothesis import strategies as st

FIXTURES = pathlib.Path(__file__).parents[4] / "fixtures" / "hosts"
KOBUKI = [("192.168.1.229", "kobuki1computer"), ("192.168.1.239", "kobuki2computer")]
FIG12 = [
    ("192.168.11.202", "tibi-monitor"),
    ("192.168.11.100", "tibi-nav"),
    ("192.168.11.101", "tibi-visio"),
    ("192.168.10.100", "dabo-nav"),
    ("192.168.10.101", "dabo-visio"),
    ("192.168.10.202", "dabo-monitor"),
    ("192.168.12.100", "car-nav"),
    ("192.168.12.101", "car-visio"),
    ("192.168.12.102", "car-ext"),
    ("192.168.12.103", "car-display"),
    ("192.168.12.104", "car-control"),
    ("192.168.12.202", "car-monitor"),
]


def bindings(*pairs):
    return hosts_entries.bindings_of([{"address": address, "names": names.split()} for address, names in pairs])


def states(plan):
    return [(entry["state"], entry["ours"]) for entry in plan.entries]


@pytest.mark.parametrize(
    ("case", "pairs", "expected"),
    [
        ("fig6", KOBUKI, ("added", True)),
        ("fig6_by_hand", KOBUKI, ("unchanged", False)),
        ("fig12", FIG12, ("added", True)),
        ("fig12_by_hand", FIG12, ("unchanged", False)),
        ("history", KOBUKI, ("changed", True)),
    ],
)
def test_golden_files(case, pairs, expected):
    before, after = ((FIXTURES / f"{case}.{when}").read_bytes() for when in ("before", "after"))
    plan = hosts_module.plan(before, bindings(*pairs))
    assert plan.content == after
    assert set(states(plan)) == {expected}
    assert plan.conflicts == []
    for entry in plan.entries:
        line = after.split(b"\n")[entry["line"] - 1].decode("latin-1")
        assert line.split()[:2] == [entry["address"], entry["names"][0]]

    again = hosts_module.plan(after, bindings(*pairs))
    assert again.content == after
    assert {state for state, ours in states(again)} == {"unchanged"}
    assert {item["state"] for item in again.replaced} == {"unchanged"}


@pytest.mark.parametrize("case", ["fig6", "fig6_by_hand", "fig12", "fig12_by_hand"])
def test_taking_back_restores_the_figures(case):
    after = (FIXTURES / f"{case}.after").read_bytes()
    plan = hosts_module.plan(after, [])
    assert plan.content == (FIXTURES / f"{case}.before").read_bytes()
    assert [item["state"] for item in plan.replaced] == ["restored"]


def test_history_is_reported():
    plan = hosts_module.plan((FIXTURES / "history.before").read_bytes(), bindings(*KOBUKI))
    assert plan.removed == [{"line": 8, "text": "10.0.0.1 gone # rosfleet.multimaster"}]
    assert [(item["line"], item["after"], item["state"]) for item in plan.replaced] == [
        (4, "127.0.0.1 localhost", "replaced"),
        (5, "127.0.1.1 kobuki2computer.example printer", "replaced"),
        (6, "::1 localhost", "replaced"),
    ]
    assert plan.replaced[1]["before"] == "127.0.1.1 kobuki2computer.example kobuki2computer printer"


def test_a_right_line_of_the_user_is_kept_and_ours_goes():
    wanted = bindings(("192.168.1.229", "kobuki1computer k1"))
    ours = b"192.168.1.229\tkobuki1computer k1 # rosfleet.multimaster\n"
    assert hosts_module.plan(b"192.168.1.229 K1 Kobuki1Computer other # mine\n", wanted).entries[0]["ours"] is False
    plan = hosts_module.plan(ours + b"192.168.1.229 k1 kobuki1computer\n", wanted)
    assert plan.content == b"192.168.1.229 k1 kobuki1computer\n"
    assert plan.removed == [{"line": 1, "text": ours.decode().rstrip()}]
    assert (
        hosts_module.plan(b"192.168.1.229 kobuki1computer\n", wanted).content
        == b"192.168.1.229 kobuki1computer\n" + ours
    )


def test_a_line_without_its_mark_is_the_users():
    unmarked = b"192.168.1.229\tkobuki1computer\n"
    assert hosts_module.plan(unmarked, []).content == unmarked
    conflict = hosts_module.plan(unmarked, bindings(("192.168.1.230", "kobuki1computer"))).conflicts[0]
    assert (conflict["line"], conflict["found"], conflict["effect"]) == (1, "192.168.1.229", "shadows")


def test_conflicts_name_line_and_effect_of_one_family():
    content = (
        b"192.168.1.99 elsewhere Kobuki1computer\n"
        b"fd00::1 kobuki1computer\n"
        b"192.168.1.229 kobuki1computer\n"
        b"::ffff:192.168.1.98 kobuki1computer\n"
        b"# 192.168.1.97 kobuki1computer\n"
    )
    plan = hosts_module.plan(content, bindings(("192.168.1.229", "kobuki1computer")))
    assert plan.content == content
    assert [(item["line"], item["name"], item["found"], item["effect"]) for item in plan.conflicts] == [
        (1, "Kobuki1computer", "192.168.1.99", "shadows"),
        (4, "kobuki1computer", "192.168.1.98", "adds"),
    ]
    both = bindings(("192.168.1.229", "kobuki1computer"), ("fd00::1", "kobuki1computer"))
    assert states(hosts_module.plan(b"", both)) == [("added", True), ("added", True)]


def test_changed_address_and_alias_stay_in_their_line():
    first = hosts_module.plan(b"127.0.0.1 localhost\n", bindings(*KOBUKI)).content
    plan = hosts_module.plan(first, bindings(("192.168.1.230", "kobuki1computer k1"), KOBUKI[1]))
    assert states(plan) == [("changed", True), ("unchanged", True)]
    assert plan.content == first.replace(b".229\tkobuki1computer", b".230\tkobuki1computer k1")


BLOCK = "%s\n10.0.0.7 nas\n10.0.0.8 printer\n%s"
MARKS = [
    ("# BEGIN ANSIBLE MANAGED BLOCK", "# END ANSIBLE MANAGED BLOCK"),
    ("## vagrant-hostmanager-start", "## vagrant-hostmanager-end"),
    ("# Added by Docker Desktop", "# End of section"),
    ("# >>> lab", "#"),
    ("10.0.0.6 first # lab", "10.0.0.9 last # lab"),
]
SURROUNDINGS = {
    "at the end": "127.0.0.1 localhost\n127.0.1.1 kobuki2computer\n%s\n",
    "at the end without a newline": "127.0.0.1 localhost\n%s",
    "below a heading": "# The hosts of this place\n127.0.0.1 localhost\n\n%s\n::1 ip6-localhost\n",
    "at the beginning": "%s\n::1 ip6-localhost\n",
    "all of it": "%s",
    "all of it with a newline": "%s\n",
    "with Windows' line ends": "127.0.0.1 localhost\r\n%s\r\n",
    "in the middle": "127.0.0.1 localhost\n%s\n10.1.0.1 other\n",
    "twice": "127.0.0.1 localhost\n%s\n10.1.0.1 other\n%s\n",
    "with lines of ours in it": "# BEGIN\n10.0.0.7 nas\n192.168.1.229\tkobuki1computer # rosfleet.multimaster\n%s\n# END\n",
}


@pytest.mark.parametrize("marks", MARKS)
@pytest.mark.parametrize("around", SURROUNDINGS)
def test_lines_never_come_between_two_comments(marks, around):
    form = SURROUNDINGS[around]
    before = (form % ((BLOCK % marks,) * form.count("%s"))).encode()
    after = hosts_module.plan(before, bindings(*KOBUKI)).content
    added = [line for line in after.split(b"\n") if b"# rosfleet" in line and line not in before]
    assert added
    for line in added:
        above, below = after.split(line)
        assert not (b"#" in _without_ours(above) and b"#" in _without_ours(below))
    assert hosts_module.plan(after, bindings(*KOBUKI)).content == after
    owned = b"192.168.1.229\tkobuki1computer # rosfleet.multimaster\n"
    assert hosts_module.plan(after, []).content == before.replace(owned, b"")


def _without_ours(text):
    return b"\n".join(line for line in text.split(b"\n") if b"# rosfleet" not in line)


def test_a_file_that_did_not_exist_goes_unless_others_use_it():
    made = hosts_module.plan(None, bindings(*KOBUKI)).content
    assert made.startswith(b"# rosfleet.multimaster created this file\n192.168.1.229\t")
    assert hosts_module.plan(made, bindings(*KOBUKI)).content == made
    assert hosts_module.plan(made, []).content is None
    assert hosts_module.plan(None, []).content is None
    assert hosts_module.plan(made + b"10.0.0.1 x\n", []).content == b"10.0.0.1 x\n"
    assert hosts_module.plan(b"", []).content == b""


def test_line_ends_are_those_of_the_file():
    content = b"127.0.0.1 localhost\r\n127.0.1.1 kobuki1computer\r\n"
    plan = hosts_module.plan(content, bindings(*KOBUKI))
    assert plan.content.count(b"\r\n") == plan.content.count(b"\n") == 4
    assert hosts_module.plan(plan.content, bindings(*KOBUKI)).content == plan.content
    assert hosts_module.plan(plan.content, []).content == content


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([("192.168.1.300", "a")], r"entries\[0\]: the address is '192.168.1.300', expected an IPv4 or IPv6"),
        ([("192.168.001.1", "a")], "the address is '192.168.001.1'"),
        ([("192.168.1.1/24", "a")], "the address is"),
        ([("fe80::1%eth0", "a")], "the address is"),
        ([("", "a")], "the address is ''"),
        ([("127.0.1.1", "a")], "is loopback, expected"),
        ([("::ffff:127.0.0.1", "a")], "is loopback, expected"),
        ([("::1", "a")], "is loopback, expected"),
        ([("224.0.0.1", "a")], "is multicast, expected"),
        ([("ff02::1", "a")], "is multicast, expected"),
        ([("0.0.0.0", "a")], "is unspecified, expected"),
        ([("192.168.1.1", "")], "names is empty"),
        ([("192.168.1.1", "localhost")], "belongs to every machine"),
        ([("192.168.1.1", "LOCALHOST.localdomain")], "belongs to every machine"),
        ([("192.168.1.1", "x.localhost")], "belongs to every machine"),
        ([("192.168.1.1", "ip6-allnodes")], "belongs to every machine"),
        ([("192.168.1.1", "a_-")], "is no host name"),
        ([("192.168.1.1", "-a")], "is no host name"),
        ([("192.168.1.1", "a-")], "is no host name"),
        ([("192.168.1.1", "a..b")], "is no host name"),
        ([("192.168.1.1", "a.")], "is no host name"),
        ([("192.168.1.1", "a" * 64)], "is no host name"),
        ([("192.168.1.1", ".".join(["a" * 60] * 5))], "is no host name"),
        ([("192.168.1.1", "caf\u00e9")], "is no host name"),
        ([("192.168.1.1", "a#b")], "is no host name"),
        ([("192.168.1.1", "10")], "is read as an address"),
        ([("192.168.1.1", "0x7f")], "is read as an address"),
        ([("192.168.1.1", "1.2.3.4")], "is read as an address"),
        ([("192.168.1.1", "robot.7")], "is read as an address"),
        ([("192.168.1.1", "a b A")], "'A' is given twice"),
        (
            [("192.168.1.1", "a"), ("192.168.1.1", "b")],
            r"entries\[0\] and entries\[1\] both have the address 192.168.1.1",
        ),
        ([("fd00::1", "a"), ("fd00:0::1", "b")], "both have the address fd00::1"),
        (
            [("192.168.1.1", "a"), ("192.168.1.2", "b A")],
            r"entries\[1\] gives the name a the address 192.168.1.2, but entries\[0\] gives it 192.168.1.1",
        ),
    ],
)
def test_wrong_entries_are_one_sentence(pairs, message):
    with pytest.raises(Problem, match=message) as problem:
        bindings(*pairs)
    assert len(str(problem.value).splitlines()) == 1


def test_a_name_with_a_newline_does_not_reach_the_file():
    with pytest.raises(Problem, match="is no host name"):
        hosts_entries.bindings_of([{"address": "192.168.1.1", "names": ["a\n127.0.0.1 b"]}])
    with pytest.raises(Problem, match="is no host name"):
        hosts_entries.bindings_of([{"address": "192.168.1.1", "names": ["a\n"]}])


NAMES = ["alpha", "beta", "gamma", "localhost"]
ADDRESSES = ["192.168.1.1", "192.168.1.2", "10.0.0.9", "fd00::1", "fd00::2"]
MARKS = ["# rosfleet.multimaster", "# rosfleet.multimaster replaced: ", "# rosfleet.multimaster created this file"]
WORDS = [
    *NAMES,
    *ADDRESSES,
    "127.0.0.1",
    "127.0.1.1",
    "::1",
    "ALPHA",
    "#",
    "# note",
    "\t",
    " ",
    "\r",
    "\n",
    "\0",
    "\xe9",
]


def content_of(words):
    return st.one_of(
        st.binary(max_size=80),
        st.lists(st.one_of(st.sampled_from(words), st.just(" "), st.just("\n")), max_size=40).map(
            lambda parts: "".join(parts).encode("latin-1")
        ),
    )


ENTRIES = st.dictionaries(
    st.sampled_from(ADDRESSES), st.lists(st.sampled_from(NAMES[:3]), min_size=1, max_size=2, unique=True)
)


def valid(entries):
    try:
        return hosts_entries.bindings_of([{"address": key, "names": names} for key, names in entries.items()])
    except Problem:
        assume(False)


def lines_of_user(content):
    return [line for line in content.split(b"\n") if b"rosfleet.multimaster" not in line]


@given(content=content_of(WORDS), entries=ENTRIES, later=ENTRIES)
@example(content=b"127.0.1.1 alpha", entries={"192.168.1.1": ["alpha"]}, later={})
@example(content=b"\r\n127.0.1.1 alpha beta", entries={"192.168.1.1": ["alpha"]}, later={"fd00::1": ["beta"]})
def test_any_file_comes_back_and_foreign_lines_stay(content, entries, later):
    assume(b"rosfleet.multimaster" not in content)
    first, second = valid(entries), valid(later)
    applied = hosts_module.plan(content, first).content
    assert hosts_module.plan(applied, first).content == applied
    assert hosts_module.plan(applied, []).content == content
    changed = hosts_module.plan(applied, second).content
    assert hosts_module.plan(changed, second).content == changed
    assert hosts_module.plan(changed, []).content == content
    rest = iter(content.split(b"\n"))
    assert all(line in rest for line in lines_of_user(applied))


@given(content=content_of(WORDS + MARKS), entries=ENTRIES)
@example(content=b"# rosfleet.multimaster created this file", entries={})
@example(content=b"# rosfleet.multimaster replaced: 10.0.0.9 alpha # rosfleet.multimaster\n", entries={})
def test_any_file_with_marks_settles_and_names_get_their_address(content, entries):
    wanted = valid(entries)
    plan = hosts_module.plan(content, wanted)
    assert hosts_module.plan(plan.content, wanted).content == plan.content
    taken_back = hosts_module.plan(plan.content, []).content
    assert hosts_module.plan(taken_back, []).content == taken_back
    hosts = [host for host in map(hosts_entries.parse, (plan.content or b"").split(b"\n")) if host]
    for binding in wanted:
        assert any(host.address == binding.address and set(binding.keys) <= set(host.keys) for host in hosts)
        for version, name in binding.keys:
            answers = {host.address for host in hosts if (version, name) in host.keys}
            conflicts = {item["found"] for item in plan.conflicts if item["name"].lower() == name}
            assert {str(answer) for answer in answers} - conflicts == {str(binding.address)}


@pytest.mark.slow
def test_the_time_grows_with_lines_plus_entries():
    """Their product took 24 s at this size; the limit is that of a slow machine."""
    lines = b"".join(b"10.200.%d.%d host%d alias%d\n" % (n // 250 % 250, n % 250, n, n) for n in range(50_000))
    pairs = [(f"10.1.{n // 250}.{n % 250 + 1}", f"robot{n}") for n in range(1000)]
    begun = time.process_time()
    first = hosts_module.plan(lines, bindings(*pairs))
    assert not any(item["state"] != "unchanged" for item in hosts_module.plan(first.content, bindings(*pairs)).entries)
    assert time.process_time() - begun < 8


def test_long_lines_and_nested_marks_cost_their_length():
    begun = time.process_time()
    for content in (
        b"x" * 3_000_000 + b" # rosfleet.multimaster no mark\n",
        b"1.1.1.1 x " + b"# rosfleet.multimaster replaced: " * 100_000 + b"\n",
    ):
        hosts_module.plan(content, bindings(("10.1.1.1", "robot")))
    assert time.process_time() - begun < 4
