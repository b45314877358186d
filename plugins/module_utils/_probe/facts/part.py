# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The form of a part of the look at a machine."""

import typing


class FactPart(typing.NamedTuple):
    """A part of the machine: its name, which is a key of the answer, the function that looks, and its limit."""

    name: str
    look: typing.Callable[..., typing.Any]
    limit: float  # seconds
    options: typing.Tuple[str, ...] = ()  # the arguments of `look`
