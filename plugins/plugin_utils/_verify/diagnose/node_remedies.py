# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The right start of a person's node: in the shell, the unit, the launch file or the container that has started it.

Pure: the facts of its process in, advices out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from ..._base import advice
from ..._faults.fault import HANDS, Advice, Advices
from ..components.component import Component
from ..context.announcements import Misplaced
from ..context.check_context import FleetState, Participant

PROFILE = ". /etc/profile.d/rosfleet-multimaster.sh"
ENVIRONMENT = "/etc/rosfleet-multimaster/environment"
HOSTS = ("ROS_HOSTNAME", "ROS_IP")  # variables
ARGUMENTS = ("__hostname", "__ip", "__master")  # of a command line, which win over variables
MOST = 3  # ways of starting that are described
UNREAD = "its environment cannot be read here, so which variable is wrong is unknown"


def list_remedies(components: Sequence[Component], computer: Participant | None, state: FleetState) -> Advices:
    """Return how to start the nodes of a finding right; nothing if their starter is not known."""
    components_here = set(components)
    nodes = [one for one in _list_nodes(state) if one.component in components_here]
    groups = list(dict.fromkeys(filter(None, (_describe(one, computer) for one in nodes))))
    return tuple(dict.fromkeys(one for group in groups[:MOST] for one in group))


def _list_nodes(state: FleetState) -> Iterable[Misplaced]:
    for nodes in state.misplaced.values():
        yield from nodes.values()
    for strays in state.strays.values():
        yield from strays


def _describe(one: Misplaced, computer: Participant | None) -> Advices:
    if one.mode == "network" and one.process.starter != "container":
        return ()  # what its shell or unit says is right
    starter = _STARTERS.get(one.process.starter)
    if starter is None or computer is None:
        return ()
    if one.mode == "unregistered":
        return _start_again(one, computer)
    found = starter(one, computer)
    return found if one.process.readable or not found else (*found, Advice(HANDS, UNREAD))


def _start_again(one: Misplaced, computer: Participant) -> Advices:
    """Say how to end a node and to start it again: it registers only when it starts."""
    process = one.process
    where = f" ({process.unit})" if process.unit else ""
    if process.starter == "unit":
        restart = advice.of_unit(process.person, "{systemctl} restart {unit}", process.unit)
        return (Advice(computer.name, restart, f"the unit has started {one.node}"),) if restart else ()
    if process.starter == "launch":
        file = process.launch or "the launch file"
        words = (
            f"end roslaunch with {file} on {computer.name}{where}, and start it again in a new login, or by its unit"
        )
        return (Advice(HANDS, words),)
    if process.starter == "container":
        return (Advice(HANDS, f"restart the container of {one.node} on {computer.name}{where}, as by docker restart"),)
    effect = f"ends {one.node}{where}; then start it again in a new login, or in its shell after: {PROFILE}"
    if process.pid <= 1:  # kill 0 would end the shell of the person, and 1 is systemd
        return (Advice(HANDS, f"end {one.node} on {computer.name}, and start it again in a new login"),)
    end = advice.command("kill {}", ("number", process.pid))
    return (Advice(computer.name, end, effect),)


def _unset(one: Misplaced) -> str:
    """The variables that a shell has to forget, and the profile that it has to read, as a command."""
    names = [one.process.source] if one.source in HOSTS else HOSTS
    return f"unset {' '.join(names)}; {PROFILE}"


def _describe_shell(one: Misplaced, computer: Participant) -> Advices:
    where = f" ({one.process.unit})" if one.process.unit else ""
    if one.source in ARGUMENTS:
        words = f"end {one.node}, take {one.source}:=... out of the command line that starts it on {computer.name}{where}, and start it again"
        return (Advice(HANDS, words),)
    effect = f"end {one.node}; then in the shell that has started it{where}; start it there again"
    return (Advice(computer.name, _unset(one), effect), *_find_line(one, computer))


