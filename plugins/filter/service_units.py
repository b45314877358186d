# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The filter service_units: the units of a robot's services, for the role services."""

from __future__ import annotations

DOCUMENTATION = r"""
name: service_units
short_description: The units of the services of a robot
version_added: "1.0.0"
description:
  - Renders the units of systemd that run the roscore, the discovery node and the sync node of a robot.
  - A unit names the digest of the files that its service reads. So a service is restarted exactly when that changes.
author:
  - rosfleet contributors (@rosfleet)
positional: _input
options:
  _input:
    description: The services in the order of their start, for example V([address, watchdog, roscore, discovery, connections, sync]).
    type: list
    elements: str
    required: true
  robot:
    description: The name of the robot, for example V(kobuki1).
    type: str
    required: true
  address:
    description: The planned address of the computer, for example V(192.168.1.229).
    type: str
    required: true
  roscore_command:
    description: The path of roscore on the machine, for example V(/opt/ros/noetic/bin/roscore).
    type: str
    required: true
  roscore_port:
    description: The TCP port of the roscore, for example V(11311).
    type: int
    required: true
  programs:
    description:
      - The lines C(unit) and C(service) of the units of C(roscore), C(discovery) and C(sync), which differ by provider.
      - Without those of C(roscore) it is O(roscore_command).
    type: dict
    required: true
  environment_digest:
    description: The digest of the environment; a change of it restarts C(roscore), C(discovery), C(sync) and C(relay), which have it.
    type: str
    required: true
  files:
    version_added: "1.1.0"
    description:
      - The code and the parameters of the nodes, each with C(path) and C(sha256). A change of a file restarts the services that read it.
      - C(roscore) reads some only if O(programs) has its lines. That one remembers the registrations.
    type: list
    elements: dict
    default: []
  nodes_digest:
    description: Deprecated, see O(files). A change of it restarts C(discovery), C(connections), C(sync) and C(relay). It goes with version 2.0.0.
    type: str
    default: ""
  code_digest:
    description: Deprecated, see O(files). A change of it restarts C(roscore), if O(programs) has its lines. It goes with version 2.0.0.
    type: str
    default: ""
  metrics_folder:
    description: The folder that node_exporter reads, for C(metrics), for example V(/var/lib/prometheus/node-exporter).
    type: str
    default: ""
  tunnel_digest:
    version_added: "1.1.0"
    description: The digest of the files of the tunnel; a change of it restarts C(tunnel).
    type: str
    default: ""
"""

EXAMPLES = r"""
- name: Run the services
  rosfleet.multimaster.managed_services:
    bundle: multimaster
    units: >-
      {{ ['address', 'roscore', 'discovery', 'sync'] | rosfleet.multimaster.service_units(
           robot='kobuki1', address='192.168.1.229', roscore_command='/usr/bin/roscore', roscore_port=11311,
           programs=multimaster_plan.programs, environment_digest='4567', files=[]) }}
"""

RETURN = r"""
_value:
  description: The units, each with C(name) and C(content).
  type: list
  elements: dict
  contains:
    name:
      description: The name of the unit.
      type: str
      sample: multimaster-roscore.service
    content:
      description: Its text.
      type: str
"""

from collections.abc import Mapping, Sequence
from typing import Any

from ansible.errors import AnsibleFilterError
from ansible.utils.display import Display

from ..plugin_utils._plan import quotes, units
from ..plugin_utils._plan.model import UnitLines

_NODES = ("discovery", "connections", "sync", "relay")  # the services of nodes_digest


def service_units(
    names: Sequence[str],
    *,
    robot: str,
    address: str,
    roscore_command: str,
    roscore_port: int,
    programs: Mapping[str, Mapping[str, str]],
    environment_digest: str,
    files: Sequence[Mapping[str, str]] = (),
    nodes_digest: str = "",
    code_digest: str = "",
    metrics_folder: str = "",
    tunnel_digest: str = "",
) -> list[dict[str, str]]:
    """Return the units by name and content; see DOCUMENTATION."""
    known = (*units.OTHERS, *programs)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise AnsibleFilterError(
            f"The services to run are {', '.join(names)}; expected some of {', '.join(known)}: "
            f"take {unknown[0]} out of services_list."
        )
    if nodes_digest or code_digest:
        Display().deprecated(
            "The options nodes_digest and code_digest of the filter service_units, and services_nodes_digest and services_code_digest of "
            "the role services, have a successor: give files, or services_files, instead.",
            version="2.0.0",
            collection_name="rosfleet.multimaster",
        )
    try:
        return units.render_services(
            names,
            robot=robot,
            address=address,
            roscore_command=roscore_command,
            roscore_port=roscore_port,
            programs={name: UnitLines(lines["unit"], lines["service"]) for name, lines in programs.items()},
            environment_digest=environment_digest,
            files={file["path"]: file["sha256"] for file in files},
            metrics_folder=metrics_folder,
            digests={"tunnel": tunnel_digest, "roscore": code_digest, **dict.fromkeys(_NODES, nodes_digest)},
        )
    except quotes.Unquotable as problem:
        raise AnsibleFilterError(str(problem)) from problem


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"service_units": service_units}
