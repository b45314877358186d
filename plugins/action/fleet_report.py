# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_report: the registered results of all computers in, table, file and findings out."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from ansible.plugins.action import ActionBase
from ansible.utils.display import Display
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import (
    LINE,
    plain,
    plain_data,
    plain_lines,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import AsFound, FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plain import Mismatch, from_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify import report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnosis import explained
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import FAILED, Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import (
    Multicast,
    Observation,
    PacketFilter,
    Probe,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.pairs import ALL

OPTIONS = ("fleet", "multicast", "probe", "earlier", "path", "packet_filter", "plan", "pairs")

T = TypeVar("T")


class ActionModule(ActionBase):
    """Judges the results of the whole run and prints the report."""

    _VALID_ARGS = frozenset(OPTIONS)
    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        result: dict[str, Any] = super().run(tmp, task_vars)
        task_vars = task_vars or {}
        plain_fleet, multicast, probe, earlier, path, packet_filter, plan, pairs = (
            self._task.args.get(option) or "" for option in OPTIONS
        )
        try:
            fleet = from_plain(FleetPlan, plain_fleet)
            observations = {
                host: observation(task_vars["hostvars"][host], multicast, probe, earlier, packet_filter, plan)
                for host in task_vars["ansible_play_hosts_all"]
                if host in fleet.computers
            }
        except Mismatch as problem:
            result.update(failed=True, msg=f"The plan of the fleet cannot be read: {problem}")
            return result
        verification = Verification(CHECKS, fleet, observations, pairs or ALL)
        everything = list(verification.rows()) if path else []  # otherwise only what is not ok is kept
        computers = [host for host in fleet.computers if host in observations]
        if path:
            summary = report.summarise(everything, computers, len(fleet.computers), verification.pairs)
        else:
            summary = report.summarised(verification, computers, len(fleet.computers))
        diagnosis = explained(verification, summary.notable)
        if path:
            try:
                write(path, plain_data(report.document(summary, diagnosis, everything)))
            except OSError as problem:
                result.update(
                    failed=True, msg=f"The report cannot be written to {path}: {problem.strerror}; name another file."
                )
                return result
        Display().display("\n" + plain_lines(report.render(summary, diagnosis)) + "\n")
        result.update(
            changed=False,
            passed=not summary.number(FAILED),
            msg=report.verdict_line(summary),
            checks=report.counts(summary),
            pairs=report.sampled(summary),
            findings=plain_data(report.findings(diagnosis)),
            unexplained=plain_data([row._asdict() for row in diagnosis.unexplained]),
        )
        return result


def observation(
    variables: Mapping[str, Any],
    multicast: str,
    probe: str,
    earlier: Sequence[str],
    packet_filter: str = "",
    plan: str = "",
) -> Observation:
    """Read the registered results of one computer; the message of the first one that failed is its problem."""
    results = [registered(variables, name) for name in (*earlier, multicast, probe)]
    bad = [entry for entry in results if entry.get("unreachable") or entry.get("failed")]
    problem = plain(" ".join(str(bad[0].get("msg", "")).split()), LINE) if bad else ""
    unreachable = any(entry.get("unreachable") for entry in bad)
    try:
        return Observation(
            multicast=complete(Multicast, variables, multicast, "udp"),
            probe=complete(Probe, variables, probe, "members"),
            unreachable=unreachable,
            problem=problem,
            packet_filter=complete(PacketFilter, variables, packet_filter, "members"),
            found=as_found(variables, plan),
            services=services(variables, plan),
        )
    except Mismatch as found:  # what one computer was told by strangers must not cost the others their report
        return Observation(
            unreachable=unreachable, problem=problem or plain(f"its results cannot be read: {found}", LINE)
        )


def complete(kind: type[T], variables: Mapping[str, Any], name: str, part: str) -> T | None:
    """Read a registered result; None where the task gave none, or not this part. Raises Mismatch."""
    result = registered(variables, name)
    return from_plain(kind, plain_data(result)) if part in result else None


def registered(variables: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a registered result, or with a dot in the name a part of one; empty where there is none."""
    found: Any = variables
    for key in name.split("."):
        found = found[key] if isinstance(found, Mapping) and key in found else {}
    return found if isinstance(found, Mapping) else {}


def services(variables: Mapping[str, Any], name: str) -> tuple[str, ...] | None:
    """Read which services can run there, as preflight found; None where it did not look."""
    found = registered(variables, name).get("services")
    return tuple(map(str, found)) if isinstance(found, (list, tuple)) else None


def as_found(variables: Mapping[str, Any], name: str) -> AsFound | None:
    """Read what preflight found, out of the variable with the computer's plan; None where there is none. Raises Mismatch."""
    plan = registered(variables, name)
    return from_plain(AsFound, plain_data(plan["found"])) if "found" in plan else None


def write(path: str, document: Mapping[str, Any]) -> None:
    """Write a JSON file by rename, so that a reader never sees half of a report. Raises OSError."""
    path = os.path.abspath(os.path.expanduser(path))
    descriptor, temporary = tempfile.mkstemp(dir=os.path.dirname(path), prefix=".report-")
    try:
        with open(descriptor, "w", encoding="utf-8") as stream:
            json.dump(document, stream, indent=1)
            stream.write("\n")
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
