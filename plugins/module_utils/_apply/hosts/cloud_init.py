# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""cloud-init, which writes /etc/hosts at every boot if its configuration says manage_etc_hosts, kept away from it.

That may be in user data, in vendor data or in a file below /etc/cloud, in any form of YAML, and may come with the
next boot. So the collection does not read it: if cloud-init is installed, its services get one file of ours by the environment
variable CLOUD_CFG, which counts more than all of them (cloud-init's helpers.ConfigMerger, the same since 2012). Nothing
of cloud-init's own is edited, and systemd is not reloaded: it reads the file at the next boot, before cloud-init runs again.
"""

import os
import typing

INSTALLED = "/etc/cloud"
BUNDLE = "hosts_entries"  # of the files that keep it away

CONFIGURATION = "/etc/rosfleet-multimaster/cloud-init.cfg"
# The service that runs the module update_etc_hosts, up to cloud-init 24.2 and since then. A drop-in for a unit that is
# not there does nothing. Its name sorts before foreign ones, so a CLOUD_CFG of the user's stays.
DROP_INS = tuple(
    f"/etc/systemd/system/{unit}.service.d/10-rosfleet-multimaster.conf" for unit in ("cloud-init", "cloud-init-main")
)

_WHY = "# Written by rosfleet.multimaster.hosts_entries: /etc/hosts has bindings of its own, which survive a boot.\n"
FILES = dict.fromkeys(DROP_INS, f"{_WHY}[Service]\nEnvironment=CLOUD_CFG={CONFIGURATION}\n")
FILES[CONFIGURATION] = f"{_WHY}manage_etc_hosts: false\n"


def plan_files(wanted: bool, records: str, root: str = "") -> typing.Any:
    """Plan the files (files.FilePlan); None if cloud-init neither is installed nor was kept away.

    `wanted` says that there are bindings to keep; `root` is a prefix of all paths, for tests.
    Raises OSError, Problem.
    """
    installed = os.path.isdir(root + INSTALLED)
    if not installed and not os.path.lexists(os.path.join(records, f"files-{BUNDLE}.json")):
        return None
    # Imported in the function that needs it: it costs more than all the rest of a run without changes.
    from ..transaction.files import FileBundle

    contents = sorted(FILES.items()) if wanted and installed else []
    entries = [{"path": root + path, "content": content, "mode": "0644"} for path, content in contents]
    return FileBundle("files", BUNDLE, records, entries).make_plan()
