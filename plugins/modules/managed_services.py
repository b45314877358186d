# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: managed_services
short_description: Own systemd units whole, running with their current inputs
version_added: "1.0.0"
description:
  - Writes a list of systemd units, the bundle, enables and starts them in the order of the list, and removes its
    units that are no longer listed. An empty list removes the whole bundle, with the state, cache, log and
    configuration folders that systemd made for these units.
  - A unit is restarted when its text changes, and when its process runs with other inputs than planned. The planned
    inputs are the value of a line C(Environment=ROSFLEET_INPUTS=<digest>) in its content, for example a digest of all
    files that the service reads when it starts. The present inputs are those in the environment of the running process.
    So a service is restarted when it has to be, also after a run that was interrupted before the restart.
  - A unit is restarted, too, when a file below C(/etc) that its content names was written more than 5 s after its
    process started. So a file that a person or a program changed, and that is restored, counts for the service that has read it.
  - A unit that systemd restarts together with another one (C(PartOf=), C(BindsTo=), C(Requires=)) is not restarted
    twice.
  - A unit counts as started when systemd says so, hence C(Type=notify) proves most. All units are looked at once more
    after the last start; a second later, unless all that were started say when they are up (C(Type=notify), C(Type=oneshot),
    C(Type=dbus)), so a service that ends at once is found. C(Type=oneshot) needs
    C(RemainAfterExit=yes).
  - If a unit does not start, the module rolls back the texts, links and running units. Then it fails with the state of
    the unit and the end of its journal.
  - A unit of the same name that this module did not write is never changed; the module fails before it changes
    anything. A unit text of the bundle that was changed by hand (drift) is restored.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
options:
  bundle:
    description:
      - The label of the set, for example V(multimaster), of 1 to 64 letters, digits, dots, hyphens and underscores.
        Each label is a set of its own, with the record C(services-<bundle>.json) in O(records).
    type: str
    required: true
  units:
    description:
      - All units of the bundle in the order of their start, which is the reverse order of their stop; for example
        V([]) removes the bundle.
    type: list
    elements: dict
    required: true
    suboptions:
      name:
        description:
          - The name of the unit, for example V(multimaster-roscore.service), which ends in C(.service), C(.socket),
            C(.timer), C(.path) or C(.target).
        type: str
        required: true
      content:
        description:
          - The whole text of the unit, for example the result of a template, written as it is.
        type: str
        required: true
      enabled:
        description:
          - V(true) starts the unit at boot. The content then needs C(WantedBy=) or the like.
        type: bool
        default: true
      started:
        description: V(true) runs the unit now, V(false) stops it.
        type: bool
        default: true
  timeout:
    description: The number of seconds that each unit may take to start, for example V(90); a slow or busy computer gives it up to 210 s more.
    type: float
    default: 90
  unit_folder:
    description: The folder for the units, one of those that systemd reads, for example V(/etc/systemd/system).
    type: str
    default: /etc/systemd/system
  records:
    description:
      - The folder of this collection's records on the computer, for example V(/var/lib/rosfleet-multimaster).
    type: str
    default: /var/lib/rosfleet-multimaster
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.managed_files
"""

EXAMPLES = r"""
- name: Write the parameters of a service
  rosfleet.multimaster.managed_files:
    bundle: example
    files:
      - {path: /etc/example/seconds, content: "3600\n"}
  register: parameters

- name: Run a service with its current parameters
  rosfleet.multimaster.managed_services:
    bundle: example
    units:
      - name: example.service
        content: |
          [Unit]
          Description=Example

          [Service]
          DynamicUser=yes
          Environment=ROSFLEET_INPUTS={{ parameters.digest }}
          ExecStart=/bin/sh -c 'exec sleep "$(cat /etc/example/seconds)"'
          Restart=always

          [Install]
          WantedBy=multi-user.target

- name: Remove it
  rosfleet.multimaster.managed_services:
    bundle: example
    units: []
"""

RETURN = r"""
units:
  description: Every planned unit in the order of O(units), read back from systemd after the last step.
  returned: success
  type: list
  elements: dict
  sample:
    - name: multimaster-sync.service
      state: restarted
      actions: [write, reenable, restart]
      why: its text changed
      active_state: active
      sub_state: running
      unit_file_state: enabled
      main_pid: 812
      since: Sat 2026-11-21 03:14:15 UTC
      inputs: 5891b5b522d5
      inputs_running: 5891b5b522d5
      restarts: 0
  contains:
    name:
      description: The name.
      returned: always
      type: str
      sample: multimaster-sync.service
    state:
      description:
        - V(restarted), V(started), V(stopped), V(written), V(enabled), V(disabled) or V(unchanged), the first that
          applies. In check mode, the state that it would have.
      returned: always
      type: str
      sample: restarted
    actions:
      description:
        - All that was done, of V(write), V(enable), V(reenable), V(disable), V(start), V(restart), V(follow) (systemd
          restarted it with another unit) and V(stop).
      returned: always
      type: list
      elements: str
      sample: [write, reenable, restart]
    why:
      description: The reason why it was started, restarted or stopped, or an empty text.
      returned: always
      type: str
      sample: its text changed
    active_state:
      description: Its state in systemd; the present one in check mode.
      returned: always
      type: str
      sample: active
    sub_state:
      description: Its state in more detail.
      returned: always
      type: str
      sample: running
    unit_file_state:
      description: The state of its file in systemd, which says if it starts at boot.
      returned: always
      type: str
      sample: enabled
    main_pid:
      description: The number of its process, or 0.
      returned: always
      type: int
      sample: 812
    since:
      description: The time when it became active, or an empty text.
      returned: always
      type: str
      sample: Sat 2026-11-21 03:14:15 UTC
    inputs:
      description: The planned inputs, or an empty text without such a line in the content.
      returned: always
      type: str
      sample: 5891b5b522d5
    inputs_running:
      description: The inputs of the running process, or an empty text.
      returned: always
      type: str
      sample: 5891b5b522d5
    restarts:
      description: The number of times that systemd has restarted it by itself since it was started.
      returned: always
      type: int
      sample: 0
removed:
  description: The units of the bundle that were no longer listed and were removed.
  returned: success
  type: list
  elements: str
  sample: [multimaster-old.service]
notes:
  description: A sentence for everything unusual, such as a unit text that had been changed by hand.
  returned: success
  type: list
  elements: str
  sample: []
previous_state_is_back:
  description: V(true) if everything is again as it was before this run; if not, RV(msg) names the remains.
  returned: when a unit could not be started, or something else failed half way
  type: bool
  sample: true
msg:
  description: A sentence on the changes; after a failure, on the found value, the expected one and the remedy.
  returned: always
  type: str
  sample: "multimaster-sync.service was restarted (its text changed); 2 other units were right."
"""

from ..module_utils._apply.transaction.module import run_module
from ..module_utils._apply.transaction.service_bundle import CONCERN


def main() -> None:
    """Plan, and apply unless in check mode."""
    run_module(CONCERN)


if __name__ == "__main__":
    main()
