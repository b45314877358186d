# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Several concerns of a computer in one run of a module, each as its own module carries it out.

While a change waits for its confirmation, only the concerns that could cut the controller off are changed. The second run,
which confirms, does the others. A concern that fails ends the run: earlier ones stay, and waiting changes are taken back.
"""

import time
import typing

from ..._base import deadlines, ends
from ..._base.module import validate_options
from ..._base.problem import Problem
from ..._machine import shells
from ..transaction import lock
from ..transaction.module import Concern, Fields, run_locked
from .concerns import Options

_SHELLS_LIMIT = 20.0  # seconds until shells have given their variables
SHELLS = dict(
    variables=dict(type="dict", default={}),
    before=dict(type="dict", default={}),
    files=dict(type="list", elements="str", default=[]),
    exports=dict(type="list", elements="str", default=[]),
    notes=dict(type="list", elements="str", default=[]),
    reach=dict(type="str", choices=["all", "names", "none"], default="all"),
)


class ConcernModule:
    """A replacement for the AnsibleModule of one concern."""

    def __init__(self, module: typing.Any, concern: Concern, options: Options) -> None:
        """Read the options. Raises Problem if they are wrong."""
        self.concern = concern
        self.params = validate_options(concern.name, options, concern.specification)
        self.check_mode, self._diff, self.warn = module.check_mode, module._diff, module.warn
        self.backup_local = module.backup_local
        self.guard = concern.make_guard(self)


def carry_out(
    module: typing.Any,
    requests: typing.Sequence[typing.Tuple[Concern, Options]],
    read_back: bool = False,
) -> None:
    """Carry out all concerns in their order, read the values in shells if that is asked for, and end the module."""
    try:
        parts = [ConcernModule(module, concern, options) for concern, options in requests]
    except Problem as problem:
        return ends.fail(module, f"{problem} Nothing was changed.")
    folders = [] if module.check_mode else [part.params["records"] for part in parts]
    try:
        with lock.hold(folders, "multimaster_computer") as unlocked:
            return _carry_out(module, parts, unlocked, read_back)
    except Problem as problem:
        return ends.fail(module, str(problem))


def _carry_out(
    module: typing.Any, parts: typing.Sequence[ConcernModule], unlocked: typing.List[str], read_back: bool
) -> None:
    """Carry out all concerns within one lock, and end the module."""
    results: typing.List[typing.Tuple[str, Fields]] = []
    differences: typing.List[typing.Any] = []
    began = time.monotonic()
    for part in parts:
        if not part.concern.guarded and any(result.get("unconfirmed") for _name, result in results):
            break  # the run that confirms does the rest
        # What waits already must not be taken back while this run goes on: the controller cannot confirm it before.
        _wait_at_this_pace(parts, results, time.monotonic() - began)
        result = run_locked(part, part.concern.make, part.guard, unlocked)
        if result.get("changed"):
            unlocked = []  # said once
        entry = result.pop("diff", [])
        differences += entry if isinstance(entry, list) else [entry]
        results.append((part.concern.name, result))
        if result.get("failed") or result.get("same_connection"):
            break
    _wait_at_this_pace(parts, results, time.monotonic() - began)
    reading = _read_shells(results) if read_back and not module.check_mode else {}
    return _end(module, parts, results, [entry for entry in differences if entry["before"] != entry["after"]], reading)


def _wait_at_this_pace(
    parts: typing.Sequence[ConcernModule], results: typing.Sequence[typing.Tuple[str, Fields]], took: float
) -> None:
    """Let the changes that wait for a confirmation wait as long as a run of so many seconds needs."""
    if not any(result.get("failed") for _name, result in results):
        for part in parts:
            part.guard.wait_at_this_pace(took)


def _end(
    module: typing.Any,
    parts: typing.Sequence[ConcernModule],
    results: typing.Sequence[typing.Tuple[str, Fields]],
    differences: typing.List[typing.Any],
    reading: Fields,
) -> None:
    """End the module with the results of all concerns that were begun, and with the variables of shells then."""
    last = results[-1][1] if results else {}
    groups: typing.Dict[str, typing.List[Fields]] = {}
    for name, result in results:
        groups.setdefault(name, []).append(result)
    whole = {
        "changed": any(result["changed"] for _name, result in results if "changed" in result),
        "concerns": groups,
        "diff": differences,
    }
    if last.get("failed"):
        others = [part.guard for part in parts if part.concern.guarded and part is not parts[len(results) - 1]]
        sentences = [last["msg"], *filter(None, (guard.give_up() for guard in others))]
        return ends.fail(module, " ".join(sentences), rolled_back=last.get("rolled_back", False), **whole)
    return ends.leave(
        module,
        unconfirmed=any(result.get("unconfirmed") for _name, result in results),
        confirm_within=max((part.guard.waits_for for part in parts), default=0),
        same_connection=bool(last.get("same_connection")),
        msg=" ".join(result["msg"] for _name, result in results) or "Nothing was asked for.",
        **whole,
        **reading,
    )


def _read_shells(results: typing.Sequence[typing.Tuple[str, Fields]]) -> Fields:
    """Read the environment of shells after files were written; empty after a failure."""
    written = any(name == "managed_files" and result.get("changed") for name, result in results)
    if not written or results[-1][1].get("failed"):
        return {}
    try:
        return {"shells": deadlines.call_within(_SHELLS_LIMIT, shells.probe)}
    except Exception:  # a strange machine may raise anything: then the environment of shells is not known
        return {"shells": dict(shells.NOTHING_SEEN)}
