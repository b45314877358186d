# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The rights of this process, read before a change, so that check mode refuses the same as the real run."""

import os
import re

from .commands import text

_CAP_NET_ADMIN = 12  # linux/capability.h


def may_change_network() -> bool:
    """True if the kernel takes changes of interfaces and routes from this process (capabilities(7))."""
    return _may(1 << _CAP_NET_ADMIN)


def has_all_rights() -> bool:
    """True if this process has all capabilities that the kernel knows."""
    last = text("/proc/sys/kernel/cap_last_cap").strip()
    return _may((1 << int(last) + 1) - 1) if last.isdigit() else os.geteuid() == 0


def _may(bits: int) -> bool:
    found = re.search(r"^CapEff:\s*([0-9a-f]+)$", text("/proc/self/status"), re.MULTILINE)
    return int(found.group(1), 16) & bits == bits if found else os.geteuid() == 0
