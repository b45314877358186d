# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Controllers with other versions of ansible-core: their packages from PyPI, and the Python that runs them.

A version for a newer Python than that of this machine runs in a container of Debian 13's image, which sees this checkout
and the sockets of the lab under their own paths, and no network.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / ".work" / "matrix"
sys.path.insert(0, str(ROOT / "lab"))

from machines import image  # noqa: E402
from machines.containers import SHARED  # noqa: E402
from machines.podman import LabError  # noqa: E402
from machines.podman import environment as podman_environment  # noqa: E402
from rehearsals.inventory_files import plain_environment  # noqa: E402

SUITE, PYTHON = "trixie", "3.13"  # the release of Debian whose image runs new versions, and its Python
LIMIT = 600.0  # seconds for a playbook
NEWEST = "newest"


@dataclass(frozen=True)
class Controller:
    """One version of ansible-core."""

    line: str  # such as 2.16, or NEWEST
    in_image: bool  # it runs in a container

    @property
    def packages(self) -> Path:
        """The folder of its packages."""
        return WORK / f"core-{self.line}"

    @property
    def version(self) -> str:
        """The version that is installed."""
        (found,) = metadata.distributions(name="ansible-core", path=[str(self.packages)])
        return found.version

    @property
    def python(self) -> str:
        """The version of its Python."""
        return PYTHON if self.in_image else ".".join(platform.python_version_tuple()[:2])

    def install(self) -> None:
        """Install it from PyPI, in its newest release."""
        shutil.rmtree(self.packages, ignore_errors=True)
        wanted = "ansible-core" if self.line == NEWEST else f"ansible-core=={self.line}.*"
        kinds = [f"manylinux_2_{number}_{platform.machine()}" for number in (17, 28, 34)]
        # pip compares a package with the Python that it runs on itself, also where it installs for another one.
        foreign = [
            *(f"--platform={kind}" for kind in kinds),
            *("--platform=any", f"--python-version={PYTHON}", "--ignore-requires-python"),
        ]
        words = [
            "--no-compile",
            "--only-binary=:all:",
            *(foreign if self.in_image else []),
            "--target",
            str(self.packages),
            wanted,
        ]
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise LabError(f"ansible-core {self.line} cannot be installed: {' '.join(done.stderr.split())[-1000:]}")

    def play(self, inventories: Sequence[Path], playbook: str, log: Path) -> tuple[int, str]:
        """Run a playbook: its exit status and its output, which is added to a log."""
        program = str(self.packages / "bin" / "ansible-playbook")
        words = [program, *(word for path in inventories for word in ("-i", str(path))), playbook]
        settings = {
            "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
            "ANSIBLE_NOCOLOR": "1",
            "PYTHONPATH": str(self.packages),
            "LC_ALL": "C.UTF-8",
        }
        command = _make_container_command(settings, words) if self.in_image else [_find_python(), *words]
        with log.open("a") as stream:
            stream.write(f"\n$ {' '.join(command)}\n")
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=podman_environment() if self.in_image else {**plain_environment(), **settings},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LIMIT,
            check=False,
        )
        with log.open("a") as stream:
            stream.write(done.stdout)
        return done.returncode, done.stdout


def _find_python() -> str:
    """Return this Python without the packages of its environment, of which ansible-core is one."""
    return os.path.realpath(sys.executable)


def _make_container_command(settings: dict[str, str], words: Sequence[str]) -> list[str]:
    """Return the command for a container that ends with the playbook."""
    folders = [ROOT, SHARED]
    return [
        *("podman", "run", "--rm", "--network=none", f"--workdir={ROOT}"),
        *(f"--volume={folder}:{folder}" for folder in folders),
        *(f"--env={name}={value}" for name, value in settings.items()),
        image.ensure(SUITE, full=False),
        "/usr/bin/python3",
        *words,
    ]


def write_connection(path: Path, controller: Controller) -> Path:
    """Write the connections of a lab for a controller: in a container, another Python hands over the sockets."""
    if not controller.in_image:
        return path
    inventory = json.loads(path.read_text())
    for variables in inventory["all"]["hosts"].values():
        options = variables["ansible_ssh_common_args"].replace(sys.executable, "/usr/bin/python3")
        variables["ansible_ssh_common_args"] = options
    other = path.with_name("hosts-in-image.yml")
    other.write_text(json.dumps(inventory, indent=2) + "\n")  # JSON is YAML
    return other
