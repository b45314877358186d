# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The record of imports."""

import pytest
from rosfleet_multimaster.protocol import imports

CLAIMS = {("/talker", "http://robot2:1/"): "http://robot2:11311/"}


def test_what_is_written_is_read_again():
    text = imports.write("/master_sync", "http://robot1:1/", CLAIMS)
    assert imports.read(text).claims == CLAIMS
    assert imports.read(text)[:2] == ("/master_sync", "http://robot1:1/")


@pytest.mark.parametrize(
    "text",
    [
        None,
        7,
        "",
        "{",
        "[]",
        "{}",
        "[" * 100_000,
        '{"imports": {"a": {"b": 7}}}',
        '{"imports": []}',
        '{"imports": {"a": 7}}',
        '{"node": [], "imports": {"a": {"b": []}}}',
    ],
)
def test_a_damaged_record_claims_nothing(text):
    assert imports.read(text).claims == {}
