# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Which packages are installed, removed and recorded."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import packages

HEADER = "# The Debian packages that the collection rosfleet.multimaster installed.\n"

CASES = {
    "nothing wanted, nothing there": ([], [], [], ((), (), "")),
    "nothing there": (["b", "a"], [], [], (("b", "a"), (), f"{HEADER}a\nb\n")),
    "the owner has installed one": (["a", "b"], ["a"], [], (("b",), (), f"{HEADER}b\n")),
    "all there of the owner": (["a"], ["a"], [], ((), (), "")),
    "all there of ours": (["a"], ["a"], ["a"], ((), (), f"{HEADER}a\n")),
    "ours, removed by hand": (["a"], [], ["a"], (("a",), (), f"{HEADER}a\n")),
    "wanted no more": (["a"], ["a", "b"], ["a", "b"], ((), ("b",), f"{HEADER}a\n")),
    "none wanted any more": ([], ["a", "c"], ["a"], ((), ("a",), "")),
}


@pytest.mark.parametrize("case", CASES)
def test_changes(case):
    wanted, installed, ours, expected = CASES[case]
    assert packages.changes(wanted, installed, ours) == packages.Changes(*expected)
