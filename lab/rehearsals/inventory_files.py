# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads a user's inventory without its secrets: nothing of it is changed, and no password is asked for.

Ansible reads a folder of links to the inventory's files, in which encrypted ones are missing.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from machines.layout import plain_environment, read_inventory
from machines.podman import ROOT, LabError

ENCRYPTED = b"$ANSIBLE_VAULT"
VARIABLE_FOLDERS = ("group_vars", "host_vars")  # that Ansible reads next to an inventory that is a file
NOT_READ = {".git", ".work", ".venv", "__pycache__"}
PLAY = Path(__file__).parents[1] / "plays" / "read_inventory.yml"
SECONDS = 300.0


@dataclass(frozen=True)
class Inventory:
    """An inventory as it was read."""

    listing: dict[str, Any]  # the output of `ansible-inventory --list`: names and values, templates as they are
    values: dict[str, Any]  # the values of the robots, computed (plays/action_plugins/fleet_values.py), or `problems`
    encrypted: tuple[str, ...]  # files that were left aside


def read(inventory: Path, work: Path, options: Iterable[str]) -> Inventory:
    """Read an inventory; `work` is a folder of ours."""
    if not inventory.exists():
        raise LabError(f"The inventory {inventory} does not exist; expected a folder or a file: correct INVENTORY.")
    links = work / "read"
    shutil.rmtree(links, ignore_errors=True)
    encrypted = tuple(_link_files(inventory.resolve(), links))
    source = links if inventory.is_dir() else links / inventory.name
    if not source.exists():
        raise LabError(f"The inventory {inventory} is encrypted as a whole; expected hosts that can be read.")
    try:
        return Inventory(read_inventory(source), _values(source, work / "values.json", options), encrypted)
    except LabError as problem:
        raise LabError(
            str(problem).replace(str(links), str(inventory if inventory.is_dir() else inventory.parent))
        ) from None
    finally:
        shutil.rmtree(links, ignore_errors=True)


def _link_files(inventory: Path, links: Path) -> Iterator[str]:
    """Make the folder of links; yields the encrypted files."""
    base = inventory if inventory.is_dir() else inventory.parent
    tops = [inventory] if inventory.is_dir() else [inventory, *(base / name for name in VARIABLE_FOLDERS)]
    links.mkdir(parents=True)
    for path in (path for top in tops for path in _files(top)):
        name = path.relative_to(base)
        with path.open("rb") as file:
            if file.read(len(ENCRYPTED)) == ENCRYPTED:
                yield str(name)
                continue
        (links / name).parent.mkdir(parents=True, exist_ok=True)
        (links / name).symlink_to(path)


def _files(top: Path) -> Iterator[Path]:
    if top.is_file():
        yield top
    for folder, folders, names in os.walk(top, followlinks=True):
        folders[:] = sorted(name for name in folders if name not in NOT_READ)
        yield from (path for path in (Path(folder, name) for name in sorted(names)) if path.is_file())


def environment() -> dict[str, str]:
    """For Ansible: the checkout's configuration, and nothing of the caller's."""
    return {**plain_environment(), "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg")}


def _values(source: Path, path: Path, options: Iterable[str]) -> dict[str, Any]:
    path.unlink(missing_ok=True)
    words = {"rehearsal_options": list(options), "rehearsal_path": str(path)}
    done = subprocess.run(
        [Path(sys.executable).with_name("ansible-playbook"), "-i", source, PLAY, "-e", json.dumps(words)],
        cwd=ROOT,
        env={**environment(), "ANSIBLE_NOCOLOR": "1", "ANSIBLE_LOCALHOST_WARNING": "0"},
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    if not path.exists():
        said = " ".join((done.stderr.strip() or done.stdout).split())[-2000:]
        raise LabError(f"Ansible cannot read the inventory {source}: {said}")
    found: dict[str, Any] = json.loads(path.read_text())
    path.unlink()
    return found
