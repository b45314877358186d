# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of the catalogue in the words of another fleet."""

import re

import catalogue
import pytest
import seeded
from machines.podman import LabError
from rehearsals.cast import LITERAL, PARTS, cast_faults, cast_of, judge_report

ALL = {path.stem for path in catalogue.FOLDER.glob("*.yml")}


def shipped(layout, **shared):
    """The cast of a shipped inventory."""
    found = seeded.Mistake("none", "", layout, seeded.PLAN, ())
    variables = {host: {**own, **shared} for host, own in found.variables().items()}
    return cast_of(found.robots(), variables)


def test_gateways_that_run_the_roscore_are_preferred():
    assert shipped("multi_computer").computers == {
        "tibi-gate": "car-visio",
        "tibi-arm": "car-nav",
        "dabo-gate": "tibi-visio",
        "dabo-arm": "tibi-nav",
        "kobuki-pc": "dabo-nav",
    }


def test_the_fleets_own_values_are_in_the_commands():
    cast = shipped("multi_computer", multimaster_multicast_port=11999)
    (fault,) = cast_faults(["no_return_route"], cast)
    assert [(step.where, step.what) for step in fault.inject] == [
        ("tibi-visio", "ip route show exact 192.168.12.0/24 >/run/fault.route; ip route del 192.168.12.0/24")
    ]
    assert fault.at == ("tibi-visio",)
    assert cast.translate("ip a del <tibi-arm>/24; <tibi-gate.common> <port> <group> 192.168.1.77") == (
        "ip a del 192.168.12.100/24; 192.168.1.203 11999 224.0.0.1 192.168.1.254"
    )
    assert cast.translate("echo 192.168.1.88 dabo-gate >>/etc/hosts") == "echo 192.168.1.254 tibi-visio >>/etc/hosts"
    assert cast.translate("tcp dport 11611 drop 192.168.12.0/24") == "tcp dport 11611 drop 192.168.11.0/24"
    assert cast.translate("192.168.111.77 1116110") == "192.168.111.77 1116110"


def test_a_report_is_compared_with_the_fault():
    (fault,) = cast_faults(["no_forwarding"], shipped("multi_computer"))
    finding = {"kind": "forwarding", "mode": "off", "place": "car-visio", "sentence": "car-visio forwards nothing"}
    assert judge_report(fault, {"findings": [finding]}) == (True, "first: car-visio forwards nothing")
    assert judge_report(fault, {"findings": [{**finding, "place": "tibi-visio"}]})[0] is False
    assert judge_report(fault, {}) == (False, "nothing was named: ")


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["single_computer", "multi_computer"])
def test_each_fault_is_made_or_refused_in_one_sentence(layout):
    made = set()
    for name in ALL:
        try:
            (fault,) = cast_faults([name], shipped(layout))
        except LabError as problem:
            assert re.fullmatch(rf"FAULTS has {name}, which [^.]+; leave it out\.", str(problem))
            continue
        made.add(name)
        for step in (*fault.inject, *fault.settled, *fault.undo):
            assert step.where not in PARTS and not re.search("|".join(PARTS), step.what)
            assert not re.search(r"<(?!<)[a-z]+(-[a-z]+)?(\.common)?>", step.what)
    assert len(made) >= {"single_computer": 10, "multi_computer": 30}[layout]


def test_literals_of_the_catalogue_are_known():
    """An address in a new fault that no row knows would be injected as it stands there."""
    known = re.compile(r"239\.1\.2\.3|127\.0\.[01]\.1|172\.17\.0\.1|0\.0\.0\.0|192\.0\.2\.1")
    for path in catalogue.FOLDER.glob("*.yml"):
        text = known.sub("", LITERAL.sub("", path.read_text()))
        if "- lab:" not in text:
            assert not re.findall(r"\d+\.\d+\.\d+\.\d+", text), path.name


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no_forwardings", "which is no fault of the catalogue; expected some of another_group,"),
        ("snooping", "which is made between the computers of the catalogue's own lab"),
        (
            "no_forwarding",
            "which needs a robot with a network of its own behind a gateway, and the fleet has none that is free",
        ),
    ],
)
def test_what_cannot_be_made_is_refused(name, words):
    with pytest.raises(LabError, match=re.escape(words)):
        cast_faults([name], shipped("single_computer"))
