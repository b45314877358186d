# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_finding: a finding of fleet_report as the result of a task of its own."""

from __future__ import annotations

from typing import Any

from ..plugin_utils._base.plain_text import LINE, plain, plain_data
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal
from ..plugin_utils._verify.checks.engine import FAILED

PARTS = (
    *("id", "page", "kind", "place", "mode", "what", "verdict", "sentence"),
    *("do", "look", "remedy", "decide", "since"),
)


class ActionModule(FleetAction):
    """Returns the finding. The task fails if the finding explains a failed check."""

    _VALID_ARGS = frozenset(("finding",))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the parts of the finding."""
        finding = plain_data(args.get("finding") or {}, LINE)
        if not isinstance(finding, dict) or not {"sentence", "verdict"} <= finding.keys():
            raise Refusal(
                f"The option finding is {plain(finding)}; expected an entry of findings, as fleet_report returns it: correct it."
            )
        parts = {name: finding[name] for name in PARTS if name in finding}
        sentence = f"{finding['sentence']}; {finding['remedy']}" if finding.get("remedy") else finding["sentence"]
        return {**parts, "msg": sentence, "failed": finding["verdict"] == FAILED}
