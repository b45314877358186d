# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options by which actions find what the tasks of a verification have registered."""


class ModuleDocFragment:
    """The names of variables, and the choices of the run."""

    DOCUMENTATION = r"""
options:
  packet_filter:
    description: The name of the variable that computers registered from C(firewall) in check mode, for example V(verify_filter);
      empty for none.
    type: str
    default: ""
  plan:
    description:
      - The name of the variable with the plan of each computer, which M(rosfleet.multimaster.fleet_check) returns with the facts of
        the machine, for example V(multimaster_plan); empty for none.
      - So robots that the collection did not set up are reported as such, and judged by whether they talk.
    type: str
    default: ""
  earlier:
    description:
      - The names of the variables that earlier tasks registered, for example V([multimaster_info]). A task among them
        that has failed, or found the computer unreachable, says why there is no result.
    type: list
    elements: str
    default: []
  machine:
    description: The name of the variable that every computer registered from M(rosfleet.multimaster.multimaster_info), for example
      V(multimaster_info), whose versions are reported; empty for none.
    type: str
    default: ""
  pairs:
    description:
      - Which pairs of computers were to be tried, as for the filter P(rosfleet.multimaster.computers_tried#filter), for example
        V(auto) in a fleet of 400 computers.
      - A pair that was not to be tried has no result, and is no finding.
    type: str
    choices: [auto, all]
    default: all
  streams:
    description: The name of the variable that computers registered from M(rosfleet.multimaster.multimaster_verify) with C(action=stream), for
      example V(verify_streams); empty for none.
    type: str
    default: ""
  least_mbit_s:
    description: How many Mbit/s a stream is to have at least, for example V(20). A slower one is a warning. With V(0), any is good.
    type: float
    default: 0
"""

    # Of the packet trace, after the first verification
    PACKET_TRACE = r"""
options:
  follow:
    description: The name of the variable that was registered from M(rosfleet.multimaster.fleet_packet_trace), for example V(verify_ways); empty
      for none.
    type: str
    default: ""
  sent:
    description: The name of the variable that computers registered from M(rosfleet.multimaster.multimaster_packet_trace) with C(action=send), for
      example V(verify_sent); empty for none.
    type: str
    default: ""
  followed:
    description: The name of the variable that computers registered from M(rosfleet.multimaster.multimaster_packet_trace) with C(action=collect),
      for example V(verify_captures); empty for none.
    type: str
    default: ""
  since_last_s:
    description:
      - The seconds since the last verification, as M(rosfleet.multimaster.fleet_report) returns them. A service that systemd has started
        again in this time, or in the last ten minutes, is a warning.
      - M(rosfleet.multimaster.fleet_report) itself counts from the report before, and does not need it.
    type: float
    default: 0
"""
