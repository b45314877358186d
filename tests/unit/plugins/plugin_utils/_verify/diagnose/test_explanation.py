# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ten readable lines about a finding."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.explanation import (
    MOST,
    UnknownFinding,
    choose_findings,
    list_lines,
    write_explanation,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import FilterChains
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import content
from fleets import diagnose, diagnosed, fig12, lost_route, wall

from tests.unit.plugins.plugin_utils._verify.trace.test_findings import follow, lose_behind_wall


def _followed():
    fleet, seen = lose_behind_wall(FilterChains(True, ()))
    follow(fleet, seen)
    return diagnose(fleet, seen)


@pytest.mark.slow
@pytest.mark.parametrize("make", [lambda: diagnosed(wall, fig12()), lambda: diagnosed(lost_route, fig12()), _followed])
@pytest.mark.parametrize("width", [80, 160])
def test_it_has_ten_lines_that_fit(make, width):
    for number, entry in enumerate(content.list_findings(make()), 1):
        lines = write_explanation(number, entry, width)
        assert 5 <= len(lines) <= MOST and max(map(len, lines)) <= width
        assert lines[0].startswith(f"Finding {number}, {entry['id']}: ")
        labels = [label for label, _text in list_lines(entry)]
        assert labels[0] == "decided by:" and "rival:" in labels and labels[-1] == "wrong?"


def test_a_trace_names_each_computer_in_order():
    (entry, *_more) = content.list_findings(_followed())
    (trace,) = [text for label, text in list_lines(entry) if label == "trace:"]
    assert trace.index("router: left by eth0") < trace.index(" > tibi-visio: came in by eth0, ends ")


def test_who_corrects_a_finding_is_led_to_the_file_of_its_rule():
    """A followed packet is judged in the trace, a wrong route by the check."""
    for found, file in ((_followed(), "trace/suspects.py"), (diagnosed(lost_route, fig12()), "checks/network.py")):
        (entry, *_more) = content.list_findings(found)
        (files,) = [text for label, text in list_lines(entry) if label == "wrong?"]
        assert files.startswith(f"see {file}")


@pytest.mark.parametrize(
    ("option", "expected"), [("", []), ("2", [2]), ("1, 3", [1, 3]), ("all", [1, 2, 3]), (" ,", [])]
)
def test_findings_are_chosen_by_number(option, expected):
    assert choose_findings(option, 3) == expected


@pytest.mark.parametrize("option", ["0", "4", "-1", "x", "2;reboot", "9" * 50, "1 2", "\u0661\u0661"])
def test_another_word_is_refused(option):
    with pytest.raises(UnknownFinding):
        choose_findings(option, 3)


def test_all_of_nothing_is_nothing():
    assert choose_findings("all", 0) == []
    with pytest.raises(UnknownFinding):
        choose_findings("1", 0)
