# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Values in units: what systemd would read as its own is quoted or refused; systemd itself reads them back."""

import shutil
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import quotes

ODD = ["a b", "%n", "100%", "$HOME", "${HOME}", "$$", '"', "'", "\\", "\\n", "a\\", ";", "é", "", "-x", "+x", "#", "*"]
BROKEN = ["a\nb", "a\rb", "\0", "\x1b[1m", "\x85", "\u2028", "\udcff"]


@pytest.mark.parametrize("value", BROKEN)
@pytest.mark.parametrize("function", [quotes.escape_text, quotes.quote_argument, quotes.check_program])
def test_what_no_quotes_can_hold_is_refused(function, value):
    with pytest.raises(quotes.Unquotable, match="expected"):
        function("/bin/" + value)


@pytest.mark.parametrize(
    "path",
    [
        "",
        "roscore",
        "./roscore",
        "+/bin/sh",
        "-/bin/sh",
        "@/bin/sh",
        "!/bin/sh",
        "/bin/",
        "/a b",
        "/a%n",
        "/a$b",
        '/a"',
    ],
)
def test_a_program_is_an_absolute_plain_path(path):
    with pytest.raises(quotes.Unquotable, match="expected an absolute path"):
        quotes.check_program(path)


def test_a_plain_value_stays_as_it_is():
    assert quotes.check_program("/opt/ros/noetic/bin/roscore") == "/opt/ros/noetic/bin/roscore"
    assert quotes.quote_argument("wlan0.100") == "wlan0.100"
    assert quotes.escape_text("ROS master of 50% of tibi") == "ROS master of 50%% of tibi"


@pytest.mark.parametrize(("value", "expected"), [("a b", '"a b"'), ("%$", '"%%$$"'), ('"\\', '"\\"\\\\"'), ("", '""')])
def test_an_argument_is_quoted(value, expected):
    assert quotes.quote_argument(value) == expected


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd reads the units")
def test_systemd_takes_a_unit_with_odd_arguments(tmp_path):
    unit = tmp_path / "odd.service"
    words = " ".join(quotes.quote_argument(value) for value in ODD)
    unit.write_text(f"[Unit]\nDescription={quotes.escape_text('100% odd')}\n[Service]\nExecStart=/bin/echo {words}\n")
    verdict = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False)
    assert "odd.service" not in verdict.stderr, verdict.stderr
