# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Whether cloud-init, which may write /etc/hosts at every boot, concerns this machine. What is done about it: guard.py."""

import os

INSTALLED = "/etc/cloud"
RECORD = "files-hosts_entries.json"  # there while cloud-init is kept away

# The files that keep it away.
CONFIGURATION = "/etc/rosfleet-multimaster/cloud-init.cfg"
# The service that runs the module update_etc_hosts, up to cloud-init 24.2 and since then. A drop-in for a unit that is
# not there does nothing. Its name sorts before those of others, so a CLOUD_CFG of the user's stays.
DROP_INS = tuple(
    f"/etc/systemd/system/{unit}.service.d/10-rosfleet-multimaster.conf" for unit in ("cloud-init", "cloud-init-main")
)

_WHY = "# Written by rosfleet.multimaster.hosts_entries: /etc/hosts has bindings of its own, which survive a boot.\n"
FILES = dict.fromkeys(DROP_INS, f"{_WHY}[Service]\nEnvironment=CLOUD_CFG={CONFIGURATION}\n")
FILES[CONFIGURATION] = f"{_WHY}manage_etc_hosts: false\n"


def is_concerned(records: str, root: str = "") -> bool:
    """True where cloud-init is installed, or is kept away by an earlier run; `root` is a prefix of all paths, for tests."""
    return os.path.isdir(root + INSTALLED) or os.path.lexists(os.path.join(records, RECORD))
