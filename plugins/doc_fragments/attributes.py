# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sentences that the documentation of every module of this collection shares."""


class ModuleDocFragment:
    """The attributes of a module: what it supports, in the words of Ansible's documentation."""

    DOCUMENTATION = r"""
options: {}
attributes:
  check_mode:
    description: Can run in C(check_mode) and return the changes it would make, without making them.
    support: full
  diff_mode:
    description: Returns what changed, or in check mode would change, when in diff mode.
    support: full
  idempotent:
    description: A second run with the same options changes nothing.
    support: full
  platform:
    description: The systems on which the module runs.
    platforms: linux
    support: full
"""

    # For modules that only read: nothing changes, so there is nothing to show as a difference.
    INFO = r"""
options: {}
attributes:
  check_mode:
    description: Changes nothing, so check mode makes no difference.
    support: full
  diff_mode:
    description: Changes nothing, so there is no difference to show.
    support: N/A
  idempotent:
    description: Changes nothing.
    support: full
  platform:
    description: The systems on which the module runs.
    platforms: linux
    support: full
"""

    # For modules that measure: they send packets, and may leave a process behind for a while.
    PROBE = r"""
options: {}
attributes:
  check_mode:
    description: Changes no file and no setting, so check mode shows no change.
    support: full
  diff_mode:
    description: Changes no file and no setting, so there is no difference to show.
    support: N/A
  idempotent:
    description: Changes no file and no setting.
    support: full
  platform:
    description: The systems on which the module runs.
    platforms: linux
    support: full
"""
