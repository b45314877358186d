# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_due
short_description: Look in one run whether a computer is as its plan says
version_added: "0.5.0"
description:
  - Plans what the modules of a computer's concerns would do, with their own code and their own options, and changes nothing.
  - Where nothing is due, none of these modules needs to run. This is one run instead of six on each computer of a fleet that is as
    planned.
  - A concern is due where its module would change or refuse anything, where an earlier run was broken off, and where its options are wrong.
    So its module runs and says the sentence.
  - What a module warns of on a computer that is as planned, such as a second default route, is a warning here, too.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  sysctl:
    description: The options of M(rosfleet.multimaster.sysctl), without those of a confirmation.
    type: dict
  routes:
    description: The options of M(rosfleet.multimaster.routes), without those of a confirmation.
    type: dict
  hosts_entries:
    description: The options of M(rosfleet.multimaster.hosts_entries).
    type: dict
  managed_files:
    description:
      - The options of one or more runs of M(rosfleet.multimaster.managed_files).
      - In place of C(content) a file may have C(sha256), its digest in hexadecimal, as the filter P(rosfleet.multimaster.file_sums#filter)
        makes it. So the content need not travel.
    type: list
    elements: dict
    default: []
  managed_services:
    description: The options of one or more runs of M(rosfleet.multimaster.managed_services).
    type: list
    elements: dict
    default: []
  other:
    description:
      - What the controller knows to be due. Everything that is not empty, zero or V(false) counts.
      - For example the packages that are to be installed.
    type: list
    elements: raw
    default: []
author:
  - rosfleet contributors (@rosfleet)
"""

EXAMPLES = r"""
- name: Look whether anything is due
  rosfleet.multimaster.multimaster_due:
    routes:
      routes:
        - destination: 192.168.60.0/24
          gateway: 192.168.1.229
    managed_files:
      - bundle: example
        files:
          - path: /etc/example/names
            content: "kobuki1\n"
  register: example_found

- name: Leave the other tasks out where nothing is
  ansible.builtin.meta: end_host
  when: example_found.due | length == 0
"""

RETURN = r"""
due:
  description: The concerns whose module has anything to do, by the names of the options.
  returned: success
  type: list
  elements: str
  sample: [routes, managed_services]
msg:
  description: What was found, in a sentence.
  returned: success
  type: str
  sample: Nothing is due.
"""

import os
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import deadman
from ansible_collections.rosfleet.multimaster.plugins.module_utils._computer.concerns import (
    CONCERNS,
    Concern,
    Options,
    Tools,
    asked_for,
    validated,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ends
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.module import Module
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem


def no_command(*words: typing.Any, **settings: typing.Any) -> typing.Tuple[int, str, str]:
    """Stand for the command that checks a file to be written: here none is written."""
    raise Problem("A file is to be checked, although only looking was asked for.")


def no_backup(path: str) -> str:
    """Stand for the copy of a file to be written: here none is written."""
    raise Problem(f"{path} is to be copied, although only looking was asked for.")


LOOKING = Tools(no_command, no_backup)


def looked_at(
    parameters: Options, concerns: typing.Iterable[Concern] = CONCERNS, switches: str = deadman.FOLDER
) -> typing.Tuple[typing.List[str], typing.List[str]]:
    """Return the concerns that are due, and what the others warn of."""
    due: typing.List[str] = ["other"] if any(parameters["other"]) else []
    warnings: typing.List[str] = []
    for concern, options in asked_for(parameters, concerns):
        said = None if concern.name in due else warnings_of(concern, options, switches)
        if said is not None:
            warnings += said
        elif concern.name not in due:
            due.append(concern.name)
    return due, warnings


def warnings_of(concern: Concern, options: Options, switches: str) -> typing.Optional[typing.List[str]]:
    """Return what the module would warn of where it has nothing to do, else None."""
    if concern.guarded and os.path.lexists(os.path.join(switches, f"rollback-{concern.name}")):
        return None
    code = concern.load()
    try:
        run = code.make(validated(concern, by_digest(concern, code.options), options), None, LOOKING)
        return None if run.due or run.refusals else run.warnings
    except Problem:
        return None


def by_digest(concern: Concern, specification: Options) -> Options:
    """Return the options of a concern, in which a file may have its digest in place of its content."""
    if concern.name != "managed_files":
        return specification
    text = dict(type="str", default="")
    file = dict(specification["files"]["options"], content=text, sha256=text)
    return dict(specification, files=dict(specification["files"], options=file))


def main() -> None:
    """Look, and say what is due."""
    module = Module(
        argument_spec={
            "sysctl": {"type": "dict"},
            "routes": {"type": "dict"},
            "hosts_entries": {"type": "dict"},
            "managed_files": {"type": "list", "elements": "dict", "default": []},
            "managed_services": {"type": "list", "elements": "dict", "default": []},
            "other": {"type": "list", "elements": "raw", "default": []},
        },
        supports_check_mode=True,
    )
    due, warnings = looked_at(module.params)
    for sentence in [] if due else warnings:
        ends.warn(module, sentence)
    ends.leave(module, changed=False, due=due, msg=f"Due: {', '.join(due)}." if due else "Nothing is due.")


if __name__ == "__main__":
    main()
