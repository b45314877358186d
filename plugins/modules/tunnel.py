# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: tunnel
short_description: Bring the tunnel of a computer to its plan, and take it back if it cuts the controller off
version_added: "1.1.0"
description:
  - Owns the files of C(multimaster-tunnel.service), as M(rosfleet.multimaster.managed_files) owns a bundle. That unit starts by them;
    M(rosfleet.multimaster.managed_services) starts it again.
  - With O(confirm_within), the tunnel is up by copies of the new files first. They are written when the controller has reached the computer
    over a new connection; else the unit starts again by the files of before. Ansible may reach a robot by the tunnel itself.
  - Takes a key that M(rosfleet.multimaster.tunnel_key) has made into use if the files name its public half, and removes all keys
    of the tunnel with the last file. An interface or a table that a person or a program has removed under the running unit is made again.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
  - rosfleet.multimaster.confirmation
  - rosfleet.multimaster.bundle
options:
  files:
    description:
      - All files of the tunnel, as the filter P(rosfleet.multimaster.tunnel_files#filter) renders them; V([]) ends the tunnel.
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.tunnel_key
  - module: rosfleet.multimaster.fleet_keys
"""

EXAMPLES = r"""
- name: End the tunnel
  rosfleet.multimaster.tunnel:
    files: []
    confirm_within: 60
"""

RETURN = r"""
files:
  description: Every planned file in the order of O(files).
  returned: success
  type: list
  elements: dict
  sample: [{path: /etc/rosfleet-multimaster/multimaster0.conf, state: written, mode: "0600"}]
  contains:
    path:
      description: The path.
      returned: always
      type: str
      sample: /etc/rosfleet-multimaster/multimaster0.conf
    state:
      description:
        - V(unchanged), V(written) (new, or with another content or mode than before), V(edited) (it had been changed or
          removed by hand, and was restored) or V(foreign) (not written by this module, but as planned, so it stays). In
          check mode, the state that it would have.
      returned: always
      type: str
      sample: written
    mode:
      description: The planned permission bits.
      returned: always
      type: str
      sample: "0600"
removed:
  description: The files of the bundle that were no longer listed and were removed.
  returned: success
  type: list
  elements: str
  sample: [/etc/rosfleet-multimaster/multimaster0.conf]
unconfirmed:
  description: Whether the change waits for its confirmation, with O(confirm_within); the controller's result is never this one.
  returned: always, unless an option is wrong
  type: bool
  sample: false
confirm_within:
  description: Seconds for which the machine waits for the confirmation, more than was asked for after a slow run, and 0 if nothing waits.
  returned: always, unless an option is wrong
  type: int
  sample: 60
confirmed:
  description: Whether the controller confirmed the change over a new connection, with O(confirm_within).
  returned: when it did
  type: bool
  sample: true
rolled_back:
  description: Whether the change was taken back, because it was not confirmed in time or could not be completed.
  returned: failed
  type: bool
  sample: true
same_connection:
  description: Whether the confirming run came over the connection from before the change, which proves nothing.
  returned: with O(confirmation), when it did
  type: bool
  sample: true
msg:
  description: A sentence on the changes; after a failure, on the found value, the expected one and the remedy.
  returned: always
  type: str
  sample: 2 files of the bundle tunnel were written, 0 removed and 0 were right.
"""

from ..module_utils._apply.transaction.module import run_module
from ..module_utils._features.tunnel.run import CONCERN


def main() -> None:
    """Bring the tunnel to its plan."""
    run_module(CONCERN)


if __name__ == "__main__":
    main()
