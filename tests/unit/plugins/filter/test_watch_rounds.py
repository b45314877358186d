# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter watch_rounds: a duration and its rounds; a text that is none is refused."""

import pytest
from ansible.errors import AnsibleFilterError
from ansible_collections.rosfleet.multimaster.plugins.filter.watch_rounds import watch_rounds


def test_a_duration_is_split_into_rounds():
    assert watch_rounds("40") == {"seconds": 40, "ends": [15, 30, 40]}
    assert watch_rounds(40) == watch_rounds("40s")


def test_another_text_is_refused():
    with pytest.raises(AnsibleFilterError, match="verify_watch.*soon.*10s.*7d"):
        watch_rounds("soon")
