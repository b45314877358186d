# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Records of what is ours on a machine: one JSON file per module and purpose."""

import glob
import json
import os
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem

RECORDS = "/var/lib/rosfleet-multimaster"


class Record:
    """What one module remembers on this machine: a JSON object in a file of its own, absent while empty."""

    def __init__(self, name: str, folder: str = RECORDS) -> None:
        self.path = os.path.join(folder, name + ".json")

    def load(self) -> typing.Dict[str, typing.Any]:
        """The remembered object, or an empty one. Raises Problem where the file is not ours to read."""
        try:
            content = atomic.read_bytes(self.path)
        except OSError as problem:
            raise Problem(
                "The record %s cannot be read (%s); expected a file that this module wrote: run as root (become: true)."
                % (self.path, problem.strerror)
            ) from problem
        if content is None:
            return {}
        try:
            data = json.loads(content.decode("utf-8"))
        except ValueError as problem:
            raise Problem(
                "The record %s is not readable as JSON (%s); expected what this module wrote there: "
                "restore it from a backup, or remove it and what it owned by hand." % (self.path, problem)
            ) from problem
        if not isinstance(data, dict):
            raise Problem("The record %s holds no JSON object; remove it to start without a memory." % self.path)
        return data

    def save(self, data: typing.Dict[str, typing.Any]) -> None:
        """Remember an object; an empty one removes the file, and the folder with the last file."""
        folder = os.path.dirname(self.path)
        if data:
            atomic.make_folders(folder)
            text = json.dumps(data, indent=2, sort_keys=True) + "\n"
            atomic.write_by_rename(self.path, text.encode("utf-8"), mode=0o600)
        else:
            atomic.remove_leftovers(self.path)
            atomic.remove(self.path)
            atomic.remove_folder_if_empty(folder)


def records(folder: str = RECORDS) -> typing.List[str]:
    """The names of the records on this machine, sorted."""
    return sorted(os.path.basename(path)[:-5] for path in glob.glob(os.path.join(glob.escape(folder), "*.json")))
