# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_adopt
short_description: Write the inventory of robots that were set up by hand
version_added: "1.0.0"
description:
  - Finds out which robots there are from the facts that M(rosfleet.multimaster.multimaster_info) has read on a list of machines. These are
    the common network, the robots' own networks, gateways, roscores, the router, and the multicast group and ports of the
    discovery nodes.
  - Writes an inventory folder with a comment at everything that had to be guessed. Machines that belong to no robot, or that
    could not be read, are named in comments.
  - How a machine is reached is taken over from the list as it is written there, but for passwords and other secrets.
  - A folder that is there and not empty is refused. In check mode nothing is written. With C(--diff) the files are shown.
  - Runs on the controller and connects to no host.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
attributes:
  idempotent:
    description: A second run refuses the folder of the first one, which may have been corrected since.
    support: none
options:
  machines:
    description: The names of the machines in Ansible's inventory, for example V([kobuki1computer, kobuki2computer]).
    type: list
    elements: str
    required: true
  machine:
    description: The name of the variable that every machine registered from C(multimaster_info), for example V(adopt_found), with the
      parts V(system), V(interfaces), V(routing), V(forwarding), V(masters), V(exports) and V(environment).
    type: str
    required: true
  path:
    description: The folder to write, for example V(inventory-adopted). A relative path begins at the current folder.
    type: path
    required: true
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multimaster_info
  - module: rosfleet.multimaster.fleet_plan
"""

EXAMPLES = r"""
- name: Look at the machines
  hosts: all
  gather_facts: false
  become: true
  tasks:
    - name: Look at the machine
      rosfleet.multimaster.multimaster_info:
        parts: [system, owned, interfaces, routing, forwarding, masters, exports, environment]
      register: adopt_found

- name: Write the inventory
  hosts: localhost
  gather_facts: false
  tasks:
    - name: Write the inventory
      rosfleet.multimaster.fleet_adopt:
        machines: "{{ groups.all }}"
        machine: adopt_found
        path: inventory-adopted
"""

RETURN = r"""
path:
  description: The folder of the inventory.
  returned: success
  type: str
  sample: /home/operator/inventory-adopted
files:
  description: The text of each file, by its path in the folder.
  returned: success
  type: dict
  sample: {group_vars/kobuki1.yml: "# What only the robot kobuki1 has.\n---\nmultimaster_master: kobuki1computer\n"}
guesses:
  description: A sentence for each value that was guessed, and for further things to read.
  returned: success
  type: list
  elements: str
  sample: ["group_vars/tibi.yml: multimaster_gateway is tibi-visio: it does not forward packets now (net.ipv4.ip_forward is 0)"]
left_out:
  description: A sentence for each machine that is not in the inventory.
  returned: always
  type: list
  elements: str
  sample: ["printer: left out, since no roscore runs on it, and its ROS_MASTER_URI names none of the others."]
problems:
  description: A sentence for each thing that C(site.yml) would refuse in the inventory.
  returned: success
  type: list
  elements: str
  sample: []
msg:
  description: The result in one sentence.
  returned: always
  type: str
  sample: "Wrote /home/operator/inventory-adopted: 2 robots with 2 computers; 0 comments to read. Next: ansible-playbook -i
    /home/operator/inventory-adopted rosfleet.multimaster.site --check --diff"
"""
