# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The one table of faults: ids are unique and keep their meaning, every row is whole, the pages are those of the table."""

import pathlib
import re
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import (
    ALWAYS,
    CONTROLLER,
    HANDS,
    INVENTORY,
    Advice,
    read_advices,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import list_advices as to_data
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.foreseen import PREDICTED, WATCHED
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.kinds import KINDS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.table import AREAS, FAULTS, TABLE

ROOT = pathlib.Path(__file__).resolve().parents[5]
RELEASED = pathlib.Path(__file__).with_name("released.txt")
#: Commands that show something and change nothing: they belong into `look`.
SHOWING = re.compile(
    r"(df|du|ss|top|journalctl(?! --vacuum)|dmesg|grep|cat|nft (-a )?list|iptables -S|getent|ping|ip (-|link show|rule;|route;)|systemctl status)\b"
)
WORDS = dict.fromkeys(("found", "expected", "hop", "traffic"), "x")


def test_an_id_is_of_one_row_and_of_an_area():
    ids = [fault.id for fault in TABLE.values()]
    assert len(ids) == len(set(ids)) and all(re.fullmatch(rf"RF-[{''.join(AREAS)}]\d\d", one) for one in ids)


def test_a_released_id_keeps_its_meaning():
    """An id that is not in the table any more stays in the list with the word `retired`, and comes to no other row."""
    lines = [line.split(maxsplit=1) for line in RELEASED.read_text(encoding="utf-8").splitlines() if line[:2] == "RF"]
    released = dict(lines)
    assert len(released) == len(lines)
    now = {fault.id: " ".join(key) for key, fault in TABLE.items()}
    assert {one: now.get(one, "retired") for one in released} == released
    assert set(now) <= set(released), "new ids: add them to released.txt"


@pytest.mark.parametrize("key", TABLE)
def test_a_row_is_whole(key):
    fault = TABLE[key]
    assert fault.do and fault.look and fault.why and key[0] in KINDS
    assert "{" not in fault.sentence.format(place="arm", what="x", **WORDS)
    for advice in (*fault.fill(fault.do, ("arm",), ""), *fault.fill(fault.look, ("arm",), "")):
        assert advice.text and "{place}" not in advice.sentence and "{limit}" not in advice.sentence


@pytest.mark.parametrize("key", TABLE)
def test_nothing_that_only_shows_is_to_be_done(key):
    assert not any(SHOWING.match(one.text) for one in TABLE[key].do)


@pytest.mark.parametrize("key", TABLE)
def test_a_look_is_no_change_of_the_inventory(key):
    assert not any(one.where == INVENTORY for one in TABLE[key].look)


def test_only_verify_concludes():
    assert not {PREDICTED, WATCHED} & {kind for kind, _mode in FAULTS}
    assert all(fault.cost > 0 for fault in FAULTS.values() if fault.read != ALWAYS)


def test_commands_name_the_inventory_and_the_host():
    fault = FAULTS["forwarding", "off"]
    (known,) = fault.fill(fault.do, ("tibi-gate",), "", "hosts.yml")
    (unknown,) = fault.fill(fault.do, ("the common network",), "")
    assert known.where == CONTROLLER and known.text.split()[1:3] == ["-i", "hosts.yml"]
    assert known.text.endswith(" --limit tibi-gate")
    assert "-i INVENTORY" in unknown.text and "--limit" not in unknown.text


@pytest.mark.parametrize("what", ["x; reboot", "$(reboot)", "a b", "-rf"])
def test_a_strange_name_makes_no_command(what):
    fault = FAULTS["service", "down"]
    (told,) = fault.fill(fault.do, ("arm",), what)
    assert told.where == HANDS


def test_an_advice_is_plain_data():
    advices = (Advice("arm", "ip link", "shows it"), Advice("", "look"))
    assert read_advices(to_data(advices)) == advices and read_advices([{}]) == (Advice("", ""),)


def test_the_pages_are_those_of_the_table():
    done = subprocess.run(
        [sys.executable, ROOT / "tools/findings.py", "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
