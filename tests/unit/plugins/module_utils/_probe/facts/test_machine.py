# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A strange part of a machine costs none of the others; an option that is wrong is a sentence."""

import time

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.facts import machine
from mentioned import mentions


def test_a_strange_part_is_a_sentence(monkeypatch):
    def strange():
        raise OSError("no such thing")

    parts = [
        machine.FactPart("interfaces", strange, 1),
        machine.FactPart("exports", time.sleep, 0.05, options=("seconds",)),
        machine.FactPart("sshd", dict, 1),
    ]
    monkeypatch.setattr(machine, "PARTS", parts)
    found = machine.look({"parts": ["interfaces", "exports", "sshd"], "seconds": 3})
    first, second = found.pop("problems")
    assert found == {"interfaces": [], "exports": [], "silent_shells": [], "sshd": {}}
    assert mentions(first, "interfaces", "no such thing") and mentions(second, "exports", "0.05 s")


def test_a_port_that_is_none_is_a_sentence():
    ports = [{"protocol": "tcp", "port": 11311}, {"protocol": "udp", "port": 70000}]
    assert mentions(machine.wrong({"ports": ports}), "70000", "1", "65535")
    assert machine.wrong({"ports": ports[:1]}) == ""
