# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_verdict: the result of a run in, a task that fails with these words, or does not."""

from __future__ import annotations

from typing import Any

from ansible.module_utils.parsing.convert_bool import boolean

from ..plugin_utils._base.plain_text import plain_lines
from ..plugin_utils._robot_io.refusal import FleetAction, fail_plainly


class ActionModule(FleetAction):
    """Ends a run: it fails if something was found, and its words are the last ones."""

    _VALID_ARGS = frozenset(("passed", "fail_msg", "success_msg"))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the result of a task that passed, or fail."""
        if not boolean(args.get("passed")):
            given = args.get("fail_msg") or ()
            words = [given] if isinstance(given, str) else given
            return fail_plainly(plain_lines(" ".join(str(word) for word in words if word)))
        shown = str(args.get("success_msg") or "")
        return {"msg": plain_lines(shown), **({"_ansible_verbose_always": True} if shown else {})}
