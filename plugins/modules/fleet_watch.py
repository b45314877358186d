# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_watch
short_description: Show the progress of a watch over the fleet
version_added: "1.0.0"
description:
  - Reads the results of M(rosfleet.multimaster.multimaster_watch) on all computers of the play, and prints a line of
    progress with the losses and returns since the last one.
  - Names the moment and the place of the first loss. Of the losses within 10 seconds, that is the one nearest to the
    reason, as a link before the heartbeats that come by it.
  - Runs on the controller and connects to no host, so it is run once.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  watched:
    description: The name of the variable that every computer registered from C(multimaster_watch), for example V(verify_watch_answer).
    type: str
    required: true
  duration:
    description: How long is watched, for example V(15m).
    type: str
    required: true
  known:
    description: How many events were listed before, as RV(known) of the round before; empty in the first round.
    type: dict
    default: {}
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multimaster_watch
"""

EXAMPLES = r"""
- name: Show the progress of the watch
  rosfleet.multimaster.fleet_watch:
    watched: verify_watch_answer
    duration: 15m
  run_once: true
  register: watch
"""

RETURN = r"""
lost:
  description: How many values of all computers are lost now.
  returned: success
  type: int
  sample: 0
first_loss:
  description: The moment and the place of the first loss, empty if nothing was lost.
  returned: success
  type: str
  sample: "First loss at 12:31:05, 4:21 after the start: dabo-nav hears no heartbeat of tibi-nav on the group [RF-813]."
advice:
  version_added: "1.1.0"
  description:
    - For the first loss, its C(id), the C(page) about it, and the commands to C(do) and to C(look) with, as M(rosfleet.multimaster.fleet_report) has them.
    - Empty if nothing was lost.
  returned: success
  type: dict
  sample: {}
events:
  description: The losses and returns on all computers, in the order of time.
  returned: success
  type: list
  elements: dict
  sample:
    - observer: dabo-nav
      kind: group
      name: tibi-nav
      well: false
      expected: heard
      found: silent
      time: 1730000261.2
      after: 261.2
  contains:
    observer:
      description: The computer that reports it. The others are those of C(multimaster_watch).
      returned: always
      type: str
      sample: dabo-nav
known:
  description: How many events each computer has reported, for the next round.
  returned: success
  type: dict
  sample: {dabo-nav: 1}
msg:
  description: The first loss, or that nothing was lost.
  returned: always
  type: str
  sample: Nothing was lost in 15:00.
"""
