# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options of the modules whose changes can cut the controller off: the dead-man's switch."""


class ModuleDocFragment:
    """Shared by the modules that change the network of a machine."""

    DOCUMENTATION = r"""
options:
  confirm_within:
    description:
      - The seconds after which the machine takes a change at run time back by itself, unless the controller has reached it
        over a new TCP connection by then, for example V(30); V(0) for never.
      - The files for the next boot are written only after that confirmation, so a loss of power in between brings the former state back too.
      - Needs systemd on the machine. There is nothing to confirm if nothing changes at run time, or the connection is local.
    type: int
    default: 0
  confirmation:
    description:
      - The word by which the run that confirms is recognised, for example V(8c1f0a2b).
        The controller makes a new one for every task, so leave it out.
    type: str
    default: ''
"""
