# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Write RETURN of the modules that measure, made of the contract (plugins/module_utils/_contract).

Ansible needs it as a literal in the file. It is for people: each key, and one level below it with the first
sentence of each field. All sentences and examples are in the contract.
With `--check` nothing is written; a section that is not the generated one is an error.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from textwrap import indent
from typing import Any

import yaml
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.answers import ANSWERS
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.fields import (
    Field,
    Struct,
    find_struct,
    make_sample,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.documentation import SECTION, make_kind

MODULES = Path(__file__).resolve().parents[1] / "plugins" / "modules"
SENTENCE = re.compile(r"(?<=\.) (?=[A-Z])")
WIDTH = 108  # of a line, about: a long word goes beyond


def fill(module: str, text: str) -> str:
    """Return the text of a module with its RETURN."""
    section = "".join(_write_key(name, entry) for part in ANSWERS[module] for name, entry in part.FIELDS.items())
    return SECTION.sub(lambda _found: f'RETURN = r"""\n{section}"""', text, count=1)


def _write_key(name: str, entry: Field) -> str:
    lines = [f"{name}:\n"]
    lines += [indent(_dump({key: value}, flow=False), "  ") for key, value in _describe(entry).items()]
    struct = find_struct(entry.kind)
    sample = None if struct else make_sample(entry)
    if isinstance(sample, list) and sample and isinstance(sample[0], dict):
        lines.append("  sample:\n" + "".join(indent(f"- {_indent_rest(_dump(each))}", "    ") for each in sample))
    elif sample is not None:
        lines.append(f"  sample: {_indent_rest(_dump(sample), 4)}")
    if struct is not None:
        lines.append("  contains:\n" + "".join(_write_fields(struct)))
    return "".join(lines)


def _write_fields(struct: type[Struct]) -> Iterator[str]:
    for name, entry in struct.FIELDS.items():
        yield f"    {name}: {_indent_rest(_dump(_shorten(_describe(entry))), 6)}"


def _shorten(described: Mapping[str, str]) -> Mapping[str, str]:
    """Return a description with its first sentence, and without the condition that is the rule."""
    first = SENTENCE.split(described["description"], maxsplit=1)[0]
    kept = {name: text for name, text in described.items() if (name, text) != ("returned", "always")}
    return {**kept, "description": first}


def _describe(entry: Field) -> Mapping[str, str]:
    kind = make_kind(entry.kind)
    elements = {"elements": kind.each.type} if kind.type == "list" and kind.each else {}
    added = {"version_added": entry.added} if entry.added else {}
    return {"description": entry.text, **added, "returned": entry.returned, "type": kind.type, **elements}


def _dump(value: Any, flow: bool = True) -> str:
    text: str = yaml.safe_dump(value, sort_keys=False, default_flow_style=flow, width=WIDTH, allow_unicode=True)
    return text.removesuffix("...\n")


def _indent_rest(text: str, columns: int = 2) -> str:
    first, _end, rest = text.partition("\n")
    return f"{first}\n{indent(rest, ' ' * columns)}"


def main() -> None:
    """Write the sections that are not as the contract, or with --check name them. Ends with 1 then."""
    stale = []
    for module in ANSWERS:
        path = MODULES / f"{module}.py"
        text = path.read_text(encoding="utf-8")
        if fill(module, text) != text:
            stale.append(path.name)
            if "--check" not in sys.argv:
                path.write_text(fill(module, text), encoding="utf-8")
    if "--check" in sys.argv and stale:
        raise SystemExit(f"RETURN of {', '.join(stale)} is not as the contract: run `make copies`.")


if __name__ == "__main__":
    main()
