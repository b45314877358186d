# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_verdict
short_description: Fail with the result of a verification
version_added: "1.1.0"
description:
  - Fails if something was found, as M(ansible.builtin.assert) does. Ansible prints the message, and neither a condition nor a place in a playbook,
    since nothing is wrong there.
  - Runs on the controller and connects to no host, so it is run once.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  passed:
    description: Whether the run passes, for example RV(rosfleet.multimaster.fleet_report#module:passed).
    type: bool
    required: true
  fail_msg:
    description: The sentences of a failure. Empty ones are left out.
    type: list
    elements: str
    required: true
  success_msg:
    description: The sentence that is printed otherwise; empty for none.
    type: str
    default: ""
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_report
"""

EXAMPLES = r"""
- name: Verify the fleet
  hosts: robots
  gather_facts: false
  become: true
  roles:
    - role: rosfleet.multimaster.verify # it registers verify_result
      ignore_errors: true
  tasks:
    - name: Fail with a sentence of your own
      rosfleet.multimaster.fleet_verdict:
        passed: "{{ verify_result.passed }}"
        fail_msg: ["The robots stay in the garage.", "{{ verify_result.msg }}"]
      run_once: true
"""

RETURN = r"""
msg:
  description: The sentences.
  returned: always
  type: str
  sample: "FAILED: 2 of 116 checks failed; the list has 1 finding, 1 warning."
"""
