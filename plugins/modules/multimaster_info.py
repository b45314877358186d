# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_info
short_description: Read the facts of a machine before it becomes a computer of the fleet
version_added: "1.0.0"
description:
  - Reads in one run all that has to be known before a robot's computer is changed. Its interfaces and addresses, the place of
    ROS 1, the programs that hold the ports of the services, the files that set other values of C(ROS_MASTER_URI), and what sshd is
    set up for.
  - A set-up file of ROS is really sourced, and rospy really imported, in a unit of systemd with a user of its own, which
    ends with all its processes. The services run so too, and a person's workspace is no code for root. Whose the files are
    decides who gets their variables.
  - Nothing here waits for more than some seconds, and a strange part of a machine is a sentence in RV(problems),
    not a failure.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  ros_setup:
    description:
      - The place of ROS 1. V(auto) takes the only C(/opt/ros/<distro>), and Debian's packages if there is none.
        V(debian) takes Debian's packages.
      - Anything else is the path of a set-up file, or of the folder that holds it, for example
        V(/home/robot/ws/devel/setup.bash). In an environment of conda it is sourced with C(CONDA_PREFIX) and C(PATH) set, as conda does.
    type: str
    default: auto
  ports:
    description: The ports whose holders are looked for.
    type: list
    elements: dict
    default:
      - {protocol: tcp, port: 11311}
      - {protocol: udp, port: 11511}
      - {protocol: tcp, port: 11611}
    suboptions:
      protocol:
        description: The protocol of the port, for example V(udp) for the heartbeats.
        type: str
        choices: [tcp, udp]
        required: true
      port:
        description: The number of the port, 1 to 65535, for example V(11311) for the roscore.
        type: int
        required: true
  parts:
    description:
      - The parts to read, for example only V(environment) to read back what shells see. A part that is not listed is
        not returned.
      - The part V(system) returns RV(hostname), RV(python), RV(kernel), RV(os) and RV(systemd); every other part returns the value
        of its name.
      - The part V(masters) is not looked at by default, since it asks roscores and nodes.
    type: list
    elements: str
    choices:
      [system, owned, interfaces, ways, routing, forwarding, filters, ros, packages, clock, multicast_routing, tunnel, folders, ports, masters,
       exports, sshd, environment]
    default:
      [system, owned, interfaces, ways, routing, forwarding, filters, ros, packages, clock, multicast_routing, tunnel, folders, ports, exports,
       sshd, environment]
  destinations:
    description:
      - IPv4 addresses to which the ways are looked up, for example V(192.168.10.1); see RV(ways).
    type: list
    elements: str
    default: []
  nodes:
    description:
      - Executables of ROS packages that are looked for in the chosen installation of ROS, as C(rosrun) does it; see
        C(nodes) of RV(ros.found).
    type: list
    elements: dict
    default: []
    suboptions:
      package:
        description: The ROS package, for example V(fkie_master_discovery).
        type: str
        required: true
      executable:
        description: The executable, for example V(master_discovery).
        type: str
        required: true
      modules:
        description: The Python modules that it needs, for example V([fkie_multimaster_msgs.srv]).
        type: list
        elements: str
        default: []
      programs:
        description: Other programs that it uses, for example V([screen]); see C(lacks) of C(nodes) in RV(ros.found).
        type: list
        elements: str
        default: []
      environment:
        description: Variables that it needs, which are set for the import if the ROS does not set them, such as E(ROS_VERSION).
        type: dict
        default: {}
  packages:
    description:
      - Debian packages whose versions are looked up, for example V([ros-noetic-fkie-master-sync]); see RV(packages).
    type: list
    elements: str
    default: []
  folders:
    description: Folders that are looked for, for example V([/var/lib/prometheus/node-exporter]); see RV(folders).
    type: list
    elements: str
    default: []
notes:
  - The return values have one level of fields here, each with its first sentence. All fields, sentences and examples are in
    C(plugins/module_utils/_contract) of the collection.
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_check
  - module: rosfleet.multimaster.fleet_adopt
