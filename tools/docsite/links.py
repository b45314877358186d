# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The links of the site that was built: each one within it leads to a file, and to a place in that file.

Sphinx looks only at the links of pages. Here is all that a browser gets: menus, pictures, and the files of the theme, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

_OUT = re.compile(r"[a-z]+:|//")


class _Page(HTMLParser):
    """The names of the places of a page, and its links."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.places: set[str] = {""}
        self.links: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and tag != "meta" and value:
                self.places.add(value)
            elif name in ("href", "src") and value:
                self.links.add(value)


def find_lost_links(folder: Path) -> Iterator[str]:
    """The faults of links within the site, a sentence for each."""
    pages = {path.resolve(): _Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    for path, page in pages.items():
        for link in sorted(page.links):
            if _OUT.match(link):
                continue
            written, place = urldefrag(link)
            name = path.relative_to(folder.resolve())
            target = (path.parent / unquote(written.partition("?")[0])).resolve() if written else path
            if not target.is_file():
                yield f"{name}: {link} leads to a file that is not there"
            elif target in pages and unquote(place) not in pages[target].places:
                yield f"{name}: {link} leads to a place that the page does not have"


def count_pages(folder: Path) -> int:
    return sum(1 for _path in folder.rglob("*.html"))
