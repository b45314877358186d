# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The content of a bundle: the plan of the fleet, observations, versions, and the last lines of the logs. Pure.

`reading.py` is the other direction.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping
from typing import Any

from .._base.plain import to_plain
from .._verify.report.run import Run
from .anonymous import Anonymous
from .reading import ABOUT, FORMAT, OBSERVATIONS, PLAN
from .secrets import ROOM, Secrets, list_texts

LOGS = 2_000_000  # letters of all logs
ANSWERS = 4_000_000  # letters of different texts in the answers of all computers; secrets.ROOM of one
LOG = 60_000  # of one computer
README = """\
This is a record of a fleet by `verify` of the Ansible collection rosfleet.multimaster {collection}, {time}.

report.html         the faults, for people; report.json is the same as data
about.json          versions, of this computer and of each computer of the fleet
plan.json           the planned fleet
observations.json   the measurements of each computer
logs/               the last lines of the services of the collection, for each computer

Passwords, keys and tokens were taken out if they could be recognised: by their names, their form, or because a variable of the
inventory has them. {names}Topics and services of the robots are listed by name. Read it before you give it to others.

The same findings, without a robot: ansible-playbook rosfleet.multimaster.report -e bundle=FILE
"""
KEPT = "Names and addresses are those of the fleet. "
REPLACED = "Names of robots and computers, users and addresses were replaced by others. "


def remove_secrets(run: Run, secrets: Secrets) -> Run:
    """Return a run without secrets. Its cost is bounded, whatever computers answer: bounds come first."""
    # Twice as much is looked at as is kept: a name may precede its secret.
    logs = {name: secrets.text(text) for name, text in _cut_logs(run.logs, 2).items()}
    fleet = secrets.data(run.fleet)
    answers = {name: (seen, run.machines.get(name, {})) for name, seen in run.observations.items()}
    sizes = {name: sum(map(len, list_texts(to_plain(list(answer))))) for name, answer in answers.items()}
    clean, left = {}, ANSWERS
    for done, name in enumerate(sorted(sizes, key=lambda name: sizes[name])):  # who says little has room for all of it
        share = secrets.room = min(ROOM, left // (len(sizes) - done))
        clean[name] = secrets.data(answers[name])
        left -= share - secrets.room
    return dataclasses.replace(
        run,
        fleet=fleet,
        observations={name: clean[name][0] for name in run.observations},
        machines={name: clean[name][1] for name in run.machines if name in clean},
        logs=_cut_logs(logs),
    )


def rename(run: Run, aliases: Mapping[str, list[str]], users: set[str]) -> Run:
    """Return a run with new names and addresses."""
    known = json.dumps(to_plain([run.fleet, run.observations]))
    other = Anonymous(run.fleet, aliases, users, [known, *run.logs.values()])
    return dataclasses.replace(
        run,
        fleet=other.data(run.fleet),
        observations=other.data(run.observations),
        machines=other.data(run.machines),
        logs=other.data(run.logs),
        about={**run.about, "names": "replaced"},
    )


def write_files(run: Run, page: str, document: Mapping[str, Any]) -> dict[str, str]:
    """Return the files of a bundle, by name."""
    about = {"format": FORMAT, **run.about, "computers": dict(run.machines)}
    names = REPLACED if run.about.get("names") else KEPT
    logs = {f"logs/{re.sub(r'[^A-Za-z0-9._-]', '_', name)}.txt": text for name, text in run.logs.items() if text}
    return {
        "README.txt": README.format(collection=run.about["collection"], time=run.about["time"], names=names),
        ABOUT: _json(about),
        PLAN: _json(to_plain(run.fleet)),
        OBSERVATIONS: _json(to_plain(run.observations)),
        "report.json": _json(document),
        "report.html": page,
        **logs,
    }


def _json(value: Any) -> str:
    return json.dumps(value, indent=1, ensure_ascii=False) + "\n"


def _cut_logs(logs: Mapping[str, str], times: int = 1) -> dict[str, str]:
    """Cut logs to their last lines, so that all logs have room; to so many times as much as is kept of them."""
    most = times * min(LOG, LOGS // max(1, len(logs)))
    return {name: text if len(text) <= most else _share_room(text, most) for name, text in logs.items()}


def _share_room(text: str, most: int) -> str:
    """Share the room among the services of a computer. A service with little text keeps all of it."""
    parts = re.split(r"^(?=== )", text, flags=re.MULTILINE)
    kept, room = dict.fromkeys(range(len(parts)), ""), most
    for done, number in enumerate(sorted(kept, key=lambda number: len(parts[number]))):
        kept[number] = _cut_part(parts[number], room // (len(parts) - done))
        room -= len(kept[number])
    return "".join(kept.values())


def _cut_part(part: str, most: int) -> str:
    """Keep the heading and the last lines."""
    if len(part) <= most:
        return part
    heading, _end_of_line, lines = part.partition("\n")
    left = most - len(heading) - 1
    if left <= 0:
        return ""
    _broken_line, _end_of_line, whole_lines = lines[-left:].partition("\n")
    return f"{heading}\n{whole_lines}"
