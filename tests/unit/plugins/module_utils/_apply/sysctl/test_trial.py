# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The kernel's own reading of values, asked in an empty network namespace; the module's own use of it is in test_run.py."""

import pathlib
import shutil
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import trial
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl.kernel import Kernel

KEYS = ("net/ipv4/ip_default_ttl", "net/ipv4/conf/lo/arp_ignore", "net/ipv4/tcp_congestion_control", "kernel/pid_max")


@pytest.fixture
def kernel():
    kernel = Kernel()
    if not trial.try_values(kernel, {KEYS[0]: "7"}):
        pytest.skip("needs the right to make a network namespace")
    return kernel


def test_nothing_of_this_machine_changes(kernel):
    before = {key: kernel.read(key) for key in KEYS}
    wanted = {KEYS[0]: "7", KEYS[1]: "3", KEYS[2]: "nosuch", KEYS[3]: "1"}
    # A name that the kernel may have a module for, and a key outside of net, are not known.
    assert trial.try_values(kernel, wanted) == {KEYS[0]: ("7", 0), KEYS[1]: ("3", 0)}
    assert {key: kernel.read(key) for key in KEYS} == before


def test_no_module_of_the_kernel_is_loaded_for_a_value(kernel):
    loaded = pathlib.Path("/proc/modules").read_text() if pathlib.Path("/proc/modules").exists() else ""
    trial.try_values(kernel, {KEYS[2]: "bbr"})
    assert (pathlib.Path("/proc/modules").read_text() if loaded else "") == loaded


def test_without_a_namespace_nothing_is_known(kernel):
    if shutil.which("setpriv") is None:
        pytest.skip("needs setpriv")
    program = (
        "import resource, sys\n"
        "from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import trial\n"
        "from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl.kernel import Kernel\n"
        "print(trial.try_values(Kernel(), {'net/ipv4/ip_default_ttl': '7'}))\n"
    )
    words = [
        "unshare",
        "--user",
        "--map-root-user",
        "sh",
        "-c",
        'echo 0 >/proc/sys/user/max_user_namespaces && exec "$@"',
        "sh",
    ]
    done = subprocess.run([*words, sys.executable, "-c", program], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"needs a user namespace with a limit: {done.stderr}")
    assert done.stdout == "{}\n"
