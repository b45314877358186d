# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Drawn faults: the same for one seed, of every kind, in commands that a shell reads, and graded by where they were made."""

import dataclasses
import re
import subprocess
from itertools import islice

import fuzz
import grammar
import harm
import pytest
from catalogue import Fault
from judge import Named
from setups import people_nodes

FACTS = {"group": "226.0.0.0"} | {
    f"{name}{suffix}": f"192.0.2.{number}"
    for number, (name, suffix) in enumerate((name, suffix) for name in grammar.COMPUTERS for suffix in ("", ".common"))
}


def draw(seed, number):
    return list(islice(grammar.draw_faults(seed, FACTS), number))


def test_a_seed_draws_the_same_faults_again():
    assert draw(7, 50) == draw(7, 50)
    assert draw(7, 50) != draw(8, 50)


def test_every_kind_is_drawn_on_a_computer_that_can_have_it():
    faults = draw(1, 600)
    assert {fault.name.partition("-")[0] for fault in faults} == set(grammar.KINDS)
    assert all(fault.at[0] in grammar.KINDS[fault.name.partition("-")[0]].hosts for fault in faults)
    assert all(step.where == fault.at[0] for fault in faults for step in (*fault.inject, *fault.undo))


def test_persons_start_nodes_in_each_way():
    titles = {fault.title for fault in draw(3, 1500) if fault.name.startswith("person")}
    for starter in people_nodes.STARTERS:
        assert any(f"a {starter} has started" in title for title in titles)
    for words in ("loopback", "docker0", "another robot's computer", "roscore of another robot", "stopped", "killed"):
        assert any(words in title for title in titles), words
    bridged = [title for title in titles if "network of its own" in title]
    assert len({title.partition(": ")[2] for title in bridged}) == 3, bridged
    assert all("a container has started" in title for title in bridged), bridged


def test_two_faults_at_once_are_on_two_computers_and_one_is_a_persons():
    pairs = list(islice(grammar.draw_pairs(4, FACTS), 60))
    assert pairs == list(islice(grammar.draw_pairs(4, FACTS), 60))
    for one, other in pairs:
        assert not set(one.at) & set(other.at) and "person" in one.name + other.name
        joined = grammar.join_faults((one, other))
        assert joined.inject == one.inject + other.inject and joined.undo == other.undo + one.undo


@pytest.mark.parametrize(
    ("first", "grade"),
    [
        ((("filter", "forward", "tibi-gate"), ("node", "loopback", "kobuki-pc")), fuzz.PART),
        ((("filter", "forward", "tibi-gate"), ("route", "missing", "dabo-arm")), fuzz.OTHER),
        ((), fuzz.NOTHING),
    ],
)
def test_of_two_faults_both_are_to_be_named(first, grade):
    person = dataclasses.replace(FAULT, name="person-1-1", parts=(("node", ""),), at=("kobuki-pc",))
    assert fuzz.grade_pair((FAULT, person), Named(findings=len(first), first=first)) == grade


def test_commands_are_whole_and_a_shell_reads_them():
    commands = sorted({step.what for fault in draw(2, 400) for step in (*fault.inject, *fault.undo)})
    left = {name for command in commands for name in re.findall(r"<([a-z-]+(?:\.common)?)>", command)}
    assert not left & {*FACTS, "port"}  # a launch file has tags, too
    script = "\n".join(f"case_{number}() {{ {command}\n}}" for number, command in enumerate(commands))
    done = subprocess.run(["bash", "-n"], input=script, capture_output=True, text=True, check=False)
    assert not done.stderr


def test_the_lab_s_own_look_is_python_that_a_shell_hands_over():
    done = subprocess.run(["bash", "-c", f"printf %s '{harm.LOOK_WORDS}'"], capture_output=True, text=True, check=True)
    assert done.stdout == harm.LOOK
    compile(harm.LOOK, "look", "exec")


FAULT = Fault("filter-1-1", "x", (), (), (), (("filter", ""),), ("tibi-gate",), False)


@pytest.mark.parametrize(
    ("found", "grade"),
    [
        (Named(), fuzz.NOTHING),
        (Named(("filter", "forward"), "tibi-gate", "", (), 1), fuzz.PART),
        (Named(("way", "between"), "kobuki-pc and tibi-gate", "", (), 1), fuzz.PART),
        (Named(("route", "circle"), "tibi-gate", "", (), 1), fuzz.COMPUTER),
        (Named(("filter", "forward"), "dabo-gate", "", (), 1), fuzz.OTHER),
    ],
)
def test_a_fault_is_graded_by_where_it_was_made(found, grade):
    assert fuzz.grade(FAULT, found) == grade


def test_the_limits_are_shares_of_all_faults():
    def graded(*grades):
        return [fuzz.Graded(FAULT, grade, "", 1.0) for grade in grades]

    assert fuzz.is_good(graded(*[fuzz.PART] * 18, fuzz.COMPUTER, fuzz.COMPUTER))
    assert not fuzz.is_good(graded(*[fuzz.PART] * 18, fuzz.COMPUTER, fuzz.OTHER))
    assert not fuzz.is_good(graded(*[fuzz.PART] * 99, fuzz.NOTHING))
    assert "filter" in fuzz.write_table(graded(fuzz.PART))
