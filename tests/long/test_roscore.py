# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A thousand kills of the roscore at random moments, under churn: nothing is lost, and no dead node comes back.

KILLS and KILL_SEED choose fewer, and another order.
"""

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "lab"))

import containers  # noqa: E402
from subject import lab_of  # noqa: E402

LAB, HOST = "long-roscore", "kobuki1computer"
KILLS = int(os.environ.get("KILLS", "1000"))
SEED = os.environ.get("KILL_SEED", str(random.randrange(10**6)))
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
    for name in ("killed_roscore.py", "all_sorts.py"):
        lab.run(HOST, f"cat > /tmp/{name}", stdin=(ROOT / "lab/nodes" / name).read_text())
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
