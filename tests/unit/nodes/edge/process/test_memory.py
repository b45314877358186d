# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of the C library that threads took is given back."""

import pathlib
import subprocess
import sys

import pytest

NODES = pathlib.Path(__file__).parents[5] / "roles/nodes/files/python"
SCRIPT = """
import sys, threading
from rosfleet_multimaster.edge.process import memory
if sys.argv[1] == "set":
    memory.give_back()

def work(ready, go):
    large = [bytearray(100_000) for _count in range(200)]  # below the size that goes back at once
    kept = bytearray(100_000)
    ready.wait()
    del large
    go.wait()

ready, go = threading.Barrier(9), threading.Event()
threads = [threading.Thread(target=work, args=(ready, go)) for _number in range(8)]
for thread in threads:
    thread.start()
ready.wait()
print(len([line for line in open("/proc/self/maps") if line.rstrip().endswith("[heap]")]) and
      sum(1 for line in open("/proc/self/maps") if line.split()[1] == "---p"))
go.set()
"""


def pools(how):
    """The reserved parts of address space, of which each pool of a thread has one."""
    words = [sys.executable, "-c", SCRIPT, how]
    return int(subprocess.run(words, cwd=NODES, stdout=subprocess.PIPE, check=True, encoding="utf-8").stdout)


@pytest.mark.skipif(not hasattr(__import__("ctypes").CDLL(None), "mallopt"), reason="this is no glibc")
def test_threads_share_one_pool():
    assert pools("set") < pools("not set")
