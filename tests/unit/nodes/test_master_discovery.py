# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""master_discovery as a whole, in a network namespace: what others hear of it, systemd is told, and people are shown."""

import pytest
from namespaces import run_alone, why_not_alone
from running_discovery import STORIES

pytestmark = pytest.mark.whole


@pytest.mark.skipif(bool(why_not_alone()), reason=why_not_alone())
@pytest.mark.parametrize("story", STORIES)
def test_the_program_in_a_network(story, tmp_path):
    run_alone("running_discovery.py", story, tmp_path)
