# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Fixtures of all unit tests."""

import gc
import os

import pytest
from hypothesis import HealthCheck, settings

# Generated input counts, not the time that a loaded machine takes for it.
settings.register_profile("rosfleet", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("rosfleet")
# 'make quick' tries fewer of them.
settings.register_profile("quick", settings.get_profile("rosfleet"), max_examples=10)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Keep what is collected: to look through it for garbage again and again would take half the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_runtest_setup(item):
    """Skip what needs root for everybody else, before the fixtures of a test are made."""
    if os.geteuid() != 0 and item.get_closest_marker("root"):
        pytest.skip("needs root")
