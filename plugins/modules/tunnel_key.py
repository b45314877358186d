#!/usr/bin/python
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: tunnel_key
short_description: Make the key of a computer in the tunnel, and return its public half
version_added: "1.1.0"
description:
  - Makes a private key of WireGuard on a computer that has none. The key stays there, and no answer and no difference shows it.
  - A new key waits in a file next to the one in use, whose name ends in C(.next). M(rosfleet.multimaster.tunnel) takes it into use with
    the tunnel that was confirmed, and removes all keys with the tunnel.
  - A file that others than root may read is refused, since another user may know the key.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
options:
  rotate:
    description: Whether a new key takes the place of one that is there, for example V(true) after a computer was lost and found.
    type: bool
    default: false
  path:
    description: The file of the private key, for example V(/etc/wireguard/multimaster0.key).
    type: path
    default: /etc/wireguard/multimaster0.key
  records:
    description: The folder of the records, whose lock keeps two runs apart, for example V(/var/lib/rosfleet-multimaster).
    type: path
    default: /var/lib/rosfleet-multimaster
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_keys
"""

EXAMPLES = r"""
- name: Make the key of this computer
  rosfleet.multimaster.tunnel_key:

- name: Make another one, which is used from the next run of tunnel on
  rosfleet.multimaster.tunnel_key:
    rotate: true
"""

RETURN = r"""
public_key:
  description: The public half of the key. Empty in check mode if it would be new, or if wg is not installed yet.
  returned: success
  type: str
  sample: gkP4R9BW/LAS3o72Pgyd9RV5/Y+44cDLYXHuIXhbnQY=
waiting_key:
  description: The public half of a second key, which a rotation that broke off has left next to the one in use; empty without one.
  returned: success
  type: str
  sample: ""
msg:
  description: One sentence on the change, or on the reason against it.
  returned: always
  type: str
  sample: The key was made.
"""

from ..module_utils._apply.transaction.module import run_module
from ..module_utils._features.tunnel.key import CONCERN


def main() -> None:
    """Make the key."""
    run_module(CONCERN)


if __name__ == "__main__":
    main()
