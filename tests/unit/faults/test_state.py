# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The fleet is as before only when each computer is, to the letter."""

import state

BEFORE = {"gate": "up\nforward = 1\n", "arm": "up\n"}


class Lab:
    """Answers with a state, and after some looks with another one."""

    def __init__(self, *states):
        self.states = list(states)

    def run(self, host, command, check):
        assert ("list_masters" in command) == (host == "gate")
        if host == "gate":
            return self.states.pop(0) if len(self.states) > 1 else self.states[0]
        return BEFORE[host]


def test_it_is_waited_for_what_comes_back(monkeypatch):
    monkeypatch.setattr(state, "PAUSE", 0)
    lab = Lab("up\nforward = 0\n", "up\nforward = 0\n", BEFORE["gate"])
    assert state.back(lab, BEFORE, ["gate"]) == []
    assert len(lab.states) == 1


def test_what_stays_is_told(monkeypatch):
    monkeypatch.setattr(state, "PATIENCE", 0)
    assert state.back(Lab("up\nforward = 0\n"), BEFORE, ["gate"]) == [
        "gate: missing: forward = 1",
        "gate: new: forward = 0",
    ]
    assert state.back(Lab("forward = 1\nup\n"), BEFORE, ["gate"]) == ["gate: another order of lines"]
