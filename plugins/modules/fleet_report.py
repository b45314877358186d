# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_report
short_description: Judge what all computers have seen of each other
version_added: "0.1.0"
description:
  - Reads what M(rosfleet.multimaster.multicast_verify) and M(rosfleet.multimaster.multimaster_verify) have returned on
    all computers of the play, compares it with the plan of M(rosfleet.multimaster.fleet_plan), and prints a table, a
    matrix where there are at most sixteen computers, and for everything that is not as it should be what was expected,
    what was found, the likely cause and what to do.
  - Each finding that only follows from another one says so, and is not explained again.
  - It is a judgement, so a failed check is a result and no failure; RV(passed) tells, for an assertion after it.
  - A computer that is unreachable, or gave no result, is a finding of its own.
  - With C(--limit), only the computers of the play are judged, each against all others as far as these take part.
  - Runs on the controller and connects to no host, so it is run once.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  fleet:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  multicast:
    description: The name of the variable that every computer registered from C(multicast_verify), for example
      V(verify_multicast).
    type: str
    required: true
  probe:
    description: The name of the variable that every computer registered from C(multimaster_verify), for example
      V(verify_probe).
    type: str
    required: true
  packet_filter:
    description: The name of the variable that computers registered from C(firewall) in check mode, for example V(verify_filter);
      empty for none.
    type: str
    default: ""
  plan:
    description:
      - The name of the variable with the plan of each computer, which M(rosfleet.multimaster.fleet_check) returns with what it found on
        the machine, for example V(multimaster_plan); empty for none.
      - So robots that the collection did not set up are told as such, and judged by whether they talk.
    type: str
    default: ""
  earlier:
    description:
      - The names of the variables that earlier tasks registered, for example V([multimaster_info]). A task among them
        that has failed, or found the computer unreachable, says why there is no result.
    type: list
    elements: str
    default: []
  path:
    description: A file on the controller for all findings as JSON, for example V(verification.json). None, if empty.
    type: str
    default: ""
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multicast_verify
  - module: rosfleet.multimaster.multimaster_verify
"""

EXAMPLES = r"""
- name: Judge what all computers have seen of each other
  rosfleet.multimaster.fleet_report:
    fleet: "{{ multimaster_fleet }}"
    multicast: verify_multicast
    probe: verify_probe
    path: verification.json
  run_once: true
  register: verification

- name: Fail if a check failed
  ansible.builtin.assert:
    that: verification.passed
    fail_msg: "{{ verification.msg }}"
  run_once: true
"""

RETURN = r"""
passed:
  description: Whether no check failed.
  returned: success
  type: bool
  sample: true
checks:
  description: The checks that were made.
  returned: success
  type: list
  elements: dict
  sample: [{check: ping_name, title: ping by name, ok: 2, warning: 0, failed: 0, unknown: 0}]
  contains:
    check:
      description: The name of the check.
      returned: always
      type: str
      sample: ping_name
    title:
      description: What it looks at.
      returned: always
      type: str
      sample: ping by name
    ok:
      description: For how many computers or pairs it is as expected.
      returned: always
      type: int
      sample: 2
    warning:
      description: For how many it is not, without keeping the robots from each other.
      returned: always
      type: int
      sample: 0
    failed:
      description: For how many it failed.
      returned: always
      type: int
      sample: 0
    unknown:
      description: For how many it could not be judged.
      returned: always
      type: int
      sample: 0
findings:
  description: Everything that is not as expected.
  returned: success
  type: list
  elements: dict
  sample:
    - check: name
      observer: kobuki1computer
      target: kobuki2computer
      verdict: failed
      expected: 192.168.1.239
      found: Name or service not known
      cause: the name is not known there
      remedy: run site.yml, which writes /etc/hosts
      because: ""
  contains:
    check:
      description: The name of the check.
      returned: always
      type: str
      sample: name
    observer:
      description: The computer that has looked.
      returned: always
      type: str
      sample: kobuki1computer
    target:
      description: The computer at which it has looked, or itself.
      returned: always
      type: str
      sample: kobuki2computer
    verdict:
      description: V(warning), V(failed) or V(unknown).
      returned: always
      type: str
      sample: failed
    expected:
      description: What was expected.
      returned: always
      type: str
      sample: 192.168.1.239
    found:
      description: What was found.
      returned: always
      type: str
      sample: Name or service not known
    cause:
      description: The likely cause, or empty.
      returned: always
      type: str
      sample: the name is not known there
    remedy:
      description: What to do, or empty.
      returned: always
      type: str
      sample: run site.yml, which writes /etc/hosts
    because:
      description: The check whose failure explains this one, or empty.
      returned: always
      type: str
      sample: ""
msg:
  description: The result in one sentence.
  returned: success
  type: str
  sample: "PASSED: none of 38 checks failed."
"""
