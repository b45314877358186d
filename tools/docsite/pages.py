# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pages of the site: those of the tree, with links that hold there.

A page keeps its path, so most links between pages stay as they are. A link to a role or a module leads to its page of the
reference, and one to any other file of the tree to the repository.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

INDEX = "docs/README.md"  # the pages of each shelf
FRONT = "README.md"  # becomes the first page of the site
REFERENCE = "reference"  # the folder for the output of antsibull-docs
#: The pages outside of docs, in the order of the site.
OUTSIDE = ("CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "MAINTAINERS.md", "SECURITY.md", "CHANGELOG.rst")

_SHOWN = re.compile(r"docs/(?:[\w-]+/)*[\w-]+\.(?:md|png|svg|json)")
_CODE = re.compile(r"(^ *```.*?^ *```$|`[^`\n]+`)", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"(\]\()([^()\s]+)(\))|(^\[[^\]]+\]: )(\S+)", re.MULTILINE)
_SHELF = re.compile(r"^## (.+)$", re.MULTILINE)
_PLUGIN = re.compile(r"plugins/(modules|filter|lookup)/(\w+)\.py")
_ROLE = re.compile(r"roles/(\w+)(?:/README\.md)?")


@dataclass(frozen=True)
class Tree:
    """The files that git has, and the address of the repository."""

    names: frozenset[str]
    repository: str

    @property
    def folders(self) -> frozenset[str]:
        return frozenset(str(folder) for name in self.names for folder in PurePosixPath(name).parents)

    def list_shown(self) -> list[str]:
        """The files that the site has as they are, but for their links."""
        return sorted(name for name in self.names if name in OUTSIDE or _SHOWN.fullmatch(name))

    def find_page(self, target: str) -> str | None:
        """The file of the site for a file or folder of the tree, if it has one."""
        if target == FRONT:
            return "index.md"
        if target == "docs":
            return INDEX
        if role := _ROLE.fullmatch(target):
            return f"{REFERENCE}/{role[1]}_role.rst"
        if plugin := _PLUGIN.fullmatch(target):
            return f"{REFERENCE}/{plugin[2]}_{plugin[1].removesuffix('s').replace('modules', 'module')}.rst"
        return target if target in OUTSIDE or _SHOWN.fullmatch(target) else None

    def turn_link(self, page: str, link: str) -> str:
        """A link of a page as it is on the site."""
        path, mark, anchor = link.partition("#")
        if not path or re.match(r"[a-z]+:", link):
            return link
        target = os.path.normpath(os.path.join(os.path.dirname(page), path))
        found = self.find_page(target)
        if found is None:
            kind = "tree" if target in self.folders else "blob"
            return f"{self.repository}/{kind}/main/{target}{mark}{anchor}"
        return os.path.relpath(found, os.path.dirname(page) or ".") + mark + anchor

    def turn_page(self, page: str, text: str) -> str:
        """The text of a page of Markdown, with its links; code stays as it is."""

        def turn(found: re.Match[str]) -> str:
            if found[1]:
                return found[1] + self.turn_link(page, found[2]) + found[3]
            return found[4] + self.turn_link(page, found[5])

        # After a split by a group, every second piece is code.
        parts = _CODE.split(text)
        return "".join(part if number % 2 else _LINK.sub(turn, part) for number, part in enumerate(parts))


def list_shelves(index: str) -> Iterator[tuple[str, list[str]]]:
    """The shelves of the index, and the pages of docs on each."""
    heads = list(_SHELF.finditer(index))
    ends = [head.start() for head in heads[1:]] + [len(index)]
    for head, end in zip(heads, ends):
        links = [found[2] for found in _LINK.finditer(index[head.end() : end]) if found[2]]
        yield head[1], [f"docs/{link}" for link in links if not link.startswith("..")]


def write_contents(shelves: Iterable[tuple[str, Sequence[str]]]) -> str:
    """The table of contents of the site, for the end of its first page."""
    lists = [("", [INDEX]), *shelves, ("Reference", [f"{REFERENCE}/index.rst"]), ("The project", list(OUTSIDE))]

    def write_list(caption: str, pages: Sequence[str]) -> str:
        names = "".join(f"{os.path.splitext(page)[0]}\n" for page in pages)
        title = f":caption: {caption}\n" if caption else ""
        return f"\n```{{toctree}}\n:hidden:\n:maxdepth: 1\n{title}\n{names}```\n"

    return "".join(write_list(caption, pages) for caption, pages in lists)
