# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The table of the back ends. A new back end is one file in this folder and one row here."""

import typing

from . import contract, firewalld, nftables, ufw

#: In the order in which they are asked: the first that is active has the rules. nftables always is.
_ROWS = (
    ufw.BackEnd,
    firewalld.BackEnd,
    nftables.BackEnd,
)

BACKENDS: typing.Dict[str, typing.Type[contract.BackEnd]] = {row.name: row for row in _ROWS}
AUTO = "auto"  # the first that is active
GUARDING = nftables.BackEnd.name  # has the guards, whatever else filters packets
CHOICES = [AUTO, *BACKENDS]
