# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A computer that is merely busy: 75 busy processes for each processor, for three minutes, cost no service.

One that is frozen beside them is ended within a minute. HOGS and SECONDS choose other numbers.
"""

import os
import time
from pathlib import Path

import pytest
from subject import lab_of

ROOT = Path(__file__).resolve().parents[2]

HOST = "kobuki1computer"
SERVICES = ("roscore", "discovery", "connections", "sync", "watchdog")
HOGS = int(os.environ.get("HOGS", str(75 * len(os.sched_getaffinity(0)))))
SECONDS = int(os.environ.get("SECONDS", "180"))
# Each wants a processor, and memory of its own. They end by themselves.
HOG = f"""
import os, time
end = time.monotonic() + {SECONDS + 120}
for number in range({HOGS} - 1):
    if not os.fork():
        break
kept = bytearray(os.urandom(1 << 20))
while time.monotonic() < end:
    kept[:] = kept[::-1]
"""


@pytest.fixture(scope="module", name="lab")
def _lab():
    with lab_of("long-busy", ROOT / "inventory" / "single_computer") as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        yield found


def processes(lab):
    """The process of each service, and how often systemd has started it again."""
    units = " ".join(f"multimaster-{name}.service" for name in SERVICES)
    shown = lab.run(HOST, f"systemctl show -p MainPID -p NRestarts -p ActiveState --value {units}").split("\n\n")
    return dict(zip(SERVICES, (tuple(block.split()) for block in shown), strict=True))


def test_a_busy_computer_loses_no_service(lab):
    lab.run(HOST, "cat > /tmp/hog.py", stdin=HOG)
    before = processes(lab)
    assert {state for _pid, _restarts, state in before.values()} == {"active"}
    lab.start(HOST, "hogs", "python3 /tmp/hog.py")
    began = time.monotonic()
    try:
        while time.monotonic() < began + SECONDS:
            time.sleep(20)
            loads, asked = lab.run(HOST, "cat /proc/loadavg").split()[0], time.monotonic()
            lab.run(HOST, "timeout 120 rostopic list >/dev/null")
            print(f"\nload {loads}; rostopic list took {time.monotonic() - asked:.1f} s", end="")
            assert processes(lab) == before, lab.run(HOST, "journalctl -b -u 'multimaster-*' --lines 100")
        lab.run(HOST, f"kill -STOP {before['discovery'][0]}")
        frozen = time.monotonic()
        while processes(lab)["discovery"][0] == before["discovery"][0]:
            assert time.monotonic() - frozen < 60, "a frozen one is ended within a minute, also here"
            time.sleep(1)
        print(f"\na frozen discovery was ended after {time.monotonic() - frozen:.1f} s")
    finally:
        lab.stop(HOST, "hogs")
    now = processes(lab)
    assert {name: now[name] for name in SERVICES if name != "discovery"} == {
        name: before[name] for name in SERVICES if name != "discovery"
    }
    said = lab.run(HOST, "journalctl -b -u multimaster-watchdog.service --output cat")
    assert said.count(" hangs, and is ended") == 1 and "it is stopped" in said
