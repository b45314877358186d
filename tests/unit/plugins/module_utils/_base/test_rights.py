# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rights of a process, asked before a change."""

import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import rights


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to be somebody else")
def test_who_may_change_the_network():
    assert rights.may_change_network()
    assert rights.has_all_rights() or "CapEff:\t000001ffffffffff" not in open("/proc/self/status").read()
    child = os.fork()
    if child == 0:
        os.setgroups([])
        os.setuid(65534)
        os._exit(int(rights.may_change_network() or rights.has_all_rights()))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
