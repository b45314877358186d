# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_bundle
short_description: Write one file for a maintainer
version_added: "1.0.0"
description:
  - Writes a ZIP archive with the plan of the fleet, the measurements of every computer, the report as a page and as data, versions,
    and the last lines of the services' logs. All files in it are JSON, HTML or text.
  - Passwords, keys and tokens are taken out. They are known by the names of variables and parameters (C(ansible_password), C(api_key)), by
    their form (private keys, tokens of services, URLs with a password), and by their value, if a variable of the inventory has it that is
    not the collection's, or is encrypted by C(ansible-vault), or if it was given to C(--ask-pass) or C(--ask-become-pass). Read the
    file before you give it to others.
  - M(rosfleet.multimaster.fleet_report) judges such a file again without any robot.
  - The file is written as a whole or not at all, and can be read only by the user.
  - Runs on the controller and connects to no host, so it is run once.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
  - rosfleet.multimaster.results
  - rosfleet.multimaster.results.packet_trace
attributes:
  check_mode:
    description: Writes the file in check mode, too, since it changes no computer of the fleet.
    support: none
  diff_mode:
    description: Shows nothing as a difference.
    support: none
  idempotent:
    description: A second run writes the file anew, with another time in it.
    support: none
options:
  path:
    description:
      - The file to write, for example V(bundle.zip). A file of that name is replaced.
      - In a folder, which exists or ends with a slash, it gets a name with the time.
    type: str
    required: true
  anonymous:
    description:
      - Whether names and addresses are replaced by others, the same ones everywhere, also in logs. Robots become C(robot1), computers
        C(robot1-computer2), persons C(user1), other hosts C(host1). A network becomes another one of the same length, and an address keeps
        its place in it, so the structure of the fleet can be read. Hardware addresses are replaced, too.
      - Names of topics, services and nodes stay, but for the names of robots and computers in them.
    type: bool
    default: false
  fleet:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  multicast:
    description: The name of the variable that every computer registered from C(multicast_verify), for example V(verify_probe.multicast).
    type: str
    required: true
  probe:
    description: The name of the variable that every computer registered from C(multimaster_verify), for example V(verify_probe).
    type: str
    required: true
  logs:
    description: The name of the variable that every computer registered from M(rosfleet.multimaster.multimaster_logs_info), for example
      V(verify_logs); empty for no logs. Of each computer the last 60000 letters are kept, of all computers 4000000.
    type: str
    default: ""
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_report
  - module: rosfleet.multimaster.multimaster_logs_info
"""

EXAMPLES = r"""
- name: Verify the fleet, and write a bundle for a maintainer
  hosts: robots
  gather_facts: false
  become: true
  roles:
    - role: rosfleet.multimaster.verify # it registers the measurements of its tasks, and fails after its judgement
      ignore_errors: true
  tasks:
    - name: Write a bundle
      rosfleet.multimaster.fleet_bundle:
        fleet: "{{ multimaster_fleet }}"
        multicast: verify_probe.multicast
        probe: verify_probe
        machine: verify_started.machine
        path: bundle.zip
        anonymous: true
      run_once: true
"""

RETURN = r"""
path:
  description: The file that was written.
  returned: success
  type: str
  sample: /home/operator/bundle.zip
bytes:
  description: Its size in bytes.
  returned: success
  type: int
  sample: 81234
msg:
  description: The result in a sentence.
  returned: always
  type: str
  sample: Wrote /home/operator/bundle.zip for a maintainer. Passwords and keys were taken out if they could be recognised; read it before
    you give it away.
"""
