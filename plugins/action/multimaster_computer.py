# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_computer: the concerns of a computer in one run of the module, or in two. The second run confirms the first."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from typing import Any

from ..plugin_utils._base.features import FEATURES
from ..plugin_utils._plan.environment import SEEN, find_differences
from ..plugin_utils._robot_io import trees
from ..plugin_utils._robot_io.concerns import UnknownTag, choose_concerns
from ..plugin_utils._robot_io.confirmation import GuardedAction, Result, seconds_of, wait_of
from ..plugin_utils._robot_io.refusal import fail_plainly

# The concerns that can cut the controller off. If one of them waits for its confirmation, the others wait, too.
GUARDED = ("sysctl", "routes", "firewall", *(feature.guarded for feature in FEATURES if feature.guarded))
REST = 600.0  # seconds for the other concerns, which start services

Args = Mapping[str, Any]


class ActionModule(GuardedAction):
    """Runs the module. If a change waits, a second run over a new connection confirms it and applies the other concerns."""

    what = "kernel settings, routes, packet filter rules and peers of the tunnel"

    def answer(self, args: Args, task_vars: dict[str, Any]) -> Result:
        """Return the result of all concerns."""
        # Before ansible-core 2.19, a template turns None into an empty text.
        args = {name: options for name, options in args.items() if options not in (None, "")}
        run_tags, skip_tags = (task_vars.get(f"ansible_{kind}_tags") or () for kind in ("run", "skip"))
        try:
            args = choose_concerns(args, run_tags, skip_tags, self._task.tags)
        except UnknownTag as problem:
            return fail_plainly(str(problem))
        if not args:
            return {"changed": False, "msg": "The tags of this run leave out all concerns of this task."}
        if "managed_files" in args:
            args["managed_files"] = [trees.read_trees(bundle) for bundle in args["managed_files"]]
        wanted = args.get("shells")
        if not isinstance(wanted, Mapping):
            return self._apply(args, task_vars)
        args["shells"] = {**wanted, "before": {}, "notes": []}  # the module only reads
        result = self._apply(args, task_vars)
        result["warnings"] = [*result.get("warnings", []), *(wanted.get("notes") or ())]
        return result if self._task.check_mode or result.get("failed") else compare_shells(result, wanted)

    def _apply(self, args: Args, task_vars: dict[str, Any]) -> Result:
        """Return the result of one run, or of two."""
        word = "" if self.cannot_be_cut else secrets.token_hex(8)
        trial, rest = split_concerns(args, word)
        seconds = max((seconds_of(options.get("confirm_within")) for options in trial.values()), default=0)
        if not seconds:
            return self._execute_module(module_args={**trial, **rest}, task_vars=task_vars)
        more = REST if rest else 0.0
        first, reason = self._run_first({**trial, **rest}, seconds, task_vars, more)
        if first and not first.get("unconfirmed"):
            return first
        # The module has left the rest to the run that confirms.
        confirming = {**choose_confirmations(trial, first), **rest}
        return join_results(first, self._run_second(confirming, wait_of(first, seconds), reason, task_vars, more))


def compare_shells(result: Result, wanted: Args) -> Result:
    """Return the result; as a failure if shells do not see the variables that are expected."""
    seen = result["shells"] if "shells" in result else wanted.get("before") or {}
    wrong = find_differences(
        wanted.get("variables") or {},
        {what: seen.get(what) for what in SEEN},
        wanted.get("files") or (),
        wanted.get("exports") or (),
        wanted.get("reach") or "all",
    )
    if not wrong:
        return result
    rest = {name: value for name, value in result.items() if name in ("changed", "diff", "warnings")}
    return {**rest, "failed": True, "msg": " ".join(wrong)}


def split_concerns(args: Args, word: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the concerns that can cut the controller off, each with the word of its confirmation, and the others."""
    trial, rest = {}, {}
    for name, options in args.items():
        if name not in GUARDED or not isinstance(options, Mapping):
            rest[name] = options
        elif word and seconds_of(options.get("confirm_within")):
            trial[name] = {**options, "confirmation": word}
        else:
            trial[name] = {**options, "confirm_within": 0, "confirmation": ""}
    return trial, rest


def choose_confirmations(trial: Args, first: Result) -> dict[str, Any]:
    """Return the options that confirm each waiting concern. Without an answer of the first run, all may wait."""
    concerns = results_of(first) or {name: [{"unconfirmed": True}] for name in trial}
    return {
        name: {**options, "confirm_within": 0}
        for name, options in trial.items()
        if options["confirmation"] and any(one.get("unconfirmed") for one in concerns.get(name, []))
    }


def results_of(answer: Result) -> dict[str, list[Result]]:
    """Return the results of each concern in an answer: any number, since a robot has written it."""
    return {name: [one for one in results or () if one] for name, results in (answer.get("concerns") or {}).items()}


def _mark_confirmed(results: Sequence[Result]) -> list[Result]:
    """Return the results of a concern, those that waited as confirmed; an empty list if no result waited."""
    confirmed = {"unconfirmed": False, "confirmed": True}
    marked = [{**one, **confirmed} if one.get("unconfirmed") else one for one in results]
    return marked if marked != list(results) else []


def join_results(first: Result, second: Result) -> Result:
    """Return the results of both runs as one. The first has the changes; the second has the confirmation and the other concerns."""
    if not first:
        return second
    shown = list(first.get("diff", []))
    trial, later = results_of(first), results_of(second)
    concerns = {**trial, **later}
    for name in trial.keys() & later.keys():
        if not any(one.get("failed") for one in later[name]):
            concerns[name] = _mark_confirmed(trial[name]) or later[name]
    merged = {
        **second,
        "changed": bool(second.get("changed") or (first.get("changed") and not second.get("rolled_back"))),
        "concerns": concerns,
        "diff": shown + [entry for entry in second.get("diff", []) if entry not in shown],
        "warnings": [*first.get("warnings", []), *second.get("warnings", [])],
    }
    if not second.get("failed"):
        merged["msg"] = " ".join(one.get("msg") or "" for results in concerns.values() for one in results)
    return merged
