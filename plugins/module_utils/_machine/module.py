# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The AnsibleModule of our modules, which tells the log of a computer what was asked for, and not with which values.

Ansible writes all values there: the files of the nodes are half a megabyte for each run, and the label that seals what the
listeners send each other would be there for everybody who may read logs.
"""

from ansible.module_utils.basic import AnsibleModule


class Module(AnsibleModule):
    """An AnsibleModule with a short line in the log."""

    def _log_invocation(self) -> None:
        asked = sorted(name for name, value in self.params.items() if value not in (None, "", [], {}))
        self.log(f"Invoked with {', '.join(asked)}" if asked else "Invoked")
