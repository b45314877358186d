# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The limits of a function."""

import pytest

from tools import house


@pytest.mark.slow
def test_no_function_is_too_long_or_too_complex():
    assert not {name for _path, name, _lines, _ways in house.offenders(house.ROOT)}
