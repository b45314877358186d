# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""cloud-init, which writes /etc/hosts at every boot where its configuration says manage_etc_hosts, told to leave it alone.

That may stand in user data, in vendor data or in a file below /etc/cloud, in any form of YAML, and may come with the
next boot. So none of it is read: where cloud-init is installed, its services get one file of ours by the environment
variable CLOUD_CFG, which counts more than all of them (cloud-init's helpers.ConfigMerger, the same since 2012). Nothing
of cloud-init's own is edited, and systemd is not told: it reads the file at the next boot, before cloud-init runs again.
"""

import os
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import files
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.transaction import Step, intent, outcome
from ansible_collections.rosfleet.multimaster.plugins.module_utils._hosts.cloud_init import FILES, INSTALLED


class Guard:
    """The files that keep cloud-init away, planned. Raises OSError, Problem."""

    def __init__(self, wanted: bool, records: str, root: str = "") -> None:
        """`wanted` says that there are bindings to keep; `root` is a prefix of all paths, for tests."""
        present = os.path.isdir(root + INSTALLED)
        entries = [{"path": root + path, "content": content, "mode": "0644"} for path, content in sorted(FILES.items())]
        self.record = files.record_of("files", "hosts_entries", records)
        self.wanted = files.parse_files(entries if wanted and present else [])
        self.remembered = self.record.load()
        self.machine = files.read(self.wanted, self.remembered, self.record)
        self.plan = files.plan_files(self.wanted, self.remembered, self.machine)
        self.changed = files.changes(self.plan)

    @property
    def places(self) -> typing.List[str]:
        """The paths that the steps write."""
        return files.places(self.plan, self.record)

    def around(self, steps: typing.Sequence[Step]) -> typing.List[Step]:
        """The steps of the guard, with its record, around those of the hosts file."""
        after = self.plan.after if any(self.plan.after.values()) else {}
        if not self.changed:
            return [*steps, outcome(self.record, after)]
        return [
            intent(self.record, self.plan.intent, self.remembered, failure=files.RECORD_RESTORE_FAILURE),
            *files.steps(self.plan, self.machine),
            *steps,
            outcome(self.record, after),
        ]

    @property
    def items(self) -> typing.List[typing.Dict[str, str]]:
        """The files, each with what becomes of it."""
        items = [{"path": item.path, "state": item.state} for item in self.plan.items]
        return items + [{"path": path, "state": "removed"} for path in self.plan.removals]

    @property
    def differences(self) -> typing.List[typing.Dict[str, str]]:
        """Their entries of the module's `diff`."""
        return files.differences(self.plan, self.machine)