"""

EXAMPLES = r"""
- name: Look at every machine
  hosts: robots
  gather_facts: false
  become: true
  tasks:
    - name: Look at the machine
      rosfleet.multimaster.multimaster_info:
      register: multimaster_info

    - name: Look at a machine whose ROS is a person's workspace
      rosfleet.multimaster.multimaster_info:
        ros_setup: /home/robot/ws/devel/setup.bash
        ports:
          - {protocol: tcp, port: 11311}

    - name: Read back the variables of a new login shell
      rosfleet.multimaster.multimaster_info:
        parts: [environment]

- name: Check by yourself that every robot sees at least two masters
  hosts: robots
  gather_facts: false
  become: true
  tasks:
    - name: Ask the roscore and the nodes of multimaster_fkie, whoever has started them
      rosfleet.multimaster.multimaster_info:
        parts: [masters]
      register: seen

    - name: List the missing packages
      ansible.builtin.assert:
        that:
          - seen.masters | length == 1
          - seen.masters[0].discovery | map(attribute='masters') | flatten | selectattr('online') | length >= 2
          - seen.masters[0].sync | length == 1
"""

RETURN = r"""
hostname:
  description: The name that the machine calls itself.
  returned: with the part V(system)
  type: str
  sample: kobuki1computer
python:
  description: The version of the Python that runs the modules.
  returned: with the part V(system)
  type: str
  sample: 3.11.2
kernel:
  description: The release of the kernel.
  returned: with the part V(system)
  type: str
  sample: 6.1.0-28-amd64
os:
  description: The operating system, as C(/etc/os-release) says.
  returned: with the part V(system)
  type: dict
  contains:
    id: {description: Its short name., type: str}
    version: {description: Its version., type: str}
    name: {description: Its name for people., type: str}
systemd:
  description: The service manager.
  returned: with the part V(system)
  type: dict
  contains:
    running: {description: Whether systemd runs this machine., type: bool}
    version: {description: 'Its version, 0 if it is not installed.', type: int}
    net_admin: {description: 'Whether it may give C(CAP_NET_ADMIN) to services, which some containers do not let it.', type: bool}
owned:
  description: The records of the changes of the collection's modules on this machine, by their names.
  returned: with the part V(owned)
  type: list
  elements: str
  sample: [files-nodes, hosts_entries, services-multimaster, sysctl]
interfaces:
  description: The network interfaces.
  returned: with the part V(interfaces)
  type: list
  elements: dict
  contains:
    name: {description: The name of the interface., type: str}
    up: {description: Whether it is switched on., type: bool}
    multicast: {description: Whether it does multicast., type: bool}
    loopback: {description: Whether it is the loopback interface., type: bool}
    mtu: {description: 'The largest packet, in bytes.', type: int}
    port_of: {description: 'The bridge or bond of which it is a port, or empty.', version_added: 1.1.0, type: str}
    macvlan_of: {description: 'The interface below it, if it is a macvlan, or empty.', version_added: 1.1.0, type: str}
    point_to_point: {description: 'Whether it is one end of a link with two ends, such as a tunnel.', type: bool}
    addresses: {description: Its addresses., type: list, elements: dict}
ways:
  description: The routes that the kernel would take to O(destinations).
  returned: with the part V(ways)
  type: list
  elements: dict
  contains:
    destination: {description: The address that was asked for., type: str}
    gateway: {description: 'The next hop, null if the address is on a network of this machine or there is no route.', type: str}
    device: {description: 'The interface on which packets leave, null if there is no route.', type: str}
    source: {description: 'The address from which packets leave, null if there is no route.', type: str}
    error: {description: 'Why there is no route, else empty.', type: str}
routing:
  description: The routes of IPv4, which decide how packets leave.
  returned: with the part V(routing)
  type: dict
  contains:
    routes: {description: 'The routes of the main table, also those that the kernel makes for addresses.', type: list, elements: dict}
    rules: {description: 'The rules of policy routing without the kernel''s own, as C(ip rule) prints them.', type: list,
        elements: str}
    tables: {description: 'The other tables to which the rules lead, 32 at most.', type: list, elements: dict}
