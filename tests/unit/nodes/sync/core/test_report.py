# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The entries of /diagnostics about refusals."""

from rosfleet_multimaster.protocol.messages import OK, VALUES, WARN
from rosfleet_multimaster.sync.core.report import describe_refusal, describe_refusal_end, diagnoses
from rosfleet_multimaster.sync.core.sync import Refusal


def test_refusals_are_warnings_and_not_too_many():
    kinds = ("node", "service", "type", "place", "limit", "parameter")
    assert [entry.level for entry in diagnoses([])] == [OK] * 5
    for kind in kinds:
        found = diagnoses([Refusal(kind, "/a", "robot2", "http://r2:1/", "5000")])
        assert [entry.level for entry in found].count(WARN) == 1
    many = [Refusal("node", f"/a{number}", "robot2", "http://r2:1/", "x") for number in range(VALUES + 5)]
    values = diagnoses(many)[1].values
    assert len(values) == VALUES + 1 and values[-1] == ("more", "5 are not listed here")


def test_a_parameter_that_is_not_copied_is_told_with_its_reason():
    item = Refusal("parameter", "/model", "robot2", "", "here it has a value of its own, at /model")
    assert (
        describe_refusal(item)
        == "robot2: the parameter /model is not copied: here it has a value of its own, at /model"
    )
    assert describe_refusal_end(item) == "robot2: the parameter /model is no longer refused"
    assert diagnoses([item])[-1].values == [
        ("parameter /model", "of robot2: here it has a value of its own, at /model")
    ]
