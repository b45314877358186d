# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""master_discovery as a whole, in a network namespace: what others hear of it, systemd is told, and people are shown."""

import os
import pathlib
import subprocess
import sys

import pytest
from running_discovery import STORIES

pytestmark = pytest.mark.whole

HERE = pathlib.Path(__file__).parent
NODES = HERE.parents[2] / "roles/nodes/files/python"
NAMESPACE = ["unshare", "--map-root-user", "--net"]


def has_namespaces():
    try:
        subprocess.run([*NAMESPACE, "ip", "link"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return False
    return True


@pytest.mark.skipif(not has_namespaces(), reason="needs unshare and ip, and network namespaces for this user")
@pytest.mark.parametrize("story", STORIES)
def test_the_program_in_a_network(story, tmp_path):
    done = subprocess.run(
        [*NAMESPACE, sys.executable, str(HERE / "running_discovery.py"), story, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": f"{NODES}:{HERE}"},
        timeout=120,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
