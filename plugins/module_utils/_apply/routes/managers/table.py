# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The table of the back ends. A new back end is one file in this folder and one row here."""

import typing

from . import contract, ifupdown, netplan, networkd, networkmanager

#: The back ends in the order in which they are asked for an interface: the first that owns it brings its routes back.
#: netplan is asked before the managers that it writes for.
_ROWS = (
    netplan.BackEnd,
    networkd.BackEnd,
    networkmanager.BackEnd,
    ifupdown.BackEnd,
)

BACKENDS: typing.Dict[str, typing.Type[contract.BackEnd]] = {row.name: row for row in _ROWS}
AUTO = "auto"  # the back end that owns the interface
NONE = "none"  # no back end: the route is made at run time only
CHOICES = [AUTO, *BACKENDS, NONE]
