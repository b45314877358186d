# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Drawn faults: the same for one seed, of every kind, in commands that a shell reads, and graded by where they were made."""

import re
import subprocess
from itertools import islice

import fuzz
import grammar
import harm
import pytest
from catalogue import Fault
from judge import Named

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


def test_commands_are_whole_and_a_shell_reads_them():
    commands = sorted({step.what for fault in draw(2, 400) for step in (*fault.inject, *fault.undo)})
    assert not [command for command in commands if re.search(r"<[a-z-]+(\.common)?>", command)]
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
