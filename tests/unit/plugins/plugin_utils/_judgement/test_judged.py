# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A judgement keeps as much as the files that are asked for show."""

import fleets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.engine import Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement.judged import judge


def judged(fleet, pages, everything, change=None):
    seen = fleets.observed(fleet)
    if change:
        change(seen)
    return judge(Verification(CHECKS, fleet, seen), pages, everything)


def test_the_findings_are_the_same_whatever_is_kept():
    small = [judged(fleets.fig12(), pages, False, fleets.wall) for pages in (False, True)]
    large = [
        judged(fleets.plan(21, 2), pages, everything, lambda seen: fleets.silent(seen, list(seen), ["kobuki7computer"]))
        for pages, everything in ((False, False), (True, False), (True, True))
    ]
    for results in (small, large):
        assert len({str(entry.diagnosis.findings) for entry in results}) == 1
        assert len({str(sorted(entry.summary.counts.items())) for entry in results}) == 1
        assert results[0].matrices is None and results[0].rows == ()
    assert len(small[1].rows) == small[1].summary.total
    assert large[1].rows == large[1].summary.notable and len(large[2].rows) == large[2].summary.total
