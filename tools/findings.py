# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Write the pages of the findings, docs/findings, out of the table of faults and the lab's catalogue.

With `--check` nothing is written; a page that is not the generated one is an error.
"""

from __future__ import annotations

import pathlib
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import (
    ALWAYS,
    HANDS,
    INVENTORY,
    READ,
    Advices,
    Fault,
    Key,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.foreseen import PREDICTED, WATCHED
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.kinds import KINDS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.table import AREAS, TABLE
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.commands import LASTING, WAYS

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs/findings"
CATALOGUE = ROOT / "tests/faults/catalogue"
HEAD = """\
<!--
SPDX-FileCopyrightText: rosfleet contributors
SPDX-License-Identifier: GPL-3.0-or-later
-->
<!-- generated from plugins/plugin_utils/_faults and tests/faults/catalogue by `make findings` -->
"""
SEEN = {READ: "a value, or concluded", "": "a value, followed packets, or concluded"}


def read_examples() -> Mapping[Key, Sequence[tuple[str, str]]]:
    """Return the faults of the lab by the finding that is to be named first: title, and the command that makes it."""
    found = defaultdict(list)
    for path in sorted(CATALOGUE.glob("*.yml")):
        fault = yaml.safe_load(path.read_text(encoding="utf-8"))
        kind, _space, mode = fault["parts"][0].partition(" ")
        (where, command), *_more = fault["inject"][0].items()
        found[kind, mode].append((fault["title"], f"{where}: {command}"))
    return found


def write_index() -> str:
    """Return the page with all ids."""
    lines = [
        HEAD,
        "# The findings, by id",
        "",
        "`verify`, `predict` and the watch name a fault by an id. It never changes its meaning.",
        "",
        "- **Do** changes something; each command has its place. A finding that is only inferred has no Do.",
        "- **Look** is for a fault that stays after Do. It changes nothing.",
        "- **Seen** names the evidence. A fault is *concluded* if nobody could look there, and it explains the failed checks best.",
        "- **In the lab** has the command that made the fault in a lab of containers, in which this finding was the first one.",
        "",
        "`ansible-playbook rosfleet.multimaster.report -e bundle=bundle.zip -e explain=2` says why the second finding of a bundle was made.",
        "",
    ]
    for digit, area in AREAS.items():
        lines += [f"## {area[0].upper()}{area[1:]}", ""]
        for kind, rows in groupby(list_area(digit), key=lambda row: row[0][0]):
            ids = (f"{mode} [{fault.id}]({digit}xx.md#{fault.id.lower()})" for (_kind, mode), fault in rows)
            lines.append(f"- `{kind}`: {', '.join(ids)}")
        lines.append("")
    return "\n".join(lines)


def list_area(digit: str) -> list[tuple[Key, Fault]]:
    """List the rows of an area by their ids."""
    rows = [(key, fault) for key, fault in TABLE.items() if fault.id[3] == digit]
    return sorted(rows, key=lambda row: row[1].id)


def fill(fault: Fault) -> str:
    """Return the sentence with placeholders."""
    words = dict.fromkeys(("found", "expected", "hop", "traffic"), "...")
    return escape(fault.sentence.format(place=" and ".join(fault.at), what=fault.what or "...", **words))


def escape(text: str) -> str:
    """Return a text that Markdown shows as it is."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def write_area(digit: str, examples: Mapping[Key, Sequence[tuple[str, str]]]) -> str:
    """Return the page of an area."""
    lines = [HEAD, f"# RF-{digit}xx: {AREAS[digit]}", "", "[All ids, and how to read this](README.md)", ""]
    for kind, rows in groupby(list_area(digit), key=lambda row: row[0][0]):
        lines += [f"## `{kind}`", "", KINDS[kind], "", *(list_makers() if kind == "filter" else ())]
        for key, fault in rows:
            lines += [*write_fault(key, fault, examples.get(key, ())), ""]
    return "\n".join(lines)


def list_makers() -> Iterator[str]:
    """Yield the table of the rules that let the packets of a network pass, by the program that makes the rules of a packet filter."""
    yield from ("Once for each of the robots' networks, such as `192.168.1.0/24`:", "")
    yield from (f"| rules of | {' | '.join(WAYS)} |", f"|---|{'---|' * len(WAYS)}")
    for maker, rules in LASTING.items():
        cells = (f"`{rules[way].format('NETWORK')}`" if way in rules else "" for way in WAYS)
        yield f"| {maker} | {' | '.join(cells)} |"
    nft = (
        f"`nft insert rule inet TABLE CHAIN ip {'daddr' if way == 'out' else 'saddr'} NETWORK accept`" for way in WAYS
    )
    yield from (f"| nftables | {' | '.join(nft)} |", "")
    yield from (
        "Rules of Docker and nftables end with the next boot: write that of nftables into `/etc/nftables.conf`, too.",
        "",
    )


def write_fault(key: Key, fault: Fault, examples: Sequence[tuple[str, str]]) -> Iterator[str]:
    """Yield the lines about a fault."""
    yield from (f"### {fault.id}", "", f"**{fill(fault)}** (`{' '.join(key)}`)", "")
    yield f"- **Seen**: {write_evidence(key, fault)}"
    for word, advices in (("Do", fault.do), ("Look", fault.look)):
        lines = list(write_advices(fault, advices))
        if len(lines) == 1:
            yield f"- **{word}**: {lines[0]}"
        else:
            yield from (f"- **{word}**:", *(f"  {number}. {line}" for number, line in enumerate(lines, 1)))
    for title, command in examples[:1]:
        yield f"- **In the lab**: {title}"
        yield from ("", "  ```", *(f"  {line}" for line in command.splitlines()), "  ```")


def write_evidence(key: Key, fault: Fault) -> str:
    """Return how a fault is seen. The reason of a cost is for who works on the table."""
    return fault.why if fault.read == ALWAYS or key[0] in (PREDICTED, WATCHED) else SEEN[fault.read]


def write_advices(fault: Fault, advices: Advices) -> Iterator[str]:
    """Yield a line for each advice."""
    for one in fault.fill(advices, fault.at, ""):
        effect = f" ({escape(one.effect)})" if one.effect else ""
        if one.where in (HANDS, INVENTORY):
            begin = "in the inventory: " if one.where == INVENTORY else ""
            yield f"{begin}{escape(one.text)}{effect}"
        else:
            yield f"on {one.where}: `{one.text}`{effect}"


def main() -> int:
    examples = read_examples()
    pages = {"README.md": write_index(), **{f"{digit}xx.md": write_area(digit, examples) for digit in AREAS}}
    different = []
    FOLDER.mkdir(exist_ok=True)
    for name, page in pages.items():
        path, text = FOLDER / name, page.rstrip("\n") + "\n"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            different.append(name)
            if "--check" not in sys.argv[1:]:
                path.write_text(text, encoding="utf-8")
    if different and "--check" in sys.argv[1:]:
        print(f"docs/findings: {', '.join(different)}: not made of the table of today; run `make findings`.")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
