# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pace of the machine, which tells a slow machine from a slow program."""

import os

import pace


def test_the_stolen_time_is_the_eighth_number_of_all_processors():
    assert pace.stolen("cpu  1 2 3 4 5 6 7 800 9 10\ncpu0 1 1 1 1 1 1 1 400 1 1\n") == 800 / os.sysconf("SC_CLK_TCK")
    assert pace.stolen() >= 0


def test_the_reference_takes_time_on_all_cores(monkeypatch):
    monkeypatch.setattr(pace, "TIMES", 1)
    assert pace.reference() > 0
