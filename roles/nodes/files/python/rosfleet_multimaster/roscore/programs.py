# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The collection's own programs on this computer, as the kernel knows them: by the user of a connection."""

import contextlib
import os
from typing import Tuple

from ..edge import connections

SERVICE = "/run/multimaster-sync"  # the folder of master_sync's unit, which systemd gives to its user

End = Tuple[str, int]


def is_own(there: End, here: End) -> bool:
    """True if the other end of a connection belongs to master_sync, to root, or to the user of this process."""
    users = {0, os.geteuid()}
    with contextlib.suppress(OSError):
        users.add(os.lstat(SERVICE).st_uid)
    with contextlib.suppress(OSError):
        return connections.owner(there, here) in users
    return False
