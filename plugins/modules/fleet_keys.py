# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_keys
short_description: Gather the public keys of the tunnel, and keep them
version_added: "1.1.0"
description:
  - Takes the key that each computer reported by its own connection, and the keys that are kept in a file next to the inventory. So a run
    with C(--limit), and one without a robot that is lost, know the keys of all.
  - A computer is refused if its key has changed and O(rotate) is false, if its key has not the form of a key, and if another computer has
    the same key. The other computers go on. A computer that is no longer in the plan loses its place.
  - Runs on the controller and connects to no host, so it is run once. Nothing in the file is secret.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  fleet:
    description: The plan of the fleet, as M(rosfleet.multimaster.fleet_plan) returns it.
    type: dict
    required: true
  told:
    description: The name of the variable that the runs of C(tunnel_key) were registered in, for example V(tunnel_own_key).
    type: str
    required: true
  path:
    description: The file with the keys, for example V(inventory/multimaster_tunnel_keys.txt).
    type: path
    required: true
  rotate:
    description: Whether changed keys are believed, for example V(true) after computers have made new ones.
    type: bool
    default: false
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.tunnel_key
"""

EXAMPLES = r"""
- name: Make the plan
  rosfleet.multimaster.fleet_plan:
  register: planned
  run_once: true

- name: Make the key of each computer
  rosfleet.multimaster.tunnel_key:
  register: own_key

- name: Gather the keys
  rosfleet.multimaster.fleet_keys:
    fleet: "{{ planned }}"
    told: own_key
    path: inventory/multimaster_tunnel_keys.txt
  register: gathered
  run_once: true

- name: Refuse a computer whose key is not believed
  ansible.builtin.assert:
    that: inventory_hostname not in gathered.refused
    fail_msg: "{{ gathered.refused[inventory_hostname] }}"
    quiet: true
"""

RETURN = r"""
keys_by_computer:
  description: The public key of each computer of the tunnel that has one.
  returned: success
  type: dict
  sample: {kobuki1computer: gkP4R9BW/LAS3o72Pgyd9RV5/Y+44cDLYXHuIXhbnQY=}
refused:
  description: A sentence for each computer whose key is not believed. The others have the one of it that is kept, or none.
  returned: success
  type: dict
  sample: {}
msg:
  description: One sentence on the change, or on the reason against it.
  returned: always
  type: str
  sample: 2 computers have a key.
"""