def _find_line(one: Misplaced, computer: Participant) -> Advices:
    """Say which line of a person's files sets the variable: the next shell has it again."""
    found = computer.seen.found
    line = found.set_by.get(one.source, "") if found is not None else ""
    return (Advice(HANDS, f"remove the line that sets {one.source} on {computer.name}: {line}"),) if line else ()


def _describe_unit(one: Misplaced, computer: Participant) -> Advices:
    source = one.process.source
    wrong = source if source in HOSTS and source not in computer.plan.environment else ""
    lines = f"[Service]\\nEnvironmentFile={ENVIRONMENT}\\n" + (f"UnsetEnvironment={wrong}\\n" if wrong else "")
    words = (
        f"mkdir -p {{folder}}/{{unit}}.d; printf '{lines}' > {{folder}}/{{unit}}.d/rosfleet.conf; {{systemctl}} daemon-reload; "
        "{systemctl} restart {unit}"
    )
    if not one.process.of_unit:
        return _describe_script(one, computer)
    made = advice.of_unit(one.process.person, words, one.process.unit)
    return (Advice(computer.name, made, f"the unit has started {one.node}"),) if made else ()


def _describe_script(one: Misplaced, computer: Participant) -> Advices:
    """A script or command of the unit has the last word on its variables, so a drop-in file of the unit does not help.

    The variables of a person's own unit were not read: it may be the unit's file.
    """
    unit, person = one.process.unit, one.process.person
    again = "{systemctl} daemon-reload; {systemctl} restart {unit}" if person else "{systemctl} restart {unit}"
    restart = advice.of_unit(person, again, unit)
    named = unit if restart else "its unit"
    where = f"the script or command that {named} starts on {computer.name} (ExecStart), and begin it"
    if restart and person:
        where = f"{named} of {person} on {computer.name}, or out of the script or command that it starts (ExecStart), and begin that"
    words = f"take {_name_wrong(one)} out of {where} with: {PROFILE}"
    started = (Advice(computer.name, restart, f"the unit has started {one.node}"),) if restart else ()
    return (Advice(HANDS, words), *started)


def _name_wrong(one: Misplaced) -> str:
    """Name the variable or argument that is wrong, or those that may be."""
    if one.source in ARGUMENTS:
        return f"{one.source}:=..."
    if one.mode in ("robot", "master"):
        return "ROS_MASTER_URI"
    return one.source if one.source in HOSTS else " and ".join(HOSTS)


def _describe_launch(one: Misplaced, computer: Participant) -> Advices:
    file = one.process.launch or "the launch file"
    if one.source in ARGUMENTS:
        words = f'take {_name_wrong(one)} out of {file} on {computer.name} (<node args="...">), end roslaunch, and start it again'
        return (Advice(HANDS, words),)
    return (
        Advice(HANDS, f"take {_name_wrong(one)} out of {file} on {computer.name} (<env name=...>)"),
        Advice(
            computer.name, _unset(one), "end roslaunch; then in the shell or unit that starts roslaunch; start it again"
        ),
        *_find_line(one, computer),
    )


def _describe_container(one: Misplaced, computer: Participant) -> Advices:
    given = " ".join(
        f"--env {name}={value}" for name, value in _list_variables(computer) if advice.format_value("what", value)
    )
    where = f" ({one.process.unit})" if one.process.unit else ""
    words = f"end the container on {computer.name}{where}, and start it again with the network of the computer and its names: --network host {given}"
    left_out = f", and take {_name_wrong(one)} out of its command line" if one.source in ARGUMENTS else ""
    return (Advice(HANDS, words + left_out),)


def _list_variables(computer: Participant) -> list[tuple[str, str]]:
    return [(name, value) for name, value in computer.plan.environment.items() if name in (*HOSTS, "ROS_MASTER_URI")]


_STARTERS: Mapping[str, Callable[[Misplaced, Participant], Advices]] = {
    "shell": _describe_shell,
    "unit": _describe_unit,
    "launch": _describe_launch,
    "container": _describe_container,
}
