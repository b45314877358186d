# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_packages
short_description: Install or remove Debian packages, and take the answer as data
version_added: "0.1.0"
description:
  - Runs M(ansible.builtin.apt) on the computer. What comes back is bounded and of the types below, as from all modules of
    this collection, since the computer may be in foreign hands.
  - Recommended packages are not installed.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
options:
  names:
    description: The names of the packages, for example V([ros-noetic-fkie-multimaster]).
    type: list
    elements: str
    required: true
  state:
    description: V(present) installs what is missing, V(absent) removes what is there.
    type: str
    choices: [present, absent]
    default: present
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: ansible.builtin.apt
"""

EXAMPLES = r"""
- name: Install the nodes of upstream
  rosfleet.multimaster.multimaster_packages:
    names: [ros-noetic-fkie-multimaster]

- name: Remove them
  rosfleet.multimaster.multimaster_packages:
    names: [ros-noetic-fkie-multimaster]
    state: absent
"""

RETURN = r"""
cache_updated:
  description: Whether the lists of the archives were fetched.
  returned: when apt was asked
  type: bool
  sample: false
cache_update_time:
  description: When the lists of the archives were fetched last, in seconds since 1970.
  returned: when apt was asked
  type: int
  sample: 1763894400
stdout:
  description: What apt printed, on one line.
  returned: when something changed, or failed
  type: str
  sample: The following NEW packages will be installed
stdout_lines:
  description: What apt printed.
  returned: when something changed, or failed
  type: list
  elements: str
  sample: [The following NEW packages will be installed]
stderr:
  description: What apt printed to standard error, on one line.
  returned: when something changed, or failed
  type: str
  sample: ""
stderr_lines:
  description: What apt printed to standard error.
  returned: when something changed, or failed
  type: list
  elements: str
  sample: []
rc:
  description: The exit status of apt.
  returned: failed
  type: int
  sample: 100
"""
