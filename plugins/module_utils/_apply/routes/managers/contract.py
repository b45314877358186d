# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The contract of a back end: one program that configures interfaces and can bring routes back at boot.

A back end is a file in this folder with a class BackEnd(contract.BackEnd), and a row in table.py. It knows one manager
and its files. It knows nothing of the kernel's routes: they are right before it is used. For one run the module calls, in this
order:

    list_interfaces()     which interfaces does the manager configure now?
    read()                the texts of earlier runs in our places
    find_place(interface) the place for the routes of this interface
    render(place, routes) the wanted text there
    check(wanted)         does the manager accept that?
    write(place, text)    for every place that changes
    activate(places)      have the manager read them

Only the last two change anything. ifupdown.py is the shortest example.
"""

import os
import typing

from ...._base.plain_text import quote
from ...._base.problem import Problem, explain_unreadable
from ...._machine import network
from ...transaction import atomic
from ..kernel import RouteSpec

NAME = "rosfleet-multimaster"
HEADER = "# Managed by Ansible: rosfleet.multimaster.routes writes this whole file, so changes here do not last.\n"

Places = typing.Dict[str, str]  # place -> its text now
PlannedTexts = typing.Dict[str, typing.Optional[str]]  # place -> its wanted text, None for nothing
RecordedTexts = typing.Dict[str, typing.List[str]]  # place -> every text that earlier runs may have left there
RoutesByInterface = typing.Dict[str, typing.List[RouteSpec]]  # interface -> its routes


class MachineContext(typing.NamedTuple):
    """The facts about the machine that every back end may use."""

    interfaces: typing.Dict[str, network.NetworkInterface]  # by name
    booted: bool  # this is the running system with systemd, so commands reach its managers
    root: str = "/"  # the folder that holds the files of the machine

    def path(self, place: str) -> str:
        """The path of a file below `root`."""
        return os.path.join(self.root, place.lstrip("/"))


def read_machine(root: str) -> MachineContext:
    """This machine. Raises Problem if its interfaces cannot be read."""
    try:
        interfaces = network.interfaces()
    except OSError as problem:
        raise Problem(f"routes: {problem}; expected the command ip (package iproute2).") from problem
    booted = root == "/" and os.path.isdir("/run/systemd/system")
    return MachineContext({link.name: link for link in interfaces}, booted, root)


class BackEnd:
    """One manager of interfaces.

    A place keeps routes of ours: the absolute path of a file as the machine sees it (without `root`), or
    another name such as `nmcli:<uuid>`. A back end with such places has its own `write`.
    """

    name = ""  # the value of the options `backend` and `backends`
    mode = 0o644  # of the files
    takes_precedence = False  # True if its routes replace foreign routes at boot, too
    inexpressible: typing.Tuple[str, ...] = ()  # fields of a route that its configuration cannot express

    def __init__(self, machine: MachineContext, recorded: RecordedTexts) -> None:
        """`recorded`: two texts of a place after a killed run."""
        self.machine, self.recorded = machine, recorded

    # For every back end to write

    def list_interfaces(self) -> typing.Set[str]:
        """The names of the interfaces that this manager configures now."""
        raise NotImplementedError

    def find_place(self, interface: str) -> str:
        """The place for the routes of an interface. Raises Problem if the manager has no such place."""
        raise NotImplementedError

    def render(self, place: str, routes: RoutesByInterface) -> typing.Optional[str]:
        """The wanted text of a place for all routes of its interfaces, None for nothing.

        Each interface has one route at least. A route without a device (blackhole and its like) is listed with the
        interface that brings it back at boot.
        """
        raise NotImplementedError

    # For a back end to override if its manager needs it

    def list_places(self) -> typing.List[str]:
        """The files in which earlier runs may have left routes."""
        return []

    def read(self) -> Places:
        """The texts in our places now. Raises Problem if something there is not ours."""
        texts = {place: self.read_own_text(place) for place in self.list_places()}
        return {place: text for place, text in texts.items() if text is not None}

    def check(self, wanted: PlannedTexts) -> None:
        """Raises Problem if the manager's own tool refuses the texts, or would not use them at boot."""

    def write(self, place: str, content: typing.Optional[str]) -> None:
        """Write a text into a place; None leaves nothing there. The caller has made the folder of a file."""
        path = self.machine.path(place)
        if content is None:
            atomic.remove_leftovers(path)
            atomic.remove_for_good(path)
        else:
            atomic.write_by_rename(path, content.encode("utf-8"), mode=self.mode)

    def activate(self, places: typing.List[str]) -> None:
        """Notify the running manager of changed places. Every link stays up. Raises Problem."""

    def explain_delay(self) -> str:
        """The reason why `activate` does not notify the running manager, which reads the places at the next boot; "" if it does."""
        return ""

    # For every back end to use

    def read_own_text(self, place: str) -> typing.Optional[str]:
        """The text of a file of ours, None if it does not exist. Raises Problem if the file is not ours."""
        path = self.machine.path(place)
        if not os.path.lexists(path):
            return None
        regular = os.path.isfile(path) and not os.path.islink(path)
        with explain_unreadable():
            text = (atomic.read_bytes(path) or b"").decode("utf-8", "replace") if regular else ""
        if HEADER in text or text in self.recorded.get(place, []):
            return text
        why = "neither our first line nor our record" if regular else "no regular file, as this module writes one"
        raise Problem(
            f"routes: {quote(place)} is there and not ours ({why}), expected no file or one that this module wrote: move it away, or "
            "set backend to none for the routes that belong there."
        )

    def refuse_shared(self, interface: str, sharers: typing.Iterable[str], what: str, whose: str, thing: str) -> None:
        """Raises Problem if other interfaces share the place that would get the routes of this one; `whose` has a place for their names."""
        others = sorted(name for name in sharers if name != interface)
        if others:
            names = whose.format(", ".join(map(quote, others)))
            raise Problem(f"{what} {names}, which would get the same routes: give {interface} {thing} of its own.")

    def find_wrong_mode(self, place: str) -> typing.Optional[int]:
        """The mode of a file of ours that is not as it was written, else None: run-parts(8) passes over a hook that is not executable."""
        path = self.machine.path(place)
        if not place.startswith("/") or not os.path.isfile(path):
            return None
        mode, _owner = atomic.permissions(path)
        return None if mode == self.mode else mode
