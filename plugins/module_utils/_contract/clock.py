# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The state of a computer's clock."""

import typing

from .fields import Struct, field


class TimeSource(Struct):
    """A computer or server that the time service of a computer asks."""

    address: str = field("The address of the source.", "192.168.1.201", needed=True)
    selected: bool = field("Whether the clock follows it, as the only one or with others.", True)
    reachable: bool = field("Whether it has answered one of the last four requests.", True)
    offset_s: typing.Optional[float] = field(
        "How many seconds this computer's clock was ahead of the source at its last answer, or null if the service does not report it.",
        0.0001,
    )


class ClockState(Struct):
    """The clock of the computer; None if its state is unknown."""

    synchronised: typing.Optional[bool] = field(
        "Whether something keeps it right, such as chrony, as the kernel knows it; null if it does not report that.",
        True,
    )
    answers: typing.Optional[bool] = field(
        "Whether a time service answers, or null if none was asked.", True, added="1.1.0"
    )
    service: str = field(
        "The time service that answers, V(chrony), V(systemd-timesyncd) or V(ntpd), or empty.",
        "chrony",
        added="1.1.0",
    )
    sources: typing.Tuple[TimeSource, ...] = field(
        "The sources of time that it has, at most 32. Those without an address, such as a radio clock, are left out.",
        added="1.1.0",
    )
