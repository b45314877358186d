# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""An inventory as it is proposed: values, and the reason for each that had to be guessed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from .._inventory.model import Inventory
from .._inventory.rows import PREFIX

Value = str | int | list[str]


@dataclass(frozen=True)
class Choice:
    """A value as Ansible reads it, and why it was taken; `why` is empty if the machines leave no doubt."""

    value: Value
    why: str = ""


Choices = Mapping[str, Choice]  # by the names of variables, without `multimaster_`


@dataclass(frozen=True)
class ProposedComputer:
    """A host of the inventory."""

    name: str
    machine: str  # its name in the list of machines
    choices: Choices
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ProposedRobot:
    """A group below `robots`."""

    name: str
    choices: Choices
    computers: tuple[ProposedComputer, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Proposal:
    """An inventory, and the notes that are not in it."""

    choices: Choices = field(default_factory=dict)  # of the fleet
    robots: tuple[ProposedRobot, ...] = ()  # by name
    router: ProposedComputer | None = None
    left_out: Mapping[str, str] = field(default_factory=dict)  # machine -> why
    notes: tuple[str, ...] = ()

    @property
    def computers(self) -> tuple[ProposedComputer, ...]:
        """The computers of all robots."""
        return tuple(computer for robot in self.robots for computer in robot.computers)

    @property
    def hosts(self) -> tuple[ProposedComputer, ...]:
        """The computers of all robots, and the router."""
        return (*self.computers, self.router) if self.router else self.computers

    def guesses(self) -> list[str]:
        """Return a sentence for each value that had to be guessed, and for each note."""
        lines = [*_guesses("group_vars/robots.yml", self.choices), *self.notes]
        for robot in self.robots:
            lines += [*_guesses(f"group_vars/{robot.name}.yml", robot.choices), *robot.notes]
        for computer in self.hosts:
            lines += [*_guesses(computer.name, computer.choices), *computer.notes]
        return lines

    def inventory(self) -> Inventory:
        """Return the form that Ansible would make of it."""
        variables = {
            computer.name: _plain({**self.choices, **robot.choices, **computer.choices})
            for robot in self.robots
            for computer in robot.computers
        }
        if self.router:
            variables[self.router.name] = _plain(self.router.choices)
        return Inventory(
            robots={robot.name: [computer.name for computer in robot.computers] for robot in self.robots},
            variables=variables,
            routers=[self.router.name] if self.router else [],
        )


def _guesses(where: str, choices: Choices) -> Iterable[str]:
    return [
        f"{where}: {PREFIX}{name} is {choice.value}: {choice.why}" for name, choice in choices.items() if choice.why
    ]


def _plain(choices: Choices) -> dict[str, object]:
    return {PREFIX + name: choice.value for name, choice in choices.items()}
