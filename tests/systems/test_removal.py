# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A program that has a lab is ended by signals at any moment: nothing of the lab is left, while it is made, used or removed.

REMOVALS=<number> tries so many moments. They are drawn from the seed that is in the name of the test.
"""

import os
import random
import signal
import subprocess
import sys
import time

import pytest
from machines import containers
from machines.layout import hosts_of, read_inventory
from machines.podman import ROOT, list_labelled

INVENTORY = ROOT / "inventory" / "single_computer"
SEED, FEW, MANY = 25, 8, 100
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
HAS_A_LAB = """
import sys, time
from pathlib import Path
from machines import containers
from machines.layout import hosts_of, read_inventory
with containers.remove_at_end(sys.argv[1]):
    containers.bring_up(sys.argv[1], hosts_of(read_inventory(Path(sys.argv[2]))))
    time.sleep(0.3)
"""
PATHS = {**os.environ, "PYTHONPATH": f"{ROOT}/lab:{os.environ.get('PYTHONPATH', '')}"}
PATIENCE = 120.0  # seconds until a program has ended that was told to


@pytest.fixture
def lab(request):
    name = request.config.getoption("--lab")
    with containers.remove_at_end(name):
        yield name


def left(lab):
    """All that there is of the lab."""
    found = [entry["Names"][0] for entry in list_labelled("container", containers.label(lab))]
    found += [entry["name"] for entry in list_labelled("network", containers.label(lab))]
    return found + [str(path) for path in containers.SHARED.glob(f"{containers.CHECKOUT}-{lab}")]


def begun(*words):
    """A program in a session of its own, as from a terminal of its own; what it says is its own affair."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, *map(str, words)], cwd=ROOT, start_new_session=True, env=PATHS, **quiet)


def told(process, draw, length):
    """Send one signal or two at drawn moments, to the program alone or to all of its group as Ctrl+C does; returns what was done."""
    done = []
    for pause in [draw.uniform(0, length), draw.uniform(0, 0.6)][: draw.choice((1, 2, 2))]:
        number, to = draw.choice(SIGNALS), draw.choice((os.kill, os.killpg))
        done.append(f"{number.name} by {to.__name__} after {pause:.3f} s")
        time.sleep(pause)
        if process.poll() is None:
            to(process.pid, number)
    process.wait(PATIENCE)
    return ", then ".join(done)


@pytest.mark.parametrize(
    ("seed", "count"),
    [pytest.param(SEED, FEW, id=f"{SEED}"), pytest.param(SEED + 1, MANY, id=f"{SEED + 1}", marks=pytest.mark.costly)],
)
def test_nothing_is_left_of_a_lab_whenever_its_program_is_ended(lab, seed, count):
    words = ("-c", HAS_A_LAB, lab, INVENTORY)
    began = time.monotonic()
    assert begun(*words).wait(PATIENCE) == 0
    length = time.monotonic() - began
    draw = random.Random(seed)
    for number in range(int(os.environ.get("REMOVALS", count))):
        process = begun(*words)
        done = told(process, draw, length)
        assert left(lab) == [], f"{number}: {done} of {length:.1f} s"


def test_a_removal_that_is_told_to_end_removes_all_first(lab):
    """`lab.py down`, as `make lab-down` and the tests run it. It counts once it has begun, some tenths of a second after its start."""
    draw = random.Random(SEED)
    for number in range(int(os.environ.get("REMOVALS", FEW)) // 4):
        containers.bring_up(lab, hosts_of(read_inventory(INVENTORY)))
        process = begun("lab/lab.py", "down", "--name", lab)
        while process.poll() is None and len(list_labelled("container", containers.label(lab))) == 2:
            time.sleep(0.02)
        done = told(process, draw, 0.5)
        assert left(lab) == [], f"{number}: {done}"
