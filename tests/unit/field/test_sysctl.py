# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Kernel settings in files as people have them: which line decides at boot is predicted, and systemd-sysctl is the judge."""

import os
import pathlib
import subprocess
import tempfile

import field
import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import boot
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import plan as sysctl
from hypothesis import given
from hypothesis import strategies as st

DROP_IN = "etc/sysctl.d/90-rosfleet-multimaster.conf"
SYSTEMD_SYSCTL = "/lib/systemd/systemd-sysctl"
SETTINGS = sysctl.settings_of(
    [
        {"name": "net.ipv4.ip_forward", "value": "1"},
        {"name": "net.ipv4.icmp_echo_ignore_broadcasts", "value": "0"},
        {"name": "net.ipv4.conf.all.arp_ignore", "value": "3"},
    ]
)
KEYS = [setting.key for setting in SETTINGS]
PLACES = st.sampled_from(
    [
        f"{folder}/{name}.conf"
        for folder in ("etc/sysctl.d", "usr/lib/sysctl.d", "run/sysctl.d")
        for name in ("10-a", "89-b", "91-c", "99-sysctl")
    ]
)
TREES = st.dictionaries(PLACES, field.mixtures("sysctl", most=3), max_size=4)


def plant(root, tree):
    for name, content in {**tree, DROP_IN: sysctl.drop_in_text(SETTINGS).encode()}.items():
        path = pathlib.Path(root, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    init = pathlib.Path(root, "sbin/init")
    init.parent.mkdir()
    init.symlink_to("/lib/systemd/systemd")


@pytest.mark.slow
@given(tree=TREES)
@field.tries()
def test_the_line_that_is_told_to_decide_says_so(tree):
    with tempfile.TemporaryDirectory() as root:
        plant(root, tree)
        found = boot.find_boot_assignments(boot.Tree(root), KEYS)
        assert all(found[key] is not None for key in KEYS)  # our own file sets each of them
        for key, decides in found.items():
            content = pathlib.Path(root + decides.file).read_bytes().decode("utf-8", "surrogateescape")
            line = content.split("\n")[decides.line - 1].strip()
            name, equals, value = line.lstrip("-").partition("=")
            assert boot.matches(boot.key_of(name.strip()), key)
            assert (value.strip() if equals else None) == decides.value


READ = """
set -e
mount --make-rprivate /
for folder in etc run usr/lib/sysctl.d; do mkdir -p "$1/$folder"; mount --bind "$1/$folder" "/$folder"; done
%s || true
shift
for key; do tr '\\t\\n' '  ' <"/proc/sys/$key"; echo; done
"""


@pytest.mark.slow
@pytest.mark.root
@pytest.mark.skipif(os.geteuid() != 0 or not os.path.exists(SYSTEMD_SYSCTL), reason="needs root and systemd")
@given(tree=TREES)
@field.tries(0.4)
def test_systemd_sysctl_sets_what_was_predicted(tree):
    """Each one on a computer of its own (a network and mount namespace), whose values are read from the kernel."""
    with tempfile.TemporaryDirectory() as root:
        plant(root, tree)
        found = boot.find_boot_assignments(boot.Tree(root), KEYS)
        words = ["unshare", "--net", "--mount", "sh", "-c", READ % SYSTEMD_SYSCTL, "sh", root, *KEYS]
        held = subprocess.run(words, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
        for key, now in zip(KEYS, held.splitlines(), strict=True):
            decides = found[key]
            if decides.value is None:  # a line that excludes the key: it keeps what the kernel begins with
                continue
            wanted = boot.read_value(decides.value, now)
            assert boot.normal(now) == wanted or not wanted.lstrip("-").isdigit(), (key, decides, now)
