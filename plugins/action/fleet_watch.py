# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_watch: the reports of all computers of a watch in, a progress line and the first loss out."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from typing import Any

from ansible.utils.display import Display

from ..plugin_utils._base.plain import Mismatch, from_plain
from ..plugin_utils._base.plain_text import LINE, plain, plain_data, plain_lines, quote
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal, name_inventory
from ..plugin_utils._verify.observe import task_results
from ..plugin_utils._verify.watch import progress
from ..plugin_utils._verify.watch.progress import Event, LostValue, WatchAnswer

OPTIONS = ("watched", "duration", "known")


class ActionModule(FleetAction):
    """Prints the progress of a watch over the fleet."""

    _VALID_ARGS = frozenset(OPTIONS)

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the losses so far."""
        name, duration, known = (args.get(option) or "" for option in OPTIONS)
        try:
            seconds = progress.plan_rounds(duration)[-1]
        except progress.UnreadableDuration as problem:
            raise Refusal(str(problem)) from None
        hosts = frozenset(task_vars["ansible_play_hosts_all"])
        reports = {
            host: read_watch(task_vars["hostvars"][host], name, hosts)
            for host in task_vars["ansible_play_hosts_all"]
            if name in task_vars["hostvars"][host]
        }
        before = known if isinstance(known, Mapping) else {}
        # Each round reports that a computer does not answer. Its events from before are reported only once.
        silent = [host for host, report in reports.items() if not report.watched]
        reported = {**before, **dict.fromkeys(silent, 0)}
        Display().display(plain_lines(progress.describe_progress(reports, seconds, reported)))
        events = progress.list_events(reports)
        lost = sum(len(report.lost) for report in reports.values())
        loss = progress.find_first_loss(events)
        first, advice = (
            (plain(loss.sentence, LINE), plain_data(loss.advise(name_inventory(task_vars)))) if loss else ("", {})
        )
        return {
            "lost": lost,
            "first_loss": first,
            "advice": advice,
            "events": plain_data([{"observer": host, **vars(event)} for host, event in events]),
            "known": {
                **{host: len(report.events) for host, report in reports.items()},
                **{host: before.get(host, 0) for host in silent},
            },
            "msg": first or f"Nothing was lost in {progress.format_duration(seconds)}.",
        }


def read_watch(variables: Mapping[str, Any], name: str, hosts: Collection[str] = ()) -> WatchAnswer:
    """Read the report of a computer, in which the names of the `hosts` are planned. A computer without a report is lost itself."""
    report = task_results.quote_texts(variables[name], names=hosts)
    try:
        if "events" in report:
            return from_plain(WatchAnswer, report)
        why = str(report.get("msg", "no result"))
    except Mismatch as problem:
        why = f"its results cannot be read: {quote(problem, LINE)}"
    gone = Event("computer", "", False, "an answer", why, time.time(), 0.0)
    return WatchAnswer(watched=0, events=(gone,), lost=(LostValue("computer", ""),))
