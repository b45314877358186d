# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_computer
short_description: Bring a computer to its plan in one run, or in two if a change is to be confirmed
version_added: "1.0.0"
description:
  - Does the work of the modules of a computer's concerns, in the order of the options, with their own code and their own options.
    Most of a module's time goes into its start, so one run in place of many makes a play quick.
  - Kernel settings, routes, the packet filter and the tunnel come first. If they change at run time, and their options have
    C(confirm_within), nothing else is done in that run. The controller confirms them over a new connection, and that second run does
    the rest. If nothing of them changes, one run does all.
  - A concern that fails ends the run. Those before it stay, those after it are not begun, and changes that wait for their
    confirmation are taken back.
  - In check mode, all is shown in one run.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
options:
  sysctl:
    description: The options of M(rosfleet.multimaster.sysctl).
    type: dict
  routes:
    description: The options of M(rosfleet.multimaster.routes).
    type: dict
  firewall:
    description: The options of M(rosfleet.multimaster.firewall).
    type: dict
  tunnel:
    version_added: "1.1.0"
    description: The options of M(rosfleet.multimaster.tunnel).
    type: dict
  hosts_entries:
    description: The options of M(rosfleet.multimaster.hosts_entries).
    type: dict
  multimaster_packages:
    description:
      - The options of M(rosfleet.multimaster.multimaster_packages), without O(rosfleet.multimaster.multimaster_packages#module:keep).
        Missing packages are installed before files are written, and packages that are no longer wanted are removed after the services are as planned.
    type: dict
  managed_files:
    description: The options of one or more runs of M(rosfleet.multimaster.managed_files).
    type: list
    elements: dict
    default: []
  managed_services:
    description: The options of one or more runs of M(rosfleet.multimaster.managed_services).
    type: list
    elements: dict
    default: []
  shells:
    description:
      - The values that shells are to have at the end. If files were written, the module reads the new values, as RV(shells), and the
        controller compares it; a variable that does not arrive is a failure.
      - In check mode nothing is compared.
    type: dict
    suboptions:
      variables:
        description: The variables of the plan, for example C(ROS_MASTER_URI) V(http://kobuki1computer:11311).
        type: dict
        default: {}
      before:
        description: The values of shells before, as RV(rosfleet.multimaster.multimaster_info#module:environment); it holds if nothing is written.
        type: dict
        default: {}
      files:
        description: The paths of the files that carry the variables, for example V(/etc/profile.d/rosfleet-multimaster.sh). Who reads none
          of them is not asked.
        type: list
        elements: str
        default: []
      exports:
        description: Variables of which an older export is known, for example V(ROS_MASTER_URI). Login shells may have another value of these.
        type: list
        elements: str
        default: []
      notes:
        description: Sentences about consumers that the variables do not reach on this computer; they become warnings.
        type: list
        elements: str
        default: []
      reach:
        version_added: "1.1.0"
        description: The variables that shells are to get of them and of the folders of the collection.
        type: str
        choices:
          all: The variables and the folders.
          names: Only the variables.
          none: Nothing.
        default: all
seealso:
  - module: rosfleet.multimaster.sysctl
  - module: rosfleet.multimaster.routes
  - module: rosfleet.multimaster.firewall
  - module: rosfleet.multimaster.tunnel
  - module: rosfleet.multimaster.hosts_entries
  - module: rosfleet.multimaster.multimaster_packages
  - module: rosfleet.multimaster.managed_files
  - module: rosfleet.multimaster.managed_services
author:
  - rosfleet contributors (@rosfleet)
"""

EXAMPLES = r"""
- name: Route to the other robot, and bind its name
  rosfleet.multimaster.multimaster_computer:
    routes:
      routes:
        - destination: 192.168.12.0/24
          gateway: 192.168.1.202
      confirm_within: 60
    hosts_entries:
      entries:
        - address: 192.168.12.100
          names: [kobuki2nav]
"""

RETURN = r"""
concerns:
  description:
    - The result for each concern, by the name of its module, in the order of the options. For each of its runs
      these are the return values of that module, without C(diff).
  returned: when the options are right
  type: dict
  sample:
    routes:
      - changed: true
        confirmed: true
        msg: 1 of 1 routes changed.
shells:
  description: The values of shells at the end, as RV(rosfleet.multimaster.multimaster_info#module:environment).
  returned: when O(shells) is given, files were written, and not in check mode
  type: dict
  sample:
    login: {ROS_MASTER_URI: "http://kobuki1computer:11311"}
diff:
  description: The changes of all concerns.
  returned: when the options are right
  type: list
  elements: dict
  sample: []
unconfirmed:
  description: Whether a change waits for its confirmation; the controller's result is never this one.
  returned: when no concern failed
  type: bool
  sample: false
confirm_within:
  version_added: "1.1.0"
  description: Seconds for which the machine waits for the confirmation, more than was asked for after a slow run, and 0 if nothing waits.
  returned: when no concern failed
  type: int
  sample: 60
same_connection:
  description: Whether the confirming run came over the connection from before the change, which proves nothing.
  returned: when no concern failed
  type: bool
  sample: false
rolled_back:
  description: Whether the change was taken back, because it was not confirmed in time or could not be completed.
  returned: failed
  type: bool
  sample: true
msg:
  description: The sentences of all concerns; after a failure that of the concern that failed.
  returned: always
  type: str
  sample: "1 of 1 routes changed. /etc/hosts: 1 added."
"""

from ..module_utils._apply.computer.concerns import OPTIONS, select_concerns
from ..module_utils._apply.computer.run import SHELLS, carry_out
from ..module_utils._base.module import Module


def main() -> None:
    """Carry out the concerns that were asked for."""
    module = Module(argument_spec=dict(OPTIONS, shells={"type": "dict", "options": SHELLS}), supports_check_mode=True)
    carry_out(module, select_concerns(module.params), read_back=module.params["shells"] is not None)


if __name__ == "__main__":
    main()
