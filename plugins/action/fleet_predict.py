# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_predict: the plan and the facts of all machines in, the prediction out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ansible.utils.display import Display

from ..plugin_utils._base.plain import Mismatch, from_plain
from ..plugin_utils._base.plain_text import LINE, plain, plain_data, plain_lines
from ..plugin_utils._plan.model import FleetPlan
from ..plugin_utils._predict import prediction
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal, name_inventory
from ..plugin_utils._verify.observe.task_results import Registered, find_result

OPTIONS = ("fleet", "machine", "table")


class ActionModule(FleetAction):
    """Predicts which computers reach each other after site.yml."""

    _VALID_ARGS = frozenset(OPTIONS)

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the prediction."""
        plain_fleet, machine, table = (args.get(option) for option in OPTIONS)
        try:
            fleet = from_plain(FleetPlan, plain_fleet)
        except Mismatch as problem:
            raise Refusal(f"The plan of the fleet cannot be read: {problem}") from None
        everybody, present = (task_vars.get(f"ansible_play_hosts{which}", ()) for which in ("_all", ""))
        refused = {host for host in everybody if host not in present}
        predicted = prediction.predict(fleet, machines(fleet, task_vars["hostvars"], machine), refused)
        inventory = name_inventory(task_vars)
        sentences = [plain(text, LINE) for text in prediction.warnings(predicted, inventory)]
        if table:
            Display().display("\n" + plain_lines(prediction.render(predicted, inventory)) + "\n")
        return {
            "msg": prediction.write_verdict(predicted),
            "works": not sentences,
            "sentences": sentences,
            "assumed": list(predicted.assumed),
            "refused": list(predicted.refused),
            "ways": plain_data(prediction.list_ways(predicted)),
            **({} if table else {"warnings": [*sentences, *map(plain, prediction.name_refused(predicted))]}),
        }


def machines(fleet: FleetPlan, hostvars: Mapping[str, Any], name: str) -> dict[str, Mapping[str, Any]]:
    """Return the facts of each computer, which it registered by this name (with a dot: a part of it)."""
    return {
        host: plain_data(find_result(Registered(hostvars, host), name)) for host in fleet.computers if host in hostvars
    }
