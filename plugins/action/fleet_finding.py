# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_finding: a finding of fleet_report as the result of a task of its own."""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase

from ..plugin_utils._checks.engine import FAILED
from ..plugin_utils._fleet.plain_text import LINE, plain, plain_data

PARTS = ("kind", "place", "mode", "what", "verdict", "sentence", "remedy", "decide", "since")


class ActionModule(ActionBase):
    """Returns the finding. The task fails if the finding explains a failed check."""

    _VALID_ARGS = frozenset(("finding",))
    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the parts of the finding; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        finding = plain_data(self._task.args.get("finding") or {}, LINE)
        if not isinstance(finding, dict) or not {"sentence", "verdict"} <= finding.keys():
            message = f"The option finding is {plain(finding)}; expected an entry of findings, as fleet_report returns it: correct it."
            result.update(failed=True, msg=message)
            return result
        parts = {name: finding[name] for name in PARTS if name in finding}
        sentence = f"{finding['sentence']}; {finding['remedy']}" if finding.get("remedy") else finding["sentence"]
        result.update(**parts, msg=sentence, failed=finding["verdict"] == FAILED, changed=False)
        return result
