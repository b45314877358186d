# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Problems as the result of a task that refuses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ansible import constants
from ansible.release import __version__
from ansible.utils.display import Display

from .._fleet.sentences import number_problems

PRINTS_LINES = (
    2,
    19,
)  # since then Ansible prints the message of a failed task line by line; before, as one line of JSON


def refuse(problems: Sequence[str]) -> dict[str, Any]:
    """Return the result of a task that refuses. Several problems are printed here if Ansible would print them on one line."""
    message = number_problems(problems)
    if len(problems) > 1 and _read_version(__version__) < PRINTS_LINES:
        Display().display(message, color=constants.COLOR_ERROR, stderr=True)
    return {"failed": True, "problems": list(problems), "msg": message}


def _read_version(text: str) -> tuple[int, ...]:
    """Return the first two numbers of a version of ansible-core."""
    return tuple(int(part) for part in text.split(".")[:2])
