# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A thousand kills of the roscore at random moments, under churn: nothing is lost, and no dead node comes back.

And a hundred thousand calls that anybody may make, out of a seed: each start is quick, and living nodes stay registered.
KILLS and KILL_SEED, CALLS and CALL_SEED choose fewer, and others.
"""

import json
import os
import random
import subprocess
from pathlib import Path

import pytest
from machines import containers
from subject import lab_of

ROOT = Path(__file__).resolve().parents[2]

LAB, HOST = "long-roscore", "kobuki1computer"
KILLS = int(os.environ.get("KILLS", "1000"))
SEED = os.environ.get("KILL_SEED", str(random.randrange(10**6)))
CALLS, CALL_SEEDS = int(os.environ.get("CALLS", "100000")), os.environ.get("CALL_SEED", "1 2 3 4").split()
EACH = 10  # seconds for one kill, on a busy machine; it takes less than one


@pytest.fixture(scope="module")
def lab():
    with lab_of(LAB, ROOT / "inventory" / "single_computer") as found:
        nodes = ROOT / "roles" / "nodes" / "files"
        into = f"podman exec -i {containers.container(LAB, HOST)} tar -x -C /tmp"
        subprocess.run(["bash", "-o", "pipefail", "-c", f"tar -c -C {nodes} python | {into}"], check=True)
        yield found


def test_nothing_is_lost_and_nothing_comes_back(lab):
    print(f"\nKILL_SEED={SEED}")
    for path in ("tests/long/killed_roscore.py", "lab/nodes/programs/sample_node.py"):
        lab.run(HOST, f"cat > /tmp/{Path(path).name}", stdin=(ROOT / path).read_text())
    command = f"PYTHONPATH=/tmp/python exec python3 /tmp/killed_roscore.py {KILLS} {SEED}"
    done = subprocess.run(
        ["podman", "exec", containers.container(LAB, HOST), "bash", "-lc", command],
        capture_output=True,
        text=True,
        timeout=60 + EACH * KILLS,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    print(found)
    assert found["kills"] == KILLS and found["changes"] > KILLS and found["nodes"] > KILLS / 2


@pytest.mark.parametrize("seed", CALL_SEEDS)
def test_no_call_of_anybody_makes_a_roscore_worse(lab, seed):
    for name in ("hostile_inputs.py", "fuzz_roscore.py"):
        lab.run(HOST, f"cat > /tmp/{name}", stdin=(ROOT / "lab/nodes/hostile" / name).read_text())
    calls = CALLS // len(CALL_SEEDS)
    command = f"PYTHONPATH=/tmp/python:$PYTHONPATH exec python3 /tmp/fuzz_roscore.py {calls} {seed}"
    done = subprocess.run(
        ["podman", "exec", containers.container(LAB, HOST), "bash", "-lc", command],
        capture_output=True,
        text=True,
        timeout=300 + calls // 5,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    print(f"\nseed {seed}: {found}")
    assert found["calls"] > 0.9 * calls and found["refused"] > calls / 100
