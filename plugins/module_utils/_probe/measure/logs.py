# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The last lines that services of the collection wrote to the journal, as plain text and with bounds."""

import typing

from ..._base.commands import run
from ..._base.plain_text import LINE, plain

MOST = 1000  # lines of a service
_LIMIT = 20.0  # seconds for all of one service: a journal of gigabytes on a slow card


def last_lines(service: str, lines: int) -> typing.Tuple[typing.List[str], str]:
    """Read the last lines of a service with their times, and give the reason if the lines are missing."""
    command = ["journalctl", "--no-pager", "--quiet", "--no-hostname", "--output=short-iso", "--all"]
    answer = run([*command, f"--lines={lines}", f"--unit=multimaster-{service}.service"], limit=_LIMIT)
    if answer.status != 0:
        return [], plain(answer.error or f"journalctl ended with {answer.status}")
    return [plain(line, LINE) for line in answer.text.splitlines()[-2 * lines :]], ""
