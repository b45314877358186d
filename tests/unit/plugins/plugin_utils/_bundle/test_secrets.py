# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Secrets are taken out, whatever their kind; what is none stays, so that the judgement is the same."""

import base64
import random
import time

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure.parameters import digest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import LINE
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.secrets import (
    REMOVED,
    Secrets,
    collect_foreign,
    collect_values,
    is_secret,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.preflight import MachineState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    CrossingParameter,
    ParameterDifference,
)
from planted import ORDINARY, PLANTED, TIME, any_secret


@pytest.mark.slow
@pytest.mark.parametrize("planted", PLANTED, ids=[f"{entry.text[:40]!r}" for entry in PLANTED])
def test_a_secret_as_people_write_it(planted):
    assert all(part in planted.text for part in planted.parts)  # or the test could not fail
    before, after = f"{TIME}kobuki1computer is online\n", f"\n{TIME}kobuki2computer is offline"
    journal = "".join(f"\n{TIME}{line}" for line in planted.text.split("\n"))
    for text in (planted.text, before + planted.text + after, f"{before}{journal}{after}"):
        found = Secrets().text(text)
        assert REMOVED in found and not [part for part in planted.parts if part in found], found


def test_there_are_enough_of_them():
    assert len(PLANTED) >= 200 and len(set(PLANTED)) == len(PLANTED) and len(ORDINARY) >= 140


@pytest.mark.parametrize("line", ORDINARY)
def test_an_ordinary_line_stays_as_it_is(line):
    assert Secrets().text(line) == line
    assert Secrets().text(TIME + line) == TIME + line


def test_ordinary_lines_stay_as_they_are_one_after_another():
    text = "".join(f"{TIME}{line}\n" for line in ORDINARY)
    assert Secrets().text(text) == text


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_any_secret_in_any_form_anywhere(seed):
    """Drawn by a generator: names, forms and surroundings as programs and people have them."""
    for number in range(100):
        planted = any_secret(seed * 1000 + number)
        found = Secrets().text(planted.text)
        assert not [part for part in planted.parts if part in found], (seed * 1000 + number, planted.text, found)


def test_values_that_are_known_are_taken_out_wherever_they_stand():
    known = collect_values(
        {
            "ansible_become_password": "open sesame",
            "vault_x": ["one1", {"a": "two2"}],
            "plain": "three3",
            "deep": {"db_token": 44444},
        }
    )
    assert known == {"open sesame", "one1", "two2", "44444"}
    text = "said open sesame, one1 and two2; 44444; three3; one12"
    assert Secrets(known).text(text) == f"said {REMOVED}, {REMOVED} and {REMOVED}; {REMOVED}; three3; one12"


def test_unlisted_variables_are_taken_out_by_any_name():
    variables = {
        "multimaster_address": "192.168.1.229",
        "verify_report": "report",
        "door": "abracadabra",
        "wifi": {"key": "lab-key", "ssid": ["our lab"]},
        "mqtt_pw": "mq tt",
        "ansible_user": "anna",
        "ansible_ssh_common_args": "-o ProxyCommand=x",
        "ntp_server": "192.168.1.1",
        "found": {"changed": False, "stdout": "a result"},
        "count": 12,
        "flag": True,
    }
    found = collect_foreign(variables, ["multimaster_address", "verify_report"])
    assert found == {"abracadabra", "lab-key", "our lab", "mq tt", "-o ProxyCommand=x"}
    secrets = Secrets(foreign=found, kept=["our lab"])
    assert secrets.text("said abracadabra in our lab") == f"said {REMOVED} in our lab"
    assert secrets.data(["abracadabra", "it is abracadabra"]) == ["abracadabra", f"it is {REMOVED}"]


def test_a_name_of_the_fleet_or_a_short_word_is_no_secret():
    assert Secrets(["kobuki1", "ros"], ["Kobuki1"]).text("kobuki1 has ros") == "kobuki1 has ros"


@pytest.mark.parametrize(
    "name",
    [
        "ansible_password",
        "DB_PASSWD",
        "wifiPsk",
        "api-key",
        "vault_it",
        "tokens",
        "AWS_SECRET_ACCESS_KEY",
        "mqtt_pw",
        "snmp_community",
        "ssh_key",
        "wifi.key",
        "PGPASSWORD",
        "SSHPASS",
        "DB_PW",
        "rootpw",
    ],
)
def test_a_name_that_says_so(name):
    assert is_secret(name)


