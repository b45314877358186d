# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Labs of virtual machines for the tests in this folder: with a kernel and udev of their own."""

import base64
import contextlib
import os
import subprocess
import sys
import time
import zlib
from pathlib import Path

import pytest
from machines import virtual
from machines.podman import ROOT
from subject import Lab


class Machines(Lab):
    """The machines of a lab, and playbooks and modules against them."""

    patience = 1800  # a machine without KVM is slow

    def __init__(self, name, hosts, inventory=None):
        """`inventory`: that of the hosts, where playbooks are run."""
        self.name = name
        virtual.bring_up(name, hosts)
        self.connection = virtual.write_inventory(name, hosts)
        self.inventory = inventory or self.connection
        for host in hosts:
            self.set_clock(host.name)

    def run(self, host, command, check=True, stdin=None, timeout=120):
        """Run a shell command as root over a console, and return what it printed."""
        if stdin is not None:
            self.write(host, "/run/stdin", stdin)
            command = f"(\n{command}\n) </run/stdin"
        return virtual.run(self.name, host, command, check=check, timeout=timeout)

    def write(self, host, path, text):
        """Write a file. A line of a console has 4095 bytes at most."""
        packed = base64.b64encode(zlib.compress(text.encode())).decode()
        for start in range(0, len(packed), 2000):
            virtual.run(self.name, host, f"printf %s {packed[start : start + 2000]} >>{path}.packed")
        unpack = f"import base64, zlib; open('{path}', 'wb').write(zlib.decompress(base64.b64decode(open('{path}.packed').read())))"
        virtual.run(self.name, host, f'python3 -c "{unpack}"; rm {path}.packed')

    def set_carrier(self, host, interface, up):
        """Plug a cable in, or pull it."""
        virtual.set_carrier(self.name, host, interface, up)

    def reboot(self, host):
        """Let a machine reboot, and wait for it."""
        virtual.reboot(self.name, host)
        self.set_clock(host)

    def set_clock(self, host):
        """Set the clock of a machine: its kernel read whole seconds at boot, so two machines may be a second apart."""
        self.run(host, f"date -s @{time.time():.3f} >/dev/null")

    @contextlib.contextmanager
    def controller(self, program, *words):
        """A run of ansible or ansible-playbook, whose process the block gets; at its end all of it is killed."""
        # A namespace ends with its first process: workers of ansible are in sessions of their own, and would go on.
        words = [Path(sys.executable).with_name(program), "-i", self.inventory, "-i", self.connection, *words]
        with subprocess.Popen(
            ["unshare", "--pid", "--fork", "--kill-child", *words],
            cwd=ROOT,
            env={**os.environ, "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg")},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process:
            try:
                yield process
            finally:
                process.kill()


@contextlib.contextmanager
def machines_of(name, hosts, inventory=None):
    """The machines of a lab until the end of the block."""
    with virtual.remove_at_end(name):
        yield Machines(name, hosts, inventory)


@pytest.fixture(scope="session")
def new_machines():
    """A function that makes a lab by its name and hosts."""
    return machines_of
