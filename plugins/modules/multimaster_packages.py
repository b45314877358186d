#!/usr/bin/python
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_packages
short_description: Install Debian packages, and remove those that it has installed itself
version_added: "1.0.0"
description:
  - Installs missing packages, without recommended packages, from the package sources that the computer has.
  - A package that was there before is removed only if a new one replaces it, as chrony replaces systemd-timesyncd. It is back when the
    new one is removed.
  - The record of both is C(/etc/rosfleet-multimaster/packages). It is written before the first package is installed, so what an
    interrupted run has installed is taken back, too.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
options:
  names:
    description: All packages that are to be there, for example V([ros-noetic-fkie-multimaster]); V([]) removes those that the module has installed.
    type: list
    elements: str
    required: true
  keep:
    description: Whether packages that are wanted no more stay, for example V(true) as long as a service needs them.
    type: bool
    default: false
  records:
    description: The folder of the records, for example V(/var/lib/rosfleet-multimaster).
    type: str
    default: /var/lib/rosfleet-multimaster
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: ansible.builtin.apt
  - module: rosfleet.multimaster.multimaster_computer
"""

EXAMPLES = r"""
- name: Install the nodes of upstream
  rosfleet.multimaster.multimaster_packages:
    names: [ros-noetic-fkie-multimaster]

- name: Remove the packages that were installed
  rosfleet.multimaster.multimaster_packages:
    names: []
"""

RETURN = r"""
installed:
  description: The packages that were missing, and are installed now.
  returned: success
  type: list
  elements: str
  sample: [ros-noetic-fkie-multimaster]
removed:
  description: The packages that the module had installed, and that are wanted no more.
  returned: success
  type: list
  elements: str
  sample: []
diff:
  description: The changes of the record.
  returned: with --diff
  type: list
  elements: dict
  sample: []
msg:
  description: One sentence on the changes, or on the reason against them.
  returned: always
  type: str
  sample: 1 packages were installed, 0 removed.
"""

from ..module_utils._apply.packages.run import CONCERN
from ..module_utils._apply.transaction.module import run_module


def main() -> None:
    """Install and remove."""
    run_module(CONCERN)


if __name__ == "__main__":
    main()
