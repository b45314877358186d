# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sentences about users without the variables of a set-up file of ROS. `multimaster_info` has read its owner."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from .._base.plain_text import quote
from .environment import OF_PERSONS


def list_warnings(host: str, chosen: Mapping[str, Any], shells: str = "all") -> Iterator[str]:
    """Yield a sentence for each thing that root, other users or all users do not get. `chosen` is the ROS of the machine.

    `shells`: the variables that they are to get; those who are to get less miss nothing.
    """
    setup, person, doubt = quote(chosen["setup"]), quote(chosen.get("person", "*")), quote(chosen.get("doubt", ""))
    variables = chosen.get("environment", {})
    withheld = set(variables) - set(chosen.get("for_root", variables))
    if shells != "all":
        pass  # no person's shell is to get the variables of the set-up file
    elif doubt:
        below = chosen.get("below", "")
        rest = f"those of {quote(below)}" if below else "the collection's own only, such as ROS_MASTER_URI"
        others = (
            f"the services and the user {person} get them; root and other users get {rest}"
            if person
            else f"the services get them; root and all users get {rest}, and source the file themselves if they need it"
        )
        yield (
            f"{host}: root gets no variables of the set-up file {setup}, since {doubt}; expected files and folders that only root can "
            f"change: {others}. Install the workspace as root (for example to /opt) if root or all users need it."
        )
    elif withheld:
        yield (
            f"{host}: the set-up file {setup} sets {', '.join(map(quote, sorted(withheld)))}, which root does not get; expected "
            "variables of ROS, with paths that only root can change: set others in root's own profile, if root needs them."
        )
    if chosen.get("hooks_doubt") and shells != "none":
        yield (
            f"{host}: no hook of catkin is written {quote(chosen['hooks_doubt'])}; expected a folder that only root can change: a shell that "
            "reads no profile (zsh, cron) and sources this set-up file has no ROS_MASTER_URI of the fleet: set it there."
        )
    if chosen.get("left_out"):  # services do not get them either
        yield (
            f"{host}: the set-up file {setup} sets {', '.join(map(quote, chosen['left_out']))}, which nobody gets; expected variables of ROS, and "
            'absolute folders without ; $ " and \\ in lists: set variables that make programs run foreign code only for the programs that need them.'
        )
    if moved := [name for name in OF_PERSONS if name in variables]:
        yield (
            f"{host}: the set-up file {setup} sets {', '.join(moved)}, which the services of the collection do not get, and persons do; expected the "
            "ones of their units there: nothing is to be done."
        )
