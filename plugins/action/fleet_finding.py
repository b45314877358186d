# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_finding: a finding of fleet_report as the result of a task of its own."""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.engine import FAILED
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import LINE, plain, plain_data

SHOWN = ("kind", "place", "mode", "what", "verdict", "sentence", "remedy", "decide", "since")


class ActionModule(ActionBase):
    """Returns the finding; it fails where a check failed because of it."""

    _VALID_ARGS = frozenset(("finding",))
    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the parts of the finding; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        finding = plain_data(self._task.args.get("finding") or {}, LINE)
        if not isinstance(finding, dict) or not {"sentence", "verdict"} <= finding.keys():
            said = f"The option finding is {plain(finding)}; expected an entry of findings, as fleet_report returns it: correct it."
            result.update(failed=True, msg=said)
            return result
        told = {name: finding[name] for name in SHOWN if name in finding}
        sentence = f"{finding['sentence']}; {finding['remedy']}" if finding.get("remedy") else finding["sentence"]
        result.update(**told, msg=sentence, failed=finding["verdict"] == FAILED, changed=False)
        return result
