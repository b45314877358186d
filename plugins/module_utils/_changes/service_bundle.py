# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module managed_services: the units of a bundle, from their files to their processes."""

import os
import typing

from .._module.problem import Problem, explain_unreadable, sentence
from . import files, unit_steps, units, writable
from .module import Fields, ModuleRun
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
# The word for what was done with a unit is that of the first of these that was.
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
        with explain_unreadable():
            self._read_options(options)
            self._read_machine()
        self._plan()

    def _read_options(self, options: typing.Mapping[str, typing.Any]) -> None:
        folder = options["unit_folder"]
        self.record = files.record_of("services", options["bundle"], options["records"])
        self.units = units.parse_units(options["units"])
        self.wanted = files.parse_files(
            dict(path=os.path.join(folder, unit.name), content=unit.content, mode="0644") for unit in self.units
        )
        self.remembered = self.record.load()
        if not self.systemd.runs() and (self.units or self.remembered):
            raise Problem(
                "systemd does not run on this computer (there is no /run/systemd/system), so units cannot be managed; "
                "boot it with systemd."
            )
        if folder != USUAL_FOLDER and self.units and folder not in self.systemd.unit_path():
            raise Problem(
                f"The unit_folder {folder} is none that systemd reads; expected one of: "
                f"{', '.join(self.systemd.unit_path())}."
            )

    def _read_machine(self) -> None:
        self.names = [unit.name for unit in self.units]
        self.former = [name for name in self.remembered.get("units", []) if name not in self.names]
        self.machine = files.read(self.wanted, self.remembered, self.record)
        self.states = self.after = {
            # systemd tells the state of before where a run was killed after it had removed the file.
            name: state if os.path.lexists(state["FragmentPath"]) else {**state, "UnitFileState": ""}
            for name, state in self.systemd.show(self.names + self.former).items()
        }
        self.newer_files = {
            unit.name: self.systemd.find_newer_file(unit.content, self.states[unit.name]) for unit in self.units
        }

    def _plan(self) -> None:
        owned = files.find_owned_files(self.remembered, self.machine)
        units.check(self.units, self.states, owned)
        self.files = files.plan_files(self.wanted, self.remembered, self.machine)
        # A former unit whose file an interrupted run never wrote may be another program's.
        self.removed = [name for name in self.former if self.states[name]["FragmentPath"] in ("", *owned)]
        paths = {name: file.path for name, file in zip(self.names, self.wanted)}
        written = {file.path for file in self.files.writes}
        self.written = [name for name, path in paths.items() if path in written]
        pending = set(self.remembered.get("pending", []))
        self.plan = unit_steps.UnitPlan(
            wanted=self.units,
            actions=units.plan_actions(self.units, self.removed, self.states, self.written, pending, self.newer_files),
            before=self.states,
            paths=paths,
            fresh=[name for name in self.names if name in self.written or name in pending],
            reload=files.changes(self.files)
            or any(state["NeedDaemonReload"] == "yes" for state in self.states.values()),
            files=self.files,
        )
        acts = any(action.run or action.switch for action in self.plan.actions)
        self.changed = bool(self.plan.reload or self.former or acts)

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences on what cannot be changed here: files, and systemd without root's rights."""
        if not self.changed:
            return []
        sentences = writable.obstacles([*files.places(self.files, self.record), self.record.path])
        if os.geteuid() != 0 and not sentences:
            sentences = [
                f"The user {os.geteuid()} cannot change units of the system; expected root: run as root (become: true)."
            ]
        return [*sentences, "Nothing was changed."] if sentences else []

    def apply(self) -> None:
        """Carry out the actions, or bring the previous state back and raise StepFailure."""
        if not self.changed:
            if not self.remembered:  # a run that was killed after the last file may have left the folder of records
                self.record.tidy()
            return
        switches = [action.name for action in self.plan.actions if action.switch]
        memory = dict(
            units=self.former + self.names,
            pending=list(dict.fromkeys(self.plan.fresh + switches)),
            directories=dict(self.remembered.get("directories", {})),
            parents=list(self.remembered.get("parents", [])),
        )
        change = unit_steps.UnitSteps(self.systemd, self.plan, self.record, self.remembered, memory)
        try:
            carry_out(change.steps(files.steps(self.files, self.machine)))
        except StepFailure as problem:
            back = ["This could not be taken back:"] + problem.left if problem.left else ["The previous state is back."]
            raise StepFailure(
                problem.cause, problem.left, " ".join([sentence(problem.cause)] + back)
            ) from problem.cause
        self.after = change.after

    def failure(self, problem: Problem) -> Fields:
        """The fields of a failed change: `changed` says that something is left of it."""
        if not isinstance(problem, StepFailure):
            return {}
        return {"changed": bool(problem.left), "previous_state_is_back": not problem.left}

    def result(self) -> Fields:
        """The return values beside `changed`, `msg` and `diff`."""
        return {"units": self._items(), "removed": self.removed, "notes": self.files.notes}

    def _items(self) -> typing.List[Fields]:
        actions = {action.name: action for action in self.plan.actions}
        return [
            _item(unit, actions[unit.name], unit.name in self.written, self.after[unit.name]) for unit in self.units
        ]

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The entries of `diff`."""
        return files.differences(self.files, self.machine) + [self._states_difference()]

    def _states_difference(self) -> typing.Dict[str, str]:
        """The entry of the difference that shows which units start, stop and are enabled."""
        wanted = {unit.name: unit for unit in self.units}
        before, after = "", ""
        for action in sorted(self.plan.actions):
            if action.run or action.switch:
                state = self.states[action.name]
                before += f"{action.name}: {state['ActiveState']}, {state['UnitFileState'] or 'absent'}\n"
                after += f"{action.name}: {_state_after(action, wanted.get(action.name))}\n"
        header = "the states of the units"
        return dict(before=before, after=after, before_header=header, after_header=header)

    def summary(self, check_mode: bool) -> str:
        """One sentence on all that was done, with the notes."""
        items = self._items()
        be = "would be" if check_mode else "was"
        parts = [f"{name} {be} removed" for name in self.removed]
        for item in items:
            if item["state"] != "unchanged":
                why = f" ({item['why']})" if item["why"] else ""
                parts.append(f"{item['name']} {be} {item['state']}{why}")
        if self.plan.reload and not parts:
            parts.append(f"systemd {be} told to read its units again")
        right = sum(item["state"] == "unchanged" for item in items)
        if right or not parts:
            parts.append(f"{right} {'other ' if parts else ''}units {'are' if check_mode else 'were'} right")
        return " ".join(["; ".join(parts) + "."] + self.files.notes)


def _item(unit: units.Unit, action: units.Action, written: bool, state: units.State) -> Fields:
    """The result of one unit."""
    actions = [verb for verb in ("write" if written else "", action.switch, action.run) if verb]
    return dict(
        name=unit.name,
        state=next((word for verb, word in STATES if verb in actions), "unchanged"),
        actions=actions,
        why=action.why,
        active_state=state["ActiveState"],
        sub_state=state["SubState"],
        unit_file_state=state["UnitFileState"],
        main_pid=int(state["MainPID"] or 0),
        since=state["ActiveEnterTimestamp"],
        inputs=units.read_inputs(unit.content),
        inputs_running=state[units.INPUTS],
        restarts=int(state["NRestarts"] or 0),
    )


def _state_after(action: units.Action, unit: typing.Optional[units.Unit]) -> str:
    if unit is None:
        return f"inactive, absent ({action.why})"
    verb = f" ({action.run}: {action.why})" if action.run else ""
    return f"{'active' if unit.started else 'inactive'}, {'enabled' if unit.enabled else 'disabled'}{verb}"
