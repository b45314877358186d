# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Builds the collection out of the files that git knows, and compares what is in it with the reviewed list.

python tools/shipped.py            writes tests/unit/shipped.txt: look at its difference before you commit it
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
LIST = ROOT / "tests" / "unit" / "shipped.txt"


def clean_tree(folder: Path) -> None:
    """Copy the files that git knows, or would know, as they are now; links stay links."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        if os.path.lexists(ROOT / name):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)


def build(tree: Path, target: Path) -> Path:
    """Build the collection of a tree; return the archive."""
    program = Path(sys.executable).with_name("ansible-galaxy")
    command = [str(word) for word in (program, "collection", "build", "--output-path", target, tree)]
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
    """Write the list."""
    with tempfile.TemporaryDirectory() as folder:
        tree, target = Path(folder, "tree"), Path(folder, "target")
        tree.mkdir()
        clean_tree(tree)
        LIST.write_text("".join(f"{name}\n" for name in content(build(tree, target))))


if __name__ == "__main__":
    main()
