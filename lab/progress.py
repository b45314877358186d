# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The words of the lab's programs: a line between the output of tools, and the sentence at a failure."""

import argparse
import sys
from collections.abc import Callable

from machines.podman import LabError


def say(text: str) -> None:
    """Print a line between the output of the tools."""
    print(f"\n== {text}", flush=True)


def carry_out(run: Callable[[argparse.Namespace], None], options: argparse.Namespace) -> int:
    """Run a command of the lab; return the exit status, 1 with one sentence if something failed."""
    try:
        run(options)
    except LabError as error:
        print(f"lab: {error}", file=sys.stderr)
        return 1
    return 0
