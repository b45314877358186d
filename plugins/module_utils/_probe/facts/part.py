# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The form of a part of the look at a machine."""

import typing


class Part(typing.NamedTuple):
    """A part of the machine: its name, the function that looks, its limit, and the value where it cannot look."""

    name: str
    look: typing.Callable[..., typing.Any]
    limit: float  # seconds
    nothing: typing.Any
    options: typing.Tuple[str, ...] = ()  # the arguments of `look`
