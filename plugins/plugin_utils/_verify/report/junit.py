# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The result as JUnit XML, which CI systems read: a test case for each check, with its failures. Pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any
from xml.etree import ElementTree

from ..._base.plain_text import plain
from ..._faults.fault import read_advices
from ..checks.engine import FAILED, OK, UNKNOWN, WARNING
from .history import TIME

LISTED = 100  # results that are listed in a test case


def write_junit(document: Mapping[str, Any]) -> str:
    """Return a suite with a test case for each check. A check with warnings passes; its output has them."""
    checks = document["checks"]
    rows = defaultdict(list)
    for row in document["rows"]:
        if row["verdict"] != OK:
            rows[row["check"], row["verdict"]].append(row)
    suite = ElementTree.Element(
        "testsuite",
        name="rosfleet.multimaster.verify",
        timestamp=_format_time(document.get("time")),
        tests=str(len(checks)),
        failures=str(sum(check[FAILED] > 0 for check in checks)),
        errors="0",
        skipped=str(sum(map(_is_skipped, checks))),
    )
    if document["findings"]:
        _list_properties(suite, document["findings"])
    for check in checks:
        _case(suite, check, rows)
    ElementTree.SubElement(suite, "system-out").text = _text(document["findings"])
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _format_time(moment: object) -> str:
    """Return the time of a run as the schema of JUnit has it: ISO 8601, without a zone. Empty for a text that is no time."""
    try:
        return datetime.strptime(str(moment), TIME).replace(tzinfo=None).isoformat()
    except ValueError:
        return ""


def _case(suite: ElementTree.Element, check: Mapping[str, Any], rows: Mapping[tuple[str, str], Sequence[Any]]) -> None:
    case = ElementTree.SubElement(suite, "testcase", classname="verify", name=f"{check['check']}: {check['title']}")
    name = check["check"]
    if check[FAILED]:
        message = f"{check[FAILED]} of {sum(check[verdict] for verdict in (OK, WARNING, FAILED, UNKNOWN))} failed"
        ElementTree.SubElement(case, "failure", message=message, type=name).text = _list_rows(rows[name, FAILED])
    elif _is_skipped(check):
        ElementTree.SubElement(case, "skipped", message=f"{check[UNKNOWN]} not judged")
    more = [*rows.get((name, WARNING), ()), *rows.get((name, UNKNOWN), ())]
    if more:
        ElementTree.SubElement(case, "system-out").text = _list_rows(more)


def _is_skipped(check: Mapping[str, Any]) -> bool:
    """Return True if no row of a check was judged."""
    return bool(check[UNKNOWN]) and not check[OK] and not check[WARNING] and not check[FAILED]


def _list_rows(rows: Sequence[Mapping[str, Any]]) -> str:
    lines = [
        plain(
            f"{row['verdict']}: {row['observer']}"
            + ("" if row["observer"] == row["target"] else f" to {row['target']}")
            + f": expected {row['expected']}, found {row['found']}",
            500,
        )
        for row in rows[:LISTED]
    ]
    return "\n".join([*lines, f"and {len(rows) - LISTED} more"] if len(rows) > LISTED else lines)


def _list_properties(suite: ElementTree.Element, findings: Sequence[Mapping[str, Any]]) -> None:
    """Name the ids of the findings, each with its place, and the page of each id."""
    properties = ElementTree.SubElement(suite, "properties")
    for entry in findings[:LISTED]:
        ElementTree.SubElement(properties, "property", name="finding", value=plain(f"{entry['id']} {entry['place']}"))
    for page in dict.fromkeys(entry["page"] for entry in findings[:LISTED]):
        ElementTree.SubElement(properties, "property", name="page", value=page)


def _text(findings: Sequence[Mapping[str, Any]]) -> str:
    return "\n".join(plain(line, 500) for entry in findings for line in _list_lines(entry))


def _list_lines(entry: Mapping[str, Any]) -> list[str]:
    """List the lines of a finding: its sentence, the remedy, and the commands to look with."""
    advices = [(word, one.sentence) for word in ("do", "look") for one in read_advices(entry[word])]
    return [f"{entry['verdict']}: {entry['id']}: {entry['sentence']}", *(f"  {word}: {text}" for word, text in advices)]
