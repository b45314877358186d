#!/usr/bin/python
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: tunnel_key
short_description: Make the key of a computer in the tunnel, and tell its public half
version_added: "1.0.0"
description:
  - Makes a private key of WireGuard on a computer that has none. The key stays there, and no answer and no difference shows it.
  - A file that others than root may read is refused, since somebody may know the key.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
options:
  wanted:
    description: Whether a key is to be there, for example V(false) to remove it.
    type: bool
    default: true
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

- name: Remove it
  rosfleet.multimaster.tunnel_key:
    wanted: false
"""

RETURN = r"""
public_key:
  description: The public half of the key. Empty in check mode where it would be new, and with O(wanted=false).
  returned: success
  type: str
  sample: gkP4R9BW/LAS3o72Pgyd9RV5/Y+44cDLYXHuIXhbnQY=
msg:
  description: One sentence on what was done, or on what prevents it.
  returned: always
  type: str
  sample: The key was made.
"""

from ..module_utils._changes.module import run_module
from ..module_utils._tunnel.key import OPTIONS, TunnelKey


def main() -> None:
    """Make the key, or remove it."""
    run_module(OPTIONS, lambda module, memory: TunnelKey(module.params))


if __name__ == "__main__":
    main()
