# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes at boot: the managers that can bring them back, and which of them owns an interface.

A back end knows one manager and its files, nothing of the kernel's routes: those are already right when it is asked.
"""

import os
import stat
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import network
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import Route

NAME = "rosfleet-multimaster"
HEADER = "# Managed by Ansible: rosfleet.multimaster.routes writes this whole file, so changes here do not last.\n"

Places = typing.Dict[str, str]  # place -> what is there
Wanted = typing.Dict[str, typing.Optional[str]]  # place -> what shall be there, None for nothing


class Machine(typing.NamedTuple):
    """What every back end may know: the interfaces by name."""

    interfaces: typing.Dict[str, network.Interface]
    booted: bool  # this is the running system with systemd, so its managers can be asked and told


class BackEnd:
    """One manager of interfaces. `owns`, `read`, `place`, `render` and `check` change nothing.

    A place is the absolute path of a file as the machine sees it (without `root`), or another name such as
    `nmcli:<uuid>`; a back end with such places has its own `write`.
    """

    name = ""
    mode = 0o644
    has_last_word = False  # whether its routes of ours take the place of others' routes at boot, too

    def __init__(self, machine: Machine, root: str, recorded: typing.Dict[str, typing.List[str]]) -> None:
        """`recorded`: place -> every text that earlier runs may have left there (two after a run that was killed)."""
        self.machine = machine
        self.root = root
        self.recorded = recorded

    def owns(self) -> typing.Set[str]:
        """The interfaces that this manager really manages now."""
        raise NotImplementedError

    def read(self) -> Places:
        """What is there now of ours. Raises Problem where something in our place is not ours."""
        raise NotImplementedError

    def place(self, interface: str) -> str:
        """Where the routes of this interface go. Raises Problem where the manager has no place for it."""
        raise NotImplementedError

    def render(self, routes: typing.Dict[str, typing.List[Route]]) -> Wanted:
        """What shall be in our places for these routes by interface: every place of `read` and of these interfaces.

        A route without a device (blackhole and its like) is with the interface that carries it at boot.
        Changes nothing and starts nothing: what must be known has been read before.
        """
        raise NotImplementedError

    def check(self, wanted: Wanted) -> None:
        """Raises Problem where the manager's own tool refuses this, or would not use it at boot."""

    def write(self, place: str, content: typing.Optional[str]) -> None:
        """Put a text into a place, None to leave nothing there. The folders of files are made by the caller."""
        path = self.path(place)
        if content is None:
            atomic.remove_leftovers(path)
            if os.path.lexists(path):
                atomic.remove(path)
        else:
            atomic.write_by_rename(path, content.encode("utf-8"), mode=self.mode)

    def wrong_mode(self, place: str) -> bool:
        """Whether a file of ours has lost its permissions: a hook that cannot be executed is not run, and says nothing."""
        path = self.path(place)
        return place.startswith("/") and os.path.isfile(path) and stat.S_IMODE(os.stat(path).st_mode) != self.mode

    def activate(self, places: typing.List[str]) -> None:
        """Tell the running manager about changed places, with every link staying up. Raises Problem."""

    def path(self, place: str) -> str:
        """A file's path, below `root`."""
        return os.path.join(self.root, place.lstrip("/"))

    def own_text(self, place: str) -> typing.Optional[str]:
        """The text of a file of ours, None where there is none. Raises Problem where the file is somebody else's."""
        path = self.path(place)
        if not os.path.lexists(path):
            return None
        regular = os.path.isfile(path) and not os.path.islink(path)
        text = (atomic.read_bytes(path) or b"").decode("utf-8", "replace") if regular else ""
        if HEADER in text or text in self.recorded.get(place, []):
            return text
        raise Problem(
            "routes: %s is there and not ours (neither our first line nor our record), expected no file or one that "
            "this module wrote: move it away, or set backend to none for the routes that belong there." % place
        )


def machine(root: str = "/") -> Machine:
    """This machine's interfaces. Raises Problem where it cannot be asked."""
    try:
        found = network.interfaces()
    except OSError as problem:
        raise Problem("routes: %s; expected the command ip (package iproute2)." % problem) from problem
    interfaces = {link.name: link for link in found}
    return Machine(interfaces, root == "/" and os.path.isdir("/run/systemd/system"))
