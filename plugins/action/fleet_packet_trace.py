# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_packet_trace: the registered results of the first verification in, the packets to follow out."""

from __future__ import annotations

from typing import Any

from ..plugin_utils._base.plain import Mismatch, to_plain
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal
from ..plugin_utils._verify.diagnose.diagnosis import list_unshown
from ..plugin_utils._verify.report.judgement import make_verification
from ..plugin_utils._verify.report.run import FIRST_LOOK, gather_run
from ..plugin_utils._verify.trace.probes import choose_probes, list_listeners


class ActionModule(FleetAction):
    """Judges the first look, and chooses probes for the failures that no value shows."""

    _VALID_ARGS = frozenset(FIRST_LOOK)

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the probes and the listeners."""
        try:
            run = gather_run(args, task_vars["hostvars"], task_vars["ansible_play_hosts_all"], {})
        except Mismatch as problem:
            raise Refusal(f"The plan of the fleet cannot be read: {problem}") from None
        verification = make_verification(run)
        probes = choose_probes(verification, list_unshown(verification))
        listeners = list_listeners(verification, probes)
        ways = f"{len(probes)} {'way is' if len(probes) == 1 else 'ways are'}"
        msg = f"{ways} followed, since no value shows why packets fail there." if probes else "Nothing is followed."
        return {"probes": list(map(to_plain, probes)), "listeners": listeners, "msg": msg}
