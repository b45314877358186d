# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The collection's own programs on this computer, as the kernel knows them: by the user of a connection."""

import os
from typing import Set, Tuple

from ..edge import connections

SERVICE = "/run/multimaster-sync"  # the folder of master_sync's unit, which systemd gives to its user

End = Tuple[str, int]


def is_own(there: End, here: End) -> bool:
    """True where the other end of a connection belongs to master_sync, to root, or to the user of this process."""
    try:
        return connections.owner(there, here) in _users()
    except OSError:
        return False


def _users() -> Set[int]:
    users = {0, os.geteuid()}
    try:
        users.add(os.lstat(SERVICE).st_uid)
    except OSError:
        pass
    return users
