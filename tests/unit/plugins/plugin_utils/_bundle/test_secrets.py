# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Secrets are taken out, whatever their kind; what is none stays, so that the judgement is the same."""

import time

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.secrets import (
    REMOVED,
    Secrets,
    named,
    values,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Differing
from planted import PLANTED, TIME


@pytest.mark.parametrize(("text", "secret"), [entry[1:] for entry in PLANTED], ids=[entry[0] for entry in PLANTED])
def test_a_kind_of_secret(text, secret):
    assert secret in text  # or the test could not fail
    before, after = f"{TIME}kobuki1computer is online\n", f"\n{TIME}kobuki2computer is offline"
    found = Secrets().text(text)
    assert secret not in found and REMOVED in found
    both = Secrets().text(before + text + after)
    assert secret not in both and both.endswith(after)


def test_values_that_are_known_are_taken_out_wherever_they_stand():
    known = values(
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


def test_a_name_of_the_fleet_is_no_secret_and_neither_is_a_word_of_three_letters():
    assert Secrets(["kobuki1", "ros"], ["Kobuki1"]).text("kobuki1 has ros") == "kobuki1 has ros"


@pytest.mark.parametrize(
    "name", ["ansible_password", "DB_PASSWD", "wifiPsk", "api-key", "vault_it", "tokens", "AWS_SECRET_ACCESS_KEY"]
)
def test_a_name_that_says_so(name):
    assert named(name)


@pytest.mark.parametrize(
    "name", ["compass", "passed", "key", "topics", "tokenizer", "author", "ROS_MASTER_URI", "secretary"]
)
def test_a_name_that_does_not_say_so(name):
    assert not named(name)


def test_values_beside_such_a_name_in_data():
    data = {"API_KEY": "x1", "list": [{"password": ["a"]}], "ROS_IP": "192.168.1.1", "token": ""}
    assert Secrets().data(data) == {
        "API_KEY": REMOVED,
        "list": [{"password": REMOVED}],
        "ROS_IP": "192.168.1.1",
        "token": "",
    }
    assert Secrets().data(Differing("sync", "api_key", "one", "two")) == Differing("sync", "api_key", REMOVED, REMOVED)


@pytest.mark.parametrize("fleet", [fleets.fig12(), fleets.plan(3, 2)], ids=["fig12", "plan"])
def test_a_plan_and_what_was_seen_have_no_secrets(fleet):
    assert Secrets().data(fleet) == fleet
    seen = fleets.observed(fleet)
    assert Secrets().data(seen) == seen


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
