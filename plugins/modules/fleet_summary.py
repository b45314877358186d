# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_summary
short_description: Summarize the changes of a run on each computer
version_added: "1.0.0"
description:
  - Prints one line for the fleet, and one for each computer on which M(rosfleet.multimaster.multimaster_computer) changed
    something or failed, or which fell out of the run before. In check mode it lists the changes that a run would make.
  - With O(after), it says of each computer after a teardown if it is as before, or what is left there.
  - Runs on the controller and connects to no host, so it is run once.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  results:
    description: The names of the variables that the runs of C(multimaster_computer) were registered in, for example V([brought]).
    type: list
    elements: str
    required: true
  warnings:
    version_added: "1.1.0"
    description: The names of variables with results whose warnings are repeated, ten at most, each short.
    type: list
    elements: str
    default: []
  before:
    version_added: "1.1.0"
    description: The name of the variable in which M(rosfleet.multimaster.multimaster_info) was registered with the part V(owned) before a teardown.
    type: str
    default: ""
  after:
    version_added: "1.1.0"
    description: The same after the teardown. It makes the summary that of a teardown.
    type: str
    default: ""
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multimaster_computer
"""

EXAMPLES = r"""
- name: Set kernel settings
  rosfleet.multimaster.multimaster_computer:
    sysctl:
      settings:
        - name: net.ipv4.ip_forward
          value: "1"
  register: brought

- name: Summarize the changes
  rosfleet.multimaster.fleet_summary:
    results: [brought]
  run_once: true
"""

RETURN = r"""
computers:
  description: The changes, a line for each computer that is not as it was.
  returned: success
  type: list
  elements: str
  sample: ["kobuki1computer: kernel settings, /etc/hosts, files, services"]
warned:
  version_added: "1.1.0"
  description: The repeated warnings, with a line before them.
  returned: success
  type: list
  elements: str
  sample: []
msg:
  description: The result in one sentence.
  returned: success
  type: str
  sample: "SUMMARY: 1 of 13 computers changed."
"""
