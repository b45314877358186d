# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""What this process may do: asked before a change, so that check mode refuses what the real run would."""

import errno
import os
import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.commands import text
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import sentence

_CAP_NET_ADMIN = 12  # linux/capability.h


def may_change_network() -> bool:
    """True where the kernel takes changes of interfaces and routes from this process (capabilities(7))."""
    found = re.search(r"^CapEff:\s*([0-9a-f]+)$", text("/proc/self/status"), re.MULTILINE)
    return bool(int(found.group(1), 16) >> _CAP_NET_ADMIN & 1) if found else os.geteuid() == 0


def unwritable(paths: typing.Iterable[str]) -> typing.Optional[str]:
    """The sentence for the first of these files that cannot be made, replaced or removed in its folder; None for none."""
    for path in paths:
        folder = os.path.dirname(path)
        while folder and not os.path.exists(folder):
            folder = os.path.dirname(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            number = errno.EROFS if os.statvfs(folder).f_flag & os.ST_RDONLY else errno.EACCES
            return sentence(OSError(number, os.strerror(number), path))
    return None
