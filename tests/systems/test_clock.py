# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A robot's clock that steps, as at the first answer of a time server: ten seconds back, an hour forward.

Containers share the machine's clock, which nobody here touches: libfaketime gives every program of one computer another one.
"""

import time

import pytest
from setups.links import Watch, wait_until
from subject import three_robots

NAME = "systems-clock"
COMPUTERS = ("ana-pc", "bob-pc", "cid-pc")
UNITS = "multimaster-roscore multimaster-discovery multimaster-sync"
LIBRARY = "/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1"
# The steady clock is what it is, and a step is seen at once. The manager gives this to every service.
SETTINGS = "FAKETIME_DONT_FAKE_MONOTONIC=1 FAKETIME_NO_CACHE=1"
# Debian 12's libfaketime (0.9.10) then makes Python's time.sleep fail: its clock_nanosleep counts from the wrong clock.
SLEEP = """import time; time.sleep = lambda seconds: __import__("select").select([], [], [], seconds)"""


@pytest.fixture(scope="module")
def lab():
    """bob's programs, old and new ones, have a clock that can be set."""
    with three_robots(NAME) as found:
        found.run("bob-pc", "cat >/usr/lib/python3/dist-packages/sleep.pth", stdin=SLEEP)
        found.run("bob-pc", f"echo +0 >/etc/faketimerc; echo {LIBRARY} >/etc/ld.so.preload")
        found.run("bob-pc", f"systemctl set-environment {SETTINGS}; systemctl restart {UNITS}")
        yield found


@pytest.fixture(scope="module")
def watches(lab):
    """bob and ana talk before any step."""
    found = {host: Watch(lab, host) for host in COMPUTERS}
    talk(lab, "before")
    return found


def talk(lab, word):
    """A new topic of each of the two is heard by the other."""
    for here, there in (("ana", "bob"), ("bob", "ana")):
        words = f"{here}_{word} +/{here}/{word} /{there}/{word}"
        lab.start(f"{here}-pc", word, f"python3 {{script}} {words}", "programs/chatter.py")
    for here in ("ana", "bob"):
        wait_until(lambda here=here: lab.output(f"{here}-pc", word), 60, f"{here} hears what is new")


def running(lab):
    """Process ids, and how often systemd has started something again."""
    return lab.run("bob-pc", f"systemctl show --property=MainPID,NRestarts {UNITS}")


def is_ahead(seconds, look):
    """True where `look` returns a time that a clock tells which is so many seconds ahead of the machine's."""
    before = time.time()
    told = look()
    return before + seconds <= told <= time.time() + seconds


@pytest.mark.parametrize(("word", "step", "seconds"), [("back", "-10", -10), ("forward", "+1h", 3600)])
def test_a_step_of_the_clock_ends_nothing_and_loses_nothing(lab, watches, word, step, seconds):
    before, since = running(lab), time.monotonic()
    lab.run("bob-pc", f"echo {step} >/etc/faketimerc")
    assert is_ahead(seconds, lambda: float(lab.run("bob-pc", "date +%s.%N")))
    assert "libfaketime" in lab.run(
        "bob-pc", "cat /proc/$(systemctl show --value --property=MainPID multimaster-sync)/maps"
    )
    time.sleep(8)  # longer than it takes to call a robot lost: nothing may happen in this time
    talk(lab, word)
    assert running(lab) == before
    assert {host: watch.removals(since) for host, watch in watches.items()} == dict.fromkeys(COMPUTERS, [])
    for here in ("ana", "bob"):  # and what was there goes on
        assert any(at > since + 8 for at, _text in lab.output(f"{here}-pc", "before"))


def test_discovery_tells_the_new_time(lab):
    """The stamps are of the clock that was set, or the step would not have reached the nodes."""
    code = "import xmlrpc.client as x; print(x.ServerProxy('http://bob-pc:11611').masterInfo()[0])"
    # The stamp is that of the last change in the roscore, which discovery sees at its next look: so something changes.
    before = time.time()
    lab.start("bob-pc", "after", "python3 {script} bob_after +/bob/after", "programs/chatter.py")

    def stamp():
        return float(lab.run("ana-pc", f'python3 -c "{code}"'))

    wait_until(lambda: before + 3600 <= stamp() <= time.time() + 3600, 60, "a stamp of the new clock")