@pytest.mark.parametrize(
    "name",
    [
        "compass",
        "passed",
        "key",
        "topics",
        "tokenizer",
        "author",
        "ROS_MASTER_URI",
        "secretary",
        "public_key",
        "COMPASS",
        "fpw",
        "keys",
        "authors",
        "keyboard",
    ],
)
def test_a_name_that_does_not_say_so(name):
    assert not is_secret(name)


def test_values_beside_such_a_name_in_data():
    data = {"API_KEY": "x1", "list": [{"password": ["a"]}], "ROS_IP": "192.168.1.1", "token": ""}
    assert Secrets().data(data) == {
        "API_KEY": REMOVED,
        "list": [{"password": REMOVED}],
        "ROS_IP": "192.168.1.1",
        "token": "",
    }
    assert Secrets().data(ParameterDifference("sync", "api_key", "one", "two")) == ParameterDifference(
        "sync", "api_key", REMOVED, REMOVED
    )


def test_a_digest_says_only_what_is_the_same():
    values = ("1234", "5678", "1234", "")
    seen = [CrossingParameter("/door/code", value and digest(value)) for value in values]
    assert [entry.digest for entry in Secrets().data(seen)] == ["value 1", "value 2", "value 1", ""]


def test_of_an_environment_it_has_what_is_listed():
    found = MachineState(
        environment={"ROS_MASTER_URI": "http://a:11311", "DOOR": "abracadabra", "ROS_TOKEN": "x1", "PYTHONPATH": "/a"}
    )
    kept = {"ROS_MASTER_URI": "http://a:11311", "DOOR": REMOVED, "ROS_TOKEN": REMOVED, "PYTHONPATH": "/a"}
    assert Secrets().data(found).environment == kept


@pytest.mark.parametrize("fleet", [fleets.fig12(), fleets.plan(3, 2)], ids=["fig12", "plan"])
def test_a_plan_and_what_was_seen_have_no_secrets(fleet):
    assert Secrets().data(fleet) == fleet
    seen = fleets.observed(fleet)
    assert Secrets().data(seen) == seen


@pytest.mark.slow
@pytest.mark.parametrize(
    "piece",
    [
        "curl ",
        "-",
        "password",
        "a:",
        "://a:",
        "--user ",
        "AKIA",
        "-----BEGIN ",
        "eyJ",
        "$6$",
        "a=",
        "\\\"'",
        "A1a/",
        "psk -",
        "x",
    ],
)
def test_a_long_text_of_anybody_takes_no_long_time(piece):
    began = time.process_time()
    Secrets().text(piece * (60_000 // len(piece)))
    assert time.process_time() - began < 5


@pytest.mark.slow
@pytest.mark.parametrize("begin, piece", [("", "echo -"), ("", "echo -n "), ("https://webhooka.aa", "uc")])
def test_the_longest_lines_of_a_log_take_no_long_time(begin, piece):
    """A computer has a thousand such lines for each service, and whoever calls its nodes may have written them."""
    line = (begin + piece * LINE)[:LINE]
    began = time.process_time()
    Secrets().text("\n".join([line] * 20))
    assert time.process_time() - began < 4


@pytest.mark.slow
@pytest.mark.parametrize(
    "frame", ["echo {} | wg set wg0 private-key /dev/stdin", "it is {}", "'{}'", "x={}", "{}", "a,{},b"]
)
def test_a_key_of_wireguard_has_a_form(frame):
    """32 bytes in base64, with and without a slash or a plus. Half of all stayed in free text."""
    for seed in range(300):
        key = base64.b64encode(random.Random(seed).randbytes(32)).decode()
        assert key not in Secrets().text(frame.format(key)), key
        assert key not in str(Secrets().data({"x": frame.format(key)})), key


def test_a_computer_with_the_name_of_a_secret_keeps_its_data():
    found = Secrets(kept=["vault-pc"]).data({"machines": {"vault-pc": {"system": "Debian"}}, "vault": "hunter2"})
    assert found == {"machines": {"vault-pc": {"system": "Debian"}}, "vault": "(removed)"}
