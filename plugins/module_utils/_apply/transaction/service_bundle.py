# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module managed_services: the units of a bundle, from their files to their processes."""

import os
import typing

from ..._base.difference import difference
from ..._base.problem import Problem, sentence
from . import files, unit_steps, units, writable
from .module import Concern, Fields, ModuleRun
from .record import RECORDS
from .systemctl import Systemd
from .transaction import StepFailure, carry_out

USUAL_FOLDER = "/etc/systemd/system"
UNIT = dict(
    name=dict(type="str", required=True),
    content=dict(type="str", required=True),
    enabled=dict(type="bool", default=True),
    started=dict(type="bool", default=True),
)
OPTIONS = dict(
    bundle=dict(type="str", required=True),
    units=dict(type="list", elements="dict", required=True, options=UNIT),
    timeout=dict(type="float", default=90),
    unit_folder=dict(type="str", default=USUAL_FOLDER),
    records=dict(type="str", default=RECORDS),
)
# The word for the change of a unit is that of the first of these that was done.
STATES = (
    ("restart", "restarted"),
    ("follow", "restarted"),
    ("start", "started"),
    ("stop", "stopped"),
    ("write", "written"),
    ("enable", "enabled"),
    ("reenable", "enabled"),
    ("disable", "disabled"),
)


class ManagedServices(ModuleRun):
    """The run, planned from the options of the module."""

    def __init__(self, options: typing.Mapping[str, typing.Any], systemd: typing.Optional[Systemd] = None) -> None:
        self.systemd = systemd or Systemd(options["timeout"])
        folder = options["unit_folder"]
        self.units = units.parse_units(options["units"])
        wanted = (dict(path=os.path.join(folder, unit.name), content=unit.content, mode="0644") for unit in self.units)
        bundle = files.FileBundle("services", options["bundle"], options["records"], wanted)
        if not self.systemd.runs() and (self.units or bundle.remembered):
            raise Problem(
                "systemd does not run on this computer (there is no /run/systemd/system), so units cannot be managed; "
                "boot it with systemd."
            )
        if folder != USUAL_FOLDER and self.units and folder not in self.systemd.unit_path():
            raise Problem(
                f"The unit_folder {folder} is none that systemd reads; expected one of: "
                f"{', '.join(self.systemd.unit_path())}."
            )
        self.change = unit_steps.UnitSteps(self.systemd, bundle, self.units)
        self.files = self.change.files
        self.changed = self.change.has_changes

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences on things that cannot be changed here: files, and systemd without root's rights."""
        if not self.changed:
            return []
        sentences = writable.obstacles([*self.files.places, self.files.record.path])
        if os.geteuid() != 0 and not sentences:
            sentences = [
                f"The user {os.geteuid()} cannot change units of the system; expected root: run as root (become: true)."
            ]
        return [*sentences, "Nothing was changed."] if sentences else []

    def apply(self) -> None:
        """Carry out the actions, or bring the previous state back and raise StepFailure."""
        if not self.changed:
            # A run that was killed after the last file may have left the folder of records.
            if not self.files.remembered:
                self.files.record.tidy()
            return
        carry_out(self.change.steps(), _explain_failure)

    def failure(self, problem: Problem) -> Fields:
        """The fields of a failed change: `changed` says that something is left of it."""
        if not isinstance(problem, StepFailure):
            return {}
        return {"changed": bool(problem.left), "previous_state_is_back": not problem.left}

    def result(self) -> Fields:
        """The return values besides `changed`, `msg` and `diff`."""
        return {"units": self._items(), "removed": self.change.removed, "notes": self.files.notes}

    def _items(self) -> typing.List[Fields]:
        actions = {action.name: action for action in self.change.actions}
        return [
            _item(unit, actions[unit.name], unit.name in self.change.written, self.change.after[unit.name])
            for unit in self.units
        ]

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The entries of `diff`: the files, and which units start, stop and are enabled."""
        wanted = {unit.name: unit for unit in self.units}
        before, after = "", ""
        for action in sorted(self.change.actions):
            if action.run or action.switch:
                state = self.change.before[action.name]
                before += f"{action.name}: {state.ActiveState}, {state.UnitFileState or 'absent'}\n"
                after += f"{action.name}: {_state_after(action, wanted.get(action.name))}\n"
        return [*self.files.differences(), difference("the states of the units", before, after)]

    def summary(self, check_mode: bool) -> str:
        """One sentence on all that was done, with the notes."""
        items = self._items()
        be = "would be" if check_mode else "was"
        parts = [f"{name} {be} removed" for name in self.change.removed]
        for item in items:
            if item["state"] != "unchanged":
                why = f" ({item['why']})" if item["why"] else ""
                parts.append(f"{item['name']} {be} {item['state']}{why}")
        if self.change.reload and not parts:
            parts.append(f"systemd {be} made to read its units again")
        right = sum(item["state"] == "unchanged" for item in items)
        if right or not parts:
            parts.append(f"{right} {'other ' if parts else ''}units {'are' if check_mode else 'were'} right")
        return " ".join(["; ".join(parts) + "."] + self.files.notes)


def _explain_failure(cause: Exception, left: typing.List[str]) -> str:
    back = ["This could not be taken back:", *left] if left else ["The previous state is back."]
    return " ".join([sentence(cause), *back])


def _item(unit: units.Unit, action: units.Action, written: bool, state: units.UnitState) -> Fields:
    """The result of one unit."""
    actions = [verb for verb in ("write" if written else "", action.switch, action.run) if verb]
    return dict(
        name=unit.name,
        state=next((word for verb, word in STATES if verb in actions), "unchanged"),
        actions=actions,
        why=action.why,
        active_state=state.ActiveState,
        sub_state=state.SubState,
        unit_file_state=state.UnitFileState,
        main_pid=int(state.MainPID or 0),
        since=state.ActiveEnterTimestamp,
        inputs=units.read_inputs(unit.content),
        inputs_running=state.inputs,
        restarts=int(state.NRestarts or 0),
    )


def _state_after(action: units.Action, unit: typing.Optional[units.Unit]) -> str:
    if unit is None:
        return f"inactive, absent ({action.why})"
    verb = f" ({action.run}: {action.why})" if action.run else ""
    return f"{'active' if unit.started else 'inactive'}, {'enabled' if unit.enabled else 'disabled'}{verb}"


CONCERN = Concern("managed_services", OPTIONS, lambda module, memory: ManagedServices(module.params), many=True)
