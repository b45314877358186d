# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The AnsibleModule of our modules: wrong options are a sentence, and the log of a computer has what was asked for without the values.

Ansible writes all values there: the files of the nodes are half a megabyte for each run, and the label that seals what the
listeners send each other would be there for everybody who may read logs.
"""

import typing

from ansible.module_utils.basic import AnsibleModule
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module import ends

#: The sentence for what ansible-core (2.19 and before) looks into before it has seen that it is no object.
NO_OBJECT = "A list among the options has an item that is no object, expected items of names and values, as the documentation has them."


class Module(AnsibleModule):
    """An AnsibleModule with a short line in the log."""

    def __init__(self, **given: typing.Any) -> None:
        try:
            super().__init__(**given)
        except TypeError:
            ends.fail(self, NO_OBJECT)

    def _log_invocation(self) -> None:
        asked = sorted(name for name, value in self.params.items() if value not in (None, "", [], {}))
        self.log(f"Invoked with {', '.join(asked)}" if asked else "Invoked")
