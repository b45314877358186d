# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The door to the judgement of what all computers have seen: registered results in, table, file and findings out."""

from __future__ import annotations

import json
import os
import tempfile

from ansible.plugins.action import ActionBase
from ansible.utils.display import Display
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify import checks, report

OPTIONS = ("fleet", "multicast", "probe", "earlier", "path")


class ActionModule(ActionBase):
    """Judges the results of the whole run and prints the report."""

    _VALID_ARGS = frozenset(OPTIONS)
    _requires_connection = False

    def run(self, tmp=None, task_vars=None):
        result = super().run(tmp, task_vars)
        task_vars = task_vars or {}
        fleet, multicast, probe, earlier, path = (self._task.args.get(option) for option in OPTIONS)
        observations = {
            host: observation(task_vars["hostvars"][host], multicast, probe, earlier or [])
            for host in task_vars["ansible_play_hosts_all"]
            if host in fleet["computers"]
        }
        findings = checks.evaluate(fleet, observations)
        if path:
            findings = list(findings)  # all of them, not only those that are not ok
        summary = report.summarise(
            findings, [host for host in fleet["computers"] if host in observations], len(fleet["computers"])
        )
        if path:
            try:
                write(path, report.document(summary, findings))
            except OSError as problem:
                result.update(
                    failed=True, msg=f"The report cannot be written to {path}: {problem.strerror}; name another file."
                )
                return result
        Display().display("\n" + report.render(summary) + "\n")
        result.update(
            changed=False,
            passed=not summary.number(checks.FAILED),
            msg=report.verdict_line(summary),
            checks=report.counts(summary),
            findings=[vars(finding) for finding in summary.notable],
        )
        return result


def observation(variables, multicast, probe, earlier):
    """What one computer gave, out of its registered results; one that has failed is named by its message."""
    results = [variables[name] for name in (*earlier, multicast, probe) if name in variables]
    bad = [entry for entry in results if entry.get("unreachable") or entry.get("failed")]
    return checks.Observation(
        multicast=complete(variables, multicast, "udp"),
        probe=complete(variables, probe, "members"),
        unreachable=any(entry.get("unreachable") for entry in bad),
        problem=" ".join(str(bad[0].get("msg", "")).split()) if bad else "",
    )


def complete(variables, name, part):
    """A registered result, or None where the task gave none."""
    registered = variables[name] if name in variables else {}
    return registered if part in registered else None


def write(path, document):
    """Write by rename, so that a reader never sees half of a report."""
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
