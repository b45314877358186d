# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The form of a part of a verification."""

import typing

from .._contract.verify import Probe

_EMPTY = Probe().plain()


class Part(typing.NamedTuple):
    """A part of the result: its key, which is a field of the contract, and the function that looks."""

    name: str
    look: typing.Callable[..., typing.Any]
    # Those of `look`: names of options, `params` for all of them, `ros`, and `deadline` (monotonic seconds).
    arguments: typing.Tuple[str, ...] = ()
    runs_commands: bool = False  # it runs commands of ROS or measures with others, so it is left out in check mode
    on_router: bool = False  # the router of the common network has it, too
    # It is looked at when the other parts are through, and on the computer of a roscore only. By then all that was waited for
    # is there, and a robot's other computers would only ask the same roscore.
    final: bool = False
    # It measures for some seconds, with the others of the fleet or as the only one, so all else goes on meanwhile.
    shared: bool = False
    unseen: typing.Any = None  # if it cannot look: a text, or the fields with another value than the empty one

    @property
    def default(self) -> typing.Any:
        """The value if it cannot look: the empty one of the contract, or `unseen`."""
        empty: typing.Any = _EMPTY.get(self.name)
        if isinstance(self.unseen, dict):
            return dict(empty, **self.unseen)
        return empty if self.unseen is None else self.unseen


class Settling(typing.NamedTuple):
    """Something that this run may have disturbed, and that is waited for: the state before it, and the wait."""

    note: typing.Callable[[], typing.Any]
    wait: typing.Callable[[typing.Any], None]  # for the things that have settled since that state
