# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Builds the collection out of the files that git has, so that nothing else in the folder is shipped.

python tools/package.py FOLDER     writes the archive into the folder

`build_ignore` in galaxy.yml says which of them are for development only.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def list_files() -> list[str]:
    """The files that git has and that are there."""
    command = ["git", "ls-files", "-z", "--cached"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode()
    return sorted(name for name in listed.split("\0") if name and os.path.lexists(ROOT / name))


def copy_tree(folder: Path) -> None:
    """Copy these files as they are now; links stay links."""
    for name in list_files():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)


def build(tree: Path, target: Path) -> Path:
    """Build the collection of a tree; return the archive."""
    program = Path(sys.executable).with_name("ansible-galaxy")
    command = [str(word) for word in (program, "collection", "build", "--force", "--output-path", target, tree)]
    done = subprocess.run(
        command, cwd=tree, capture_output=True, text=True, check=False, env={**os.environ, "LC_ALL": "C.UTF-8"}
    )
    if done.returncode:
        raise SystemExit(f"ansible-galaxy failed: {done.stdout}{done.stderr}")
    return next(target.glob("*.tar.gz"))


def content(archive: Path) -> list[str]:
    """The files in an archive; a link is said to be one."""
    with tarfile.open(archive) as opened:
        return sorted(
            member.name if member.isfile() else f"{member.name} (no file)" for member in opened if not member.isdir()
        )


def main() -> None:
    """Build it, and print the path of the archive."""
    target = Path(sys.argv[1]).absolute()
    with tempfile.TemporaryDirectory() as folder:
        copy_tree(Path(folder))
        print(build(Path(folder), target))


if __name__ == "__main__":
    main()
