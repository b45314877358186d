# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A roscore as a process, which one address fills as far as it is let: the others register, and the memory is as it was counted."""

import json

import pytest
from namespaces import run_alone, why_not_alone
from rosfleet_multimaster.roscore.core.bounds import BOUNDS, MIB

pytestmark = [pytest.mark.whole, pytest.mark.slow]

WITHIN = 2.0  # seconds
#: Bytes that its process has beside what it holds: of its code, of a request with its answer, and of a store that is read.
BESIDE = 96 * MIB


@pytest.mark.skipif(bool(why_not_alone()), reason=why_not_alone())
def test_one_address_fills_its_share_and_others_register_before_and_after_a_kill(tmp_path):
    found = json.loads(run_alone("running_full_roscore.py", tmp_path, log=tmp_path / "log"))
    print(*found, sep="\n")
    counted = BOUNDS["registrations of one"].most + BOUNDS["parameters of one"].most
    for life in found:
        assert all("of the" in text and "another robot" in text for text in life["answers"])
        assert max(life["waits"]) < WITHIN
        assert life["peak"] < counted + BESIDE
