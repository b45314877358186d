# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A state that cannot be had: the sentence in the log."""

from types import SimpleNamespace

import pytest
from rosfleet_multimaster.edge.xml_rpc import TooLarge
from rosfleet_multimaster.parts.fetcher import Fetcher

FETCH = SimpleNamespace(uri="http://b:11311/", monitor_uri="http://b:11611")


@pytest.mark.parametrize(
    ("problem", "end"),
    [
        (OSError("it does not answer"), "11611: it does not answer"),
        (
            TooLarge("it has more than 16777216 bytes"),
            "11611: it has more than 16777216 bytes; nothing new of it is taken, what was registered stays: leave out there what "
            "nobody needs, by multimaster_exports",
        ),
    ],
)
def test_a_state_that_cannot_be_had_is_one_sentence(problem, end):
    said = []
    core = SimpleNamespace(fetched=lambda *arguments, **options: False)
    limited = SimpleNamespace(say=lambda level, key, sentence: said.append((level, sentence)))
    Fetcher(None, core, limited, None)._fetched(FETCH, None, problem)
    ((level, sentence),) = said
    assert level == "warning" and sentence.startswith("the state of http://b:11311/ cannot be had from http://b:")
    assert sentence.endswith(end)
