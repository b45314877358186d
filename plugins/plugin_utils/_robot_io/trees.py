# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The text files below folders of the controller, as managed_files takes them."""

from __future__ import annotations

import hashlib
import os
import pathlib
import re
from collections.abc import Mapping
from typing import Any

from ansible.errors import AnsibleError

COLLECTION = pathlib.Path(__file__).resolve().parents[3]


def read_trees(bundle: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of managed_files, each tree replaced by its files. Raises AnsibleError."""
    files = list(bundle.get("files") or ())
    for part in bundle.get("trees") or ():
        left_out = re.compile(part.get("left_out") or "$^")
        tree = read_tree(str(COLLECTION / part["folder"]), part["destination"])
        files += [file for file in tree if not left_out.search(file["path"])]
    return {**{name: value for name, value in bundle.items() if name != "trees"}, "files": files}


def is_skipped(name: str) -> bool:
    """Return True if a file or folder of this name is byte code, hidden, or an editor's."""
    return name == "__pycache__" or name.startswith((".", "#")) or name.endswith((".pyc", ".pyo", "~"))


def read_tree(source: str, destination: str, content: bool = True) -> list[dict[str, str]]:
    """Return the text files below a folder as path, content or sha256, and mode, sorted. Raises AnsibleError with a sentence."""
    if not os.path.isdir(source):
        raise AnsibleError(
            f"file_tree: {source!r} is no folder of the controller; give the folder of the files to read."
        )
    if not destination.startswith("/") or destination.startswith("//") or os.path.normpath(destination) != destination:
        raise AnsibleError(
            f"file_tree: the destination {destination!r} is no absolute, plain folder; expected for example /opt/x."
        )
    files = []
    for folder, folders, names in os.walk(source):
        folders[:] = [name for name in folders if not is_skipped(name)]
        for name in names:
            path = os.path.join(folder, name)
            if is_skipped(name) or not os.path.isfile(path):
                continue
            files.append(
                {
                    "path": os.path.join(destination, os.path.relpath(path, source)),
                    **({"content": _text(path)} if content else {"sha256": _digest(path)}),
                    "mode": "0755" if os.stat(path).st_mode & 0o100 else "0644",
                }
            )
    return sorted(files, key=lambda file: file["path"])


def _text(path: str) -> str:
    # With newline="", line ends stay as they are.
    try:
        with open(path, encoding="utf-8", newline="") as stream:
            return stream.read()
    except UnicodeDecodeError as problem:
        raise AnsibleError(
            f"file_tree: {path} is no UTF-8 text ({problem.reason} at byte {problem.start}); take it out of the folder."
        ) from problem
    except OSError as problem:
        raise AnsibleError(f"file_tree: {path} cannot be read ({problem.strerror}).") from problem


def _digest(path: str) -> str:
    return hashlib.sha256(_text(path).encode()).hexdigest()
