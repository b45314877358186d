# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The one table of faults: ids are unique and keep their meaning, every row is whole, the pages are those of the table."""

import pathlib
import re
import subprocess
import sys

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import (
    ALWAYS,
    CONTROLLER,
    HANDS,
    INVENTORY,
    UNREAD,
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
#: Commands that take away what a person or another program has made.
HARMING = re.compile(
    r"\b(rm|unlink|truncate|shred|killall|pkill|kill -(9|KILL)|reboot|apt-get (remove|purge)|iptables (-t \w+ )?-[FXD]|nft (flush|delete)|"
    r"firewall-cmd --(complete-)?reload|(ufw|firewall-cmd) .*(disable|reset|--panic)|netplan apply|docker (rm|compose down)|rosnode kill)\b"
)
FLUSHING = re.compile(r"\bflush (?!to )")  # without an address
OPTION = re.compile(r"-e (\w+)=(\S+)")
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


@pytest.mark.parametrize("key", TABLE)
def test_no_command_takes_away_what_others_have_made(key):
    fault = TABLE[key]
    commands = [one.text for one in (*fault.do, *fault.look) if one.where not in (HANDS, INVENTORY)]
    assert not [text for text in commands if HARMING.search(text) or FLUSHING.search(text)]


def test_each_command_is_one_for_a_shell(tmp_path):
    known = dict.fromkeys(UNREAD, "x")
    script = tmp_path / "all.sh"
    commands = [
        one.text
        for fault in TABLE.values()
        for one in fault.fill((*fault.do, *fault.look), ("arm",), "x", "hosts.yml", known)
        if one.where not in (HANDS, INVENTORY)
    ]
    script.write_text("".join(re.sub(r"<\w+>", "x", text) + "\n" for text in commands))  # a person fills these gaps
    done = subprocess.run(["sh", "-n", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and len(commands) > 300, done.stderr


def test_an_option_of_a_command_is_one_of_a_role_and_takes_its_value():
    kinds = {"bool": {"true", "false"}, "int": re.compile(r"\d+"), "float": re.compile(r"\d+(\.\d+)?")}
    specs = [yaml.safe_load(path.read_text(encoding="utf-8")) for path in ROOT.glob("roles/*/meta/argument_specs.yml")]
    known = {name: spec for each in specs for name, spec in each["argument_specs"]["main"].get("options", {}).items()}
    given = {
        found for fault in TABLE.values() for one in (*fault.do, *fault.look) for found in OPTION.findall(one.text)
    }
    assert len(given) > 3 and {name for name, _value in given} <= set(known)
    for name, value in given:
        fits = known[name].get("choices") or kinds[known[name]["type"]]
        assert fits.fullmatch(value) if isinstance(fits, re.Pattern) else value in fits, (name, value)


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


def _match(fault, advices):
    """Make the expressions of advices, as a report prints them, with any words for what is filled in."""
    for one in fault.fill(advices, ("PLACE",), "", "INVENTORY"):
        text = one.sentence.replace(" --limit PLACE", " FILLED").replace("PLACE", "FILLED")
        for word in (fault.example, *UNREAD.values()):
            text = text.replace(word.format(place="FILLED"), "FILLED") if word else text
        yield re.escape(text).replace("INVENTORY", "FILLED").replace("FILLED", ".+")


SAMPLE = re.compile(r"\[(RF-\d+)\]\n((?: {4,}\S.*\n)+)")
LINES = re.compile(r"^ +(do|look): +(\S.*\n(?: {11,}\S.*\n)*)", re.MULTILINE)
#: commands of packet filters are made of the rules that were read, and do not stand in the table
READ_RULES = re.compile(r"on \S+: for from in .* nft insert rule ")


def test_a_sample_of_a_finding_on_a_page_is_that_of_the_table():
    by_id = {fault.id: fault for fault in TABLE.values()}
    compared = 0
    for page in sorted(ROOT.glob("docs/**/*.md")):
        for id_, lines in SAMPLE.findall(page.read_text(encoding="utf-8")):
            for word, told in LINES.findall(lines):
                text = " ".join(told.split())
                known = list(_match(by_id[id_], getattr(by_id[id_], word)))
                assert READ_RULES.match(text) or any(re.fullmatch(one, text) for one in known), (page.name, text, known)
                compared += 1
    assert compared > 5


def test_the_pages_are_those_of_the_table():
    done = subprocess.run(
        [sys.executable, ROOT / "tools/findings.py", "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
