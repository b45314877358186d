# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""nftables: the sentences for computers that cannot have the table. ../test_run.py has a real kernel."""

import os
import shutil
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.backends import contract, nftables
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.wanted import Wanted
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem

WANTED = Wanted(("10.5.0.1",), (), ())


def test_a_computer_without_nft(monkeypatch):
    monkeypatch.setattr(contract, "program", lambda _name: "")
    with pytest.raises(Problem, match=r"^There is no nft, expected it .* install it \(apt-get install nftables\)"):
        nftables.BackEnd(False).rules(WANTED)


def test_a_kernel_without_nftables(monkeypatch):
    said = "Error: Could not process rule: Operation not supported\n" + "table inet rosfleet_multimaster\n" * 100
    monkeypatch.setattr(contract, "program", lambda name: "/usr/sbin/" + name)
    monkeypatch.setattr(contract, "ask", lambda _argv: Answer(1, b"", said))
    with pytest.raises(Problem, match="^This computer does not take the packet filter") as found:
        nftables.BackEnd(False).rules(WANTED)
    assert "nft says: Error: Could not process rule: Operation not supported" in str(found.value)
    assert "set multimaster_firewall to none" in str(found.value) and len(str(found.value)) < 500


def test_a_container_that_may_make_no_network_namespace(monkeypatch):
    """The real unshare, without the right: as another user, or with a limit."""
    ask = contract.ask
    monkeypatch.setattr(contract, "program", lambda name: "/usr/sbin/" + name)
    restricted = ["setpriv", "--bounding-set=-sys_admin", "--inh-caps=-all"] if os.geteuid() == 0 else []
    if restricted and not (shutil.which("setpriv") and may_drop(restricted)):
        pytest.skip("setpriv cannot take the right away here")
    monkeypatch.setattr(contract, "ask", lambda argv: ask([*restricted, *argv]))
    with pytest.raises(
        Problem, match="could not be tried in a network namespace of their own .unshare: unshare failed"
    ):
        nftables.BackEnd(False).rules(WANTED)


def may_drop(restricted):
    return subprocess.run([*restricted, "true"], check=False, capture_output=True).returncode == 0
