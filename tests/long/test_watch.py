# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A fault that needs minutes: a switch that snoops IGMP, whose querier is gone, forgets the group after 260 seconds."""

import re
from pathlib import Path

from machines.layout import Extra
from subject import lab_of
from words import STRANGER, STRANGERS_ADDRESS, Words

ROOT = Path(__file__).resolve().parents[2]

FORGETS = 260.0  # seconds: RFC 2236, section 8.4, with the defaults of sections 8.1 to 8.3


def test_the_watch_tells_when_a_switch_forgets_the_group():
    inventory = ROOT / "tests" / "faults" / "inventory"
    with lab_of("long-watch", inventory, {STRANGER: Extra((STRANGERS_ADDRESS,))}) as lab:
        status, output = lab.play("site.yml")
        assert status == 0, output
        words = Words(lab)
        words.snooping(FORGETS)
        try:
            status, output = lab.play("playbooks/verify.yml", variables={"verify_watch": "8m"})
        finally:
            words.flooding()
    assert status != 0
    assert "PASSED: none of" in output  # at first everything was well
    after = re.search(
        r"First loss at [0-9:]+, (\d):(\d\d) after the start: \d computers hear no heartbeat on the group", output
    )
    assert after, output
    # The query was sent before the verification, which takes some of the 260 seconds.
    assert FORGETS - 150 < 60 * int(after[1]) + int(after[2]) <= FORGETS + 10
    assert "does not pass the group" in output or "IGMP" in output
