# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_packet_trace
short_description: Choose which packets are traced, if no value shows why they are lost
version_added: "1.0.0"
description:
  - Judges the results that the computers have registered so far, as M(rosfleet.multimaster.fleet_report) does. If something failed and
    no value shows the reason, it chooses a packet for each way that fails, at most twelve, and the computers on these ways.
  - M(rosfleet.multimaster.multimaster_packet_trace) sends and sees these packets.
  - Version 1.0.0 called it C(fleet_follow), a name that works as before.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
  - rosfleet.multimaster.results
options:
  fleet:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  multicast:
    description: As in M(rosfleet.multimaster.fleet_report), for example V(verify_probe.multicast).
    type: str
  probe:
    description: As in M(rosfleet.multimaster.fleet_report), for example V(verify_probe).
    type: str
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multimaster_packet_trace
  - module: rosfleet.multimaster.fleet_report
"""

EXAMPLES = r"""
- name: Verify the fleet, and show the packets that could be traced
  hosts: robots
  gather_facts: false
  become: true
  roles:
    - role: rosfleet.multimaster.verify # it registers the measurements of its tasks, and fails after its judgement
      ignore_errors: true
  tasks:
    - name: Choose the packets to trace
      rosfleet.multimaster.fleet_packet_trace:
        fleet: "{{ multimaster_fleet }}"
        probe: verify_probe
        multicast: verify_probe.multicast
      run_once: true
      register: ways
"""

RETURN = r"""
probes:
  description: The packets to send, for O(rosfleet.multimaster.multimaster_packet_trace#module:probes); none if there are no packets to trace.
  returned: success
  type: list
  elements: dict
  sample:
    - number: 0
      sender: kobuki1computer
      target: kobuki2computer
      traffic: rpc
      protocol: tcp
      address: 192.168.1.239
      port: 11611
      size: 0
      interface_address: ""
listeners:
  description: The computers that are to listen.
  returned: success
  type: list
  elements: str
  sample: [kobuki1computer, kobuki2computer]
msg:
  description: The traced packets, in a sentence.
  returned: always
  type: str
  sample: 1 way is followed, since no value shows why packets fail there.
"""
