# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Whether cloud-init, which may write /etc/hosts at every boot, concerns this machine. What is done about it: guard.py."""

import os

INSTALLED = "/etc/cloud"
RECORD = "files-hosts_entries.json"  # there while cloud-init is kept away


def concerned(records: str, root: str = "") -> bool:
    """True where cloud-init is installed, or is kept away by an earlier run; `root` is a prefix of all paths, for tests."""
    return os.path.isdir(root + INSTALLED) or os.path.lexists(os.path.join(records, RECORD))
