# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reader of `systemctl show`."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import systemd
from hypothesis import given
from hypothesis import strategies as st

# As systemctl of systemd 237 and 255 prints it for two units, one of which does not exist.
SHOWN = """Id=ssh.service
ActiveState=active
ExecStart={ path=/usr/sbin/sshd ; argv[]=/usr/sbin/sshd -D $SSHD_OPTS ; ignore_errors=no }

Id=sshd.service
ActiveState=inactive
ExecStart=
"""


def test_each_unit_is_a_block():
    first, second = systemd.parse(SHOWN)
    assert first["ActiveState"] == "active" and first["ExecStart"].endswith("ignore_errors=no }")
    assert second == {"Id": "sshd.service", "ActiveState": "inactive", "ExecStart": ""}
    assert systemd.parse("") == []


@given(st.text())
def test_any_output_is_read(output):
    systemd.parse(output)


def test_units_are_asked_for_in_one_call(monkeypatch):
    asked = []

    def run(argv, limit):
        asked.append((argv, limit))
        return commands.Answer(0, SHOWN.encode(), "")

    monkeypatch.setattr(commands, "run", run)
    shown = systemd.show(("ssh.service", "sshd.service"), ("Id", "ActiveState"), 60.0)
    assert asked == [(["systemctl", "show", "--property=Id,ActiveState", "--", "ssh.service", "sshd.service"], 60.0)]
    assert [unit["Id"] for unit in shown.units] == ["ssh.service", "sshd.service"] and shown.error == ""


def test_what_systemctl_says_is_the_error(monkeypatch):
    monkeypatch.setattr(commands, "run", lambda argv, limit: commands.Answer(1, b"", "Failed to connect to bus"))
    assert systemd.show(["ssh.service"], ["Id"]) == ([], "Failed to connect to bus")