forwarding:
  description: The kernel's settings that decide about packets through this machine.
  returned: with the part V(forwarding)
  type: dict
  contains:
    ip_forward: {description: 'C(net.ipv4.ip_forward), or null if it cannot be read.', type: int}
    interfaces: {description: The interfaces that have an IPv4 address., type: list, elements: dict}
    icmp_echo_ignore_all: {description: 'C(net.ipv4.icmp_echo_ignore_all), V(1) if the kernel answers no pings, or null if it cannot be
          read.', type: int}
    macs: {description: 'The hardware addresses of all interfaces that are up, also of those without an address, such as
          the ports of a bridge.', version_added: 1.1.0, type: list, elements: str}
filters:
  description: The packet filter of nftables, also the rules of iptables in it, as far as it can be read simply.
  returned: with the part V(filters)
  type: dict
  contains:
    readable: {description: Whether C(nft) is there and prints its rules., type: bool}
    chains: {description: 'The chains that may drop or translate packets, in the order in which a packet meets them, without
          the collection''s own.', type: list, elements: dict}
    arp: {description: 'The family and the name of each table that drops ARP, whoever asks or answers.', version_added: 1.1.0,
        type: list, elements: str}
multicast_routing:
  description: The state of multicast routing between interfaces.
  returned: with the part V(multicast_routing)
  type: dict
  contains:
    smcrouted: {description: 'The program of smcroute, empty if it is not installed.', type: str}
    others: {description: The active units of Debian's packages that do it already; the kernel takes one program at a time.,
        type: list, elements: str}
clock:
  description: The time services of this machine.
  version_added: 1.1.0
  returned: with the part V(clock)
  type: dict
  contains:
    chronyd: {description: 'The program of chrony, empty if it is not installed.', type: str}
    enabled: {description: Whether C(chrony.service) starts at boot., type: bool}
    settable: {description: Whether systemd may let a service set the clock (CAP_SYS_TIME)., type: bool}
    others: {description: 'The configurations of time services that a person or a program has written, not their Debian package
          and not the collection; at most 20.', type: list, elements: dict}
    sources: {description: 'The sources of time that the time service has, at most 32.', type: list, elements: dict}
    restart_due: {description: 'Whether chrony runs since before the present files of the collection, or does not run with them.',
        type: bool}
tunnel:
  description: The support for a tunnel of WireGuard.
  version_added: 1.1.0
  returned: with the part V(tunnel)
  type: dict
  contains:
    kernel: {description: Whether the kernel has WireGuard., type: bool}
    device: {description: 'Whether there is C(/dev/net/tun), which wireguard-go needs.', type: bool}
ros:
  description: ROS 1 on this machine.
  returned: with the part V(ros)
  type: dict
  contains:
    problem: {description: 'One sentence: no installation can be used, or the chosen one lacks something.', type: str}
    chosen: {description: 'The installation to use, one of RV(ros.found), or null.', type: dict}
    found: {description: 'The installations that O(ros_setup) may mean, the preferred one first.', type: list, elements: dict}
folders:
  description: Those of O(folders) that are there, and are folders.
  returned: with the part V(folders)
  type: list
  elements: str
  sample: [/var/lib/prometheus/node-exporter]
packages:
  description: The Debian packages of O(packages), and those that the collection installed.
  returned: with the part V(packages)
  type: list
  elements: dict
  contains:
    name: {description: The name of the package., type: str}
    installed: {description: 'The version that is installed, or empty.', type: str}
    candidate: {description: 'The version that apt would install, empty if its sources have none.', type: str}
    ours: {description: Whether the collection installed it., type: bool}
ports:
  description: The listening TCP and bound UDP sockets on O(ports).
  returned: with the part V(ports)
  type: list
  elements: dict
  contains:
    protocol: {description: V(tcp) or V(udp)., type: str}
    port: {description: The number of the port., type: int}
    address: {description: The address that the socket is bound to., type: str}
    pid: {description: 'The process that has it open, 0 if that cannot be seen.', type: int}
    command: {description: The command line of that process., type: str}
    user: {description: The user who owns the socket., type: str}
    unit: {description: 'The systemd unit of that process, empty if it has none.', type: str}
    container: {description: 'Whether that process has numbers of its own below this machine''s, as processes in a container
          have.', type: bool}
    person: {description: The user whose own manager has this unit (C(systemctl --user)); empty for a unit of the computer.,
        version_added: 1.1.0, type: str}
masters:
  description: The roscores on the TCP ports among O(ports), with the discovery and sync nodes that are registered
    there. They are asked by their own protocols, so no ROS is needed, and it does not matter who has started them.
    Each question takes at most five seconds. Texts from other machines are plain text of at most 200 characters.
  returned: with the part V(masters)
  type: list
  elements: dict
  contains:
    port: {description: The TCP port on which it listens., type: int}
    process: {description: 'The process that has the port open, as far as this user may see it.', type: dict}
    uri: {description: The URI by which the roscore calls itself., type: str}
    pid: {description: The process number that the roscore reports., type: int}
    run_id: {description: 'The parameter C(/run_id), another one for each start of a roscore; empty if it is not set.', type: str}
    rosdistro: {description: 'The parameter C(/rosdistro), empty if it is not set.', type: str}
    rosversion: {description: 'The parameter C(/rosversion), empty if it is not set.', type: str}
    nodes: {description: 'How many nodes are registered with a topic or a service, those of other robots included.', type: int}
    topics: {description: How many topics have a publisher or a subscriber., type: int}
    services: {description: How many services are registered., type: int}
    discovery: {description: 'The robot''s own discovery nodes, known by a service C(list_masters) in any namespace; eight at
          most.', type: list, elements: dict}
    sync: {description: 'The robot''s own sync nodes, known by a service C(get_sync_info) in any namespace; eight at most.',
        type: list, elements: dict}
    error: {description: 'Why the roscore gave no answer, or empty.', type: str}
exports:
  description: Assignments of ROS_MASTER_URI, ROS_IP and ROS_HOSTNAME in the files that shells read, other than
    the collection's.
  returned: with the part V(exports)
  type: list
  elements: dict
  contains:
    file: {description: 'The file; empty if a shell has the variable, and no line was found.', type: str}
    line: {description: 'The number of the line, 0 if none was found.', type: int}
    variable: {description: The variable., type: str}
    value: {description: 'The value in the shell of RV(exports[].person).', type: str}
    text: {description: 'The statement in the line, or its form in the shell; other variables are without their values.',
        type: str}
    person: {description: 'The person whose shell was asked, and has the value; empty if none was asked.', version_added: 1.1.0,
        type: str}
    shell: {description: 'V(interactive), V(login), or empty if no shell was asked.', version_added: 1.1.0, type: str}
silent_shells:
  description: What gave no answer, so that its variables are unknown.
  version_added: 1.1.0
  returned: with the part V(exports)
  type: list
  elements: dict
  contains:
    person: {description: The person., type: str}
    shell: {description: 'V(interactive) or V(login) for a shell, V(files) for the files of that person.', type: str}
sshd:
  description: The ssh server.
  returned: with the part V(sshd)
  type: dict
  contains:
    installed: {description: Whether there is one., type: bool}
    includes_drop_ins: {description: Whether it reads the files in C(/etc/ssh/sshd_config.d) for every user., type: bool}
    other_setenv: {description: The C(SetEnv) lines that are not the collection's., type: list, elements: dict}
    match_setenv: {description: Whether it knows C(SetEnv) below a C(Match)., type: bool}
    path: {description: The C(PATH) of C(/etc/environment); empty if it sets none., type: str}
    service: {description: 'The active unit of the server, empty if it is not a running service.', type: str}
    reload_due: {description: Whether the collection's file is newer than the configuration of the running server., type: bool}
environment:
  description: The variables that really arrive, read by the programs that read the files, for a user without files
    of his own.
  returned: with the part V(environment)
  type: dict
  contains:
    login: {description: In a new login shell., type: dict}
    ssh: {description: 'In a command by ssh, as far as sshd sets it.', type: dict}
    desktop: {description: 'In a session of systemd''s user manager, as far as C(environment.d) sets it.', type: dict}
problems:
  description: One sentence for each part of the machine that could not be looked at; such a part has an empty value.
  returned: always
  type: list
  elements: str
  sample: []
"""

from ..module_utils._base import ends
from ..module_utils._base.module import Module
from ..module_utils._probe.facts import machine


def main() -> None:
    module = Module(argument_spec=machine.OPTIONS, supports_check_mode=True)
    error = machine.wrong(module.params)
    if error:
        ends.fail(module, msg=error)
    ends.leave(module, changed=False, **machine.look(module.params))


if __name__ == "__main__":
    main()
