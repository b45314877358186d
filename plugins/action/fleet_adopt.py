# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_adopt: facts of machines that were set up by hand in, an inventory for them out."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from typing import Any

from ..plugin_utils._adopt import facts, write
from ..plugin_utils._adopt.infer import propose
from ..plugin_utils._adopt.proposal import Proposal
from ..plugin_utils._base.plain_text import LINE, plain, plain_data, quote
from ..plugin_utils._inventory import read
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal, fail_plainly


class ActionModule(FleetAction):
    """Writes an inventory of machines that already run."""

    _VALID_ARGS = frozenset(("machines", "machine", "path"))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the files of the inventory."""
        hostvars = task_vars["hostvars"]
        names = [str(name) for name in args.get("machines") or ()]
        path = os.path.abspath(os.path.expanduser(str(args.get("path") or "")))
        _check_options(args.get("path"), path, names)
        machines, unread = _read_machines(names, hostvars, str(args.get("machine")))
        proposal = propose(machines, unread)
        if not proposal.robots:
            return fail_plainly(_explain_no_robot(proposal), left_out=_list_left_out(proposal))
        files = write.files(proposal, {name: _read_variables(hostvars, name) for name in names})
        if not self._task.check_mode:
            try:
                _write_folder(path, files)
            except OSError as problem:
                raise Refusal(
                    f"{path} cannot be written ({problem.strerror}); expected a folder of yours: choose another one with adopt_inventory."
                ) from None
        problems, left_out = _find_problems(proposal), _list_left_out(proposal)
        changes = [
            {"before": "", "after": text, "before_header": f"{path}/{name}", "after_header": f"{path}/{name}"}
            for name, text in files.items()
        ]
        return {
            "changed": True,
            "path": path,
            "files": files,
            "guesses": [plain(text, LINE) for text in proposal.guesses()],
            "left_out": left_out,
            "problems": problems,
            "msg": _summarize(path, proposal, bool(self._task.check_mode)),
            "warnings": [*problems, *left_out, *_list_unanswered(names, hostvars, str(args.get("machine")))],
            **({"diff": changes} if self._task.diff else {}),
        }


def _check_options(option: Any, path: str, names: list[str]) -> None:
    """Raise Refusal if no inventory can be written."""
    if not option:
        raise Refusal(
            "The option path is empty; expected a folder for the inventory, such as inventory-adopted: set adopt_inventory."
        )
    if not names:
        raise Refusal(
            "The list of machines is empty: found no host in the inventory; expected the machines of all robots, one host each: "
            "give a file with them to -i."
        )
    if os.path.lexists(path) and (os.path.islink(path) or not os.path.isdir(path) or os.listdir(path)):
        raise Refusal(
            f"{path} is there and is not an empty folder; expected a new folder, so that nothing of yours is replaced: choose "
            "another one with adopt_inventory."
        )


def _read_machines(
    names: list[str], hostvars: Mapping[str, Any], variable: str
) -> tuple[list[facts.FoundMachine], dict[str, str]]:
    """Return the machines, and machine -> reason for those that could not be read."""
    machines, unread = [], {}
    for name in names:
        info = plain_data(hostvars[name].get(variable) or {})
        if not info or info.get("unreachable") or info.get("failed"):
            unread[name] = _explain_failure(info)
            continue
        try:
            machines.append(facts.read_machine(name, info))
        except facts.StrangeMachine as problem:
            unread[name] = str(problem)
    return machines, unread


def _list_unanswered(names: list[str], hostvars: Mapping[str, Any], variable: str) -> list[str]:
    """List the parts of machines that could not be read: the inventory lacks what they would have said."""
    found = {name: (hostvars[name].get(variable) or {}).get("problems") for name in names}
    return [
        plain(
            f"{name}: {quote(text, LINE)}; expected an answer, since the inventory lacks what it says: run it again.",
            LINE,
        )
        for name, problems in found.items()
        for text in (problems if isinstance(problems, (list, tuple)) else ())[: facts.MOST]
    ]


def _explain_failure(info: Mapping[str, Any]) -> str:
    message = plain(info.get("msg") or "it was not looked at").rstrip(".")
    return f"it cannot be reached ({message})" if info.get("unreachable") else f"it could not be read ({message})"


def _read_variables(hostvars: Any, name: str) -> dict[str, Any]:
    """Return the variables of a machine in the list, as they are written. Of an encrypted one only its name is returned."""
    host = hostvars._inventory.get_host(name)
    variables: dict[str, Any] = {}
    for group in sorted(host.get_groups(), key=lambda group: (group.depth, group.priority, group.name)):
        variables.update(group.vars)
    variables.update(host.vars)
    return {key: value if isinstance(value, (str, int, float)) else "a secret" for key, value in variables.items()}


def _list_left_out(proposal: Proposal) -> list[str]:
    return [plain(f"{name}: left out, since {why}.", LINE) for name, why in sorted(proposal.left_out.items())]


def _find_problems(proposal: Proposal) -> list[str]:
    """Return the sentences with which site.yml would refuse the inventory."""
    try:
        read.read_fleet(proposal.inventory())
    except read.InventoryProblems as problems:
        return [plain(text, LINE) for text in problems.problems]
    return []


def _explain_no_robot(proposal: Proposal) -> str:
    why = " ".join(_list_left_out(proposal)[:3])
    return (
        f"No robot was found on {len(proposal.left_out)} machines; expected a running roscore, or a ROS_MASTER_URI in the files that "
        f"shells read, on at least one of them: start the robots as usual, and run this again. {why}"
    )


def _summarize(path: str, proposal: Proposal, check: bool) -> str:
    router = ", a router" if proposal.router else ""
    left_out = f", {len(proposal.left_out)} of the machines left out" if proposal.left_out else ""
    return (
        f"{'Would write' if check else 'Wrote'} {path}: {len(proposal.robots)} robots with {len(proposal.computers)} computers{router}"
        f"{left_out}; {len(proposal.guesses())} comments to read. Next: ansible-playbook -i {path} rosfleet.multimaster.site --check --diff"
    )


def _write_folder(path: str, files: Mapping[str, str]) -> None:
    """Write the folder as a whole: it is there with all files, or not at all."""
    parent = os.path.dirname(path)
    os.makedirs(parent, exist_ok=True)
    folder = tempfile.mkdtemp(prefix=".adopt-", dir=parent)
    try:
        for name, text in files.items():
            target = os.path.join(folder, name)
            os.makedirs(os.path.dirname(target), exist_ok=True)
            with open(target, "w", encoding="utf-8") as stream:
                stream.write(text)
        os.chmod(folder, 0o755)
        os.rename(folder, path)  # also over an empty folder
    except BaseException:  # also if a text has no UTF-8, or the run is interrupted
        shutil.rmtree(folder, ignore_errors=True)
        raise
