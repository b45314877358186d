# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The entries of /diagnostics about refusals."""

from mentioned import mentions
from rosfleet_multimaster.protocol.messages import OK, VALUES, WARN
from rosfleet_multimaster.sync.core.report import (
    describe_refusal,
    describe_refusal_end,
    describe_status,
    diagnoses,
)
from rosfleet_multimaster.sync.core.sync import RegistrationConflict


def test_refusals_are_warnings_and_not_too_many():
    kinds = ("node", "service", "type", "place", "limit", "parameter")
    assert [entry.level for entry in diagnoses([])] == [OK] * 5
    for kind in kinds:
        found = diagnoses([RegistrationConflict(kind, "/a", "robot2", "http://r2:1/", "5000")])
        assert [entry.level for entry in found].count(WARN) == 1
    many = [RegistrationConflict("node", f"/a{number}", "robot2", "http://r2:1/", "x") for number in range(VALUES + 5)]
    values = diagnoses(many)[1].values
    assert len(values) == VALUES + 1 and values[-1] == ("more", "5 are not listed here")


def test_a_parameter_that_is_not_copied_is_told_with_its_reason():
    item = RegistrationConflict("parameter", "/model", "robot2", "", "here it has a value of its own, at /model")
    assert mentions(describe_refusal(item), "robot2", "/model", "own")
    assert describe_refusal_end(item) == "robot2: the parameter /model is no longer refused"
    assert diagnoses([item])[-1].values == [
        ("parameter /model", "of robot2: here it has a value of its own, at /model")
    ]


def test_systemd_is_told_names_with_reasons_and_not_too_much():
    place = RegistrationConflict(
        "place", "/odom", "robot2", "http://127.0.0.1:1234/", '"here" is no computer of robot2'
    )
    limit = RegistrationConflict("limit", "robot3", "robot3", "", "5000")
    assert describe_status([], 1000) == ""
    assert describe_status([limit], 1000) == "; not all of robot3: too many"
    assert mentions(
        describe_status([limit, place], 1000),
        "/odom",
        "http://127.0.0.1:1234/",
        "robot2",
        "here' is no computer of robot2",
        "robot3",
    )
    many = describe_status([place._replace(name=f"/odom{number}") for number in range(500)], 1500)
    assert len(many) <= 1500 and many.count("(place") >= 5 and " more" in many
