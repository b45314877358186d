# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The part that counts as named first, in both forms of the report."""

import catalogue
import judge
import pytest

FAULT = catalogue.Fault("icmp", "", (), (), (), (("filter", "icmp in"), ("filter", "icmp")), ("arm",), True)


def finding(mode="icmp in", place="arm", kind="filter", rivals=()):
    return {"kind": kind, "mode": mode, "place": place, "sentence": "so it is", "rivals": list(rivals)}


@pytest.mark.parametrize(
    ("findings", "expected"),
    [
        ([finding()], judge.FIRST),
        ([finding("icmp")], judge.FIRST),
        ([finding(place="arm and gate")], judge.FIRST),
        ([finding(place="gate")], judge.OTHER),
        ([finding(place="armada")], judge.OTHER),
        ([finding("udp")], judge.OTHER),
        ([finding("off", kind="computer"), finding()], judge.OTHER),
        ([finding(rivals=[finding("off", kind="computer")])], judge.RIVAL),
        ([finding("off", kind="computer", rivals=[finding()])], judge.RIVAL),
        ([], judge.NOTHING),
    ],
)
def test_a_part_is_right_by_kind_mode_and_place(findings, expected):
    assert judge.verdict(FAULT, judge.named({"findings": findings})) == expected


def check(verdict, because="", cause="why"):
    return {
        "check": "ping_name",
        "observer": "a",
        "target": "b",
        "verdict": verdict,
        "because": because,
        "cause": cause,
        "found": "nothing",
    }


def test_first_cause_is_named_without_parts():
    rows = [check("ok"), check("warning", cause="small"), check("failed", because="another"), check("failed")]
    found = judge.named({"findings": rows})
    assert found.text == "ping_name a -> b: why" and found.findings == 2
    assert judge.verdict(FAULT, found) == judge.OTHER
    assert judge.verdict(FAULT, judge.named({"findings": [check("ok")]})) == judge.NOTHING
