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
  - The return values have one level of fields here. All fields are in C(plugins/module_utils/_contract) of the collection, each with its
    type, a sentence and an example.
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
  sample: {id: debian, version: '12', name: Debian GNU/Linux 12 (bookworm)}
  contains:
    id: {description: Its short name., returned: always, type: str}
    version: {description: Its version., returned: always, type: str}
    name: {description: Its name for people., returned: always, type: str}
systemd:
  description: The service manager.
  returned: with the part V(system)
  type: dict
  sample: {running: true, version: 252, net_admin: true}
  contains:
    running: {description: Whether systemd runs this machine., returned: always, type: bool}
    version: {description: 'Its version, 0 if it is not installed.', returned: always, type: int}
    net_admin: {description: 'Whether it may give C(CAP_NET_ADMIN) to services, which some containers do not let it.', returned: always,
        type: bool}
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
  sample:
    - {name: eth0, up: true, multicast: true, loopback: false, mtu: 1500, port_of: '', macvlan_of: '', point_to_point: false,
        addresses: [{address: 192.168.1.229, prefix: 24, family: inet}]}
  contains:
    name: {description: The name of the interface., returned: always, type: str}
    up: {description: Whether it is switched on., returned: always, type: bool}
    multicast: {description: Whether it does multicast., returned: always, type: bool}
    loopback: {description: Whether it is the loopback interface., returned: always, type: bool}
    mtu: {description: 'The largest packet, in bytes.', returned: always, type: int}
    port_of: {description: 'The bridge or bond of which it is a port, or empty. A packet that comes in at a port belongs to
          the interface above it.', version_added: 1.1.0, returned: always, type: str}
    macvlan_of: {description: 'The interface below it, if it is a macvlan, or empty. Both answer ARP for each address of the machine.',
        version_added: 1.1.0, returned: always, type: str}
    point_to_point: {description: 'Whether it is one end of a link with two ends, such as a tunnel.', returned: always, type: bool}
    addresses: {description: Its addresses., returned: always, type: list, elements: dict}
ways:
  description: The routes that the kernel would take to O(destinations).
  returned: with the part V(ways)
  type: list
  elements: dict
  sample:
    - {destination: 192.168.10.1, gateway: 192.168.11.101, device: eth0, source: 192.168.11.100, error: ''}
  contains:
    destination: {description: The address that was asked for., returned: always, type: str}
    gateway: {description: 'The next hop, null if the address is on a network of this machine or there is no route.', returned: always,
        type: str}
    device: {description: 'The interface on which packets leave, null if there is no route.', returned: always, type: str}
    source: {description: 'The address from which packets leave, null if there is no route.', returned: always, type: str}
    error: {description: 'Why there is no route, else empty.', returned: always, type: str}
routing:
  description: The routes of IPv4, which decide how packets leave.
  returned: with the part V(routing)
  type: dict
  sample: {routes: [{destination: 192.168.10.0/24, gateway: 192.168.1.202, device: eth0, metric: 0, source: 192.168.1.201,
          type: unicast}], rules: ['100: from 10.0.0.0/8 lookup 100'], tables: [{table: '100', routes: [{destination: 192.168.10.0/24,
              gateway: 192.168.1.202, device: eth0, metric: 0, source: 192.168.1.201, type: unicast}]}]}
  contains:
    routes: {description: 'The routes of the main table, also those that the kernel makes for addresses.', returned: always,
        type: list, elements: dict}
    rules: {description: 'The rules of policy routing without the kernel''s own, as C(ip rule) prints them.', returned: always,
        type: list, elements: str}
    tables: {description: 'The other tables to which the rules lead, 32 at most.', returned: always, type: list, elements: dict}
forwarding:
  description: The kernel's settings that decide about packets through this machine.
  returned: with the part V(forwarding)
  type: dict
  sample: {ip_forward: 1, interfaces: [{interface: eth0, addresses: [192.168.1.201], forwarding: 1, rp_filter: 2, send_redirects: 1,
          prefixes: [24], mtu: 1500, mac: '02:42:c0:a8:01:c9', state: up, carrier_changes: 2, last: '', power_save: null}],
      icmp_echo_ignore_all: 0, macs: ['02:42:c0:a8:01:c9']}
  contains:
    ip_forward: {description: 'C(net.ipv4.ip_forward), or null if it cannot be read.', returned: always, type: int}
    interfaces: {description: The interfaces that have an IPv4 address., returned: always, type: list, elements: dict}
    icmp_echo_ignore_all: {description: 'C(net.ipv4.icmp_echo_ignore_all), V(1) if the kernel answers no pings, or null if it cannot be
          read.', returned: always, type: int}
    macs: {description: 'The hardware addresses of all interfaces that are up, also of those without an address, such as
          the ports of a bridge.', version_added: 1.1.0, returned: always, type: list, elements: str}
filters:
  description: The packet filter of nftables, also the rules of iptables in it, as far as it can be read simply.
  returned: with the part V(filters)
  type: dict
  sample: {readable: true, chains: [{hook: forward, table: ip filter, policy: drop, rules: [{verdict: accept, protocol: tcp,
              ports: [22, 22], sources: [], destinations: [], incoming: '', leaving: '', state: '', above: 0, chain: input}],
          unread: 0, chain: FORWARD}], arp: [arp filter]}
  contains:
    readable: {description: Whether C(nft) is there and prints its rules., returned: always, type: bool}
    chains: {description: 'The chains that may drop or translate packets, in the order in which a packet meets them, without
          the collection''s own.', returned: always, type: list, elements: dict}
    arp: {description: 'The family and the name of each table that drops ARP, whoever asks or answers.', version_added: 1.1.0,
        returned: always, type: list, elements: str}
multicast_routing:
  description: The state of multicast routing between interfaces.
  returned: with the part V(multicast_routing)
  type: dict
  sample: {smcrouted: /usr/sbin/smcrouted, others: []}
  contains:
    smcrouted: {description: 'The program of smcroute, empty if it is not installed.', returned: always, type: str}
    others: {description: The active units of Debian's packages that do it already; the kernel takes one program at a time.,
        returned: always, type: list, elements: str}
clock:
  description: The time services of this machine.
  version_added: 1.1.0
  returned: with the part V(clock)
  type: dict
  sample: {chronyd: /usr/sbin/chronyd, enabled: true, settable: true, others: [{service: systemd-timesyncd.service, file: /etc/systemd/timesyncd.conf,
          line: NTP=192.168.1.9}], sources: [{address: 192.168.1.201, selected: true, reachable: true, offset_s: 0.0001}],
      restart_due: false}
  contains:
    chronyd: {description: 'The program of chrony, empty if it is not installed.', returned: always, type: str}
    enabled: {description: Whether C(chrony.service) starts at boot., returned: always, type: bool}
    settable: {description: Whether systemd may let a service set the clock (CAP_SYS_TIME). In most containers it may not.,
        returned: always, type: bool}
    others: {description: 'The configurations of time services that a person or a program has written, not their Debian package
          and not the collection; at most 20.', returned: always, type: list, elements: dict}
    sources: {description: 'The sources of time that the time service has, at most 32. Those without an address, such as a
          radio clock, are left out.', returned: always, type: list, elements: dict}
    restart_due: {description: 'Whether chrony runs since before the present files of the collection, or does not run with them.',
        returned: always, type: bool}
tunnel:
  description: The support for a tunnel of WireGuard.
  version_added: 1.1.0
  returned: with the part V(tunnel)
  type: dict
  sample: {kernel: true, device: true}
  contains:
    kernel: {description: Whether the kernel has WireGuard., returned: always, type: bool}
    device: {description: 'Whether there is C(/dev/net/tun), which wireguard-go needs.', returned: always, type: bool}
ros:
  description: ROS 1 on this machine.
  returned: with the part V(ros)
  type: dict
  sample: {problem: '', chosen: {kind: prefix, setup: /opt/ros/noetic/setup.bash, distro: noetic, version: '1', python: /usr/bin/python3,
        python_version: 3.8.10, environment: &id001 {ROS_DISTRO: noetic, PATH: /opt/ros/noetic/bin}, for_root: &id002 {
          ROS_DISTRO: noetic, PATH: /opt/ros/noetic/bin}, below: '', person: '*', doubt: /home/robot belongs to robot,
        left_out: &id003 [LD_PRELOAD, PATH (./bin)], rospy: true, missing: &id004 [], commands: &id005 {roscore: /opt/ros/noetic/bin/roscore,
          rostopic: /opt/ros/noetic/bin/rostopic, rosservice: ''}, hooks: /opt/ros/noetic/etc/catkin/profile.d, hooks_doubt: 'below
          /home/robot/ws/devel, since /home/robot belongs to robot', nodes: [{package: fkie_master_discovery, executable: master_discovery,
            path: /opt/ros/noetic/lib/fkie_master_discovery/master_discovery, problem: '', lacks: &id006 [screen]}],
        problem: ''}, found: [{kind: prefix, setup: /opt/ros/noetic/setup.bash, distro: noetic, version: '1', python: /usr/bin/python3,
          python_version: 3.8.10, environment: *id001, for_root: *id002, below: '', person: '*', doubt: /home/robot
            belongs to robot, left_out: *id003, rospy: true, missing: *id004, commands: *id005, hooks: /opt/ros/noetic/etc/catkin/profile.d,
          hooks_doubt: 'below /home/robot/ws/devel, since /home/robot belongs to robot', nodes: [{package: fkie_master_discovery,
              executable: master_discovery, path: /opt/ros/noetic/lib/fkie_master_discovery/master_discovery, problem: '',
              lacks: *id006}], problem: ''}]}
  contains:
    problem: {description: 'One sentence: no installation can be used, or the chosen one lacks something. Empty if all is well.',
        returned: always, type: str}
    chosen: {description: 'The installation to use, one of RV(ros.found), or null.', returned: always, type: dict}
    found: {description: 'The installations that O(ros_setup) may mean, the preferred one first.', returned: always, type: list,
        elements: dict}
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
  sample:
    - {name: ros-noetic-fkie-master-sync, installed: 1.3.2-2focal, candidate: 1.3.2-2focal, ours: true}
  contains:
    name: {description: The name of the package., returned: always, type: str}
    installed: {description: 'The version that is installed, or empty.', returned: always, type: str}
    candidate: {description: 'The version that apt would install, empty if its sources have none.', returned: always, type: str}
    ours: {description: Whether the collection installed it., returned: always, type: bool}
ports:
  description: The listening TCP and bound UDP sockets on O(ports).
  returned: with the part V(ports)
  type: list
  elements: dict
  sample:
    - {protocol: tcp, port: 11311, address: 0.0.0.0, pid: 512, command: /usr/bin/python3 /usr/bin/rosmaster --core -p
          11311, user: robot, unit: roscore.service, container: false}
  contains:
    protocol: {description: V(tcp) or V(udp)., returned: always, type: str}
    port: {description: The number of the port., returned: always, type: int}
    address: {description: The address that the socket is bound to., returned: always, type: str}
    pid: {description: 'The process that has it open, 0 if that cannot be seen.', returned: always, type: int}
    command: {description: The command line of that process., returned: always, type: str}
    user: {description: The user who owns the socket., returned: always, type: str}
    unit: {description: 'The systemd unit of that process, empty if it has none.', returned: always, type: str}
    container: {description: 'Whether that process has numbers of its own below this machine''s, as processes in a container
          have.', returned: always, type: bool}
masters:
  description: The roscores on the TCP ports among O(ports), with the discovery and sync nodes that are registered
    there. They are asked by their own protocols, so no ROS is needed, and it does not matter who has started them.
    Each question takes at most five seconds. Texts from other machines are plain text of at most 200 characters.
  returned: with the part V(masters)
  type: list
  elements: dict
  sample:
    - {port: 11311, process: {pid: 512, command: /usr/bin/python3 /usr/bin/rosmaster --core -p 11311, user: robot, unit: roscore.service,
          container: false}, uri: 'http://kobuki1computer:11311/', pid: 512, run_id: 2bb5b2a4-e5e1-11f1-8d6a-0242c0a801e5,
        rosdistro: noetic, rosversion: 1.15.15, nodes: 7, topics: 12, services: 30, discovery: [{node: /master_discovery,
            service: /master_discovery/list_masters, implementation: upstream, uri: 'http://192.168.1.229:11611', group: 226.0.0.0,
            group_port: 11511, masters: [{name: kobuki2computer, uri: 'http://kobuki2computer:11311/', online: true,
                discoverer_name: /master_discovery, monitoruri: 'http://192.168.1.239:11611'}], error: ''}], sync: [
          {node: /master_sync, service: /master_sync/get_sync_info, implementation: upstream, imports: [{master: 'http://kobuki2computer:11311/',
                nodes: 3, topics: 5, services: 8}], error: ''}], error: ''}
  contains:
    port: {description: The TCP port on which it listens., returned: always, type: int}
    process: {description: 'The process that has the port open, as far as this user may see it.', returned: always, type: dict}
    uri: {description: The URI by which the roscore calls itself., returned: always, type: str}
    pid: {description: The process number that the roscore reports., returned: always, type: int}
    run_id: {description: 'The parameter C(/run_id), another one for each start of a roscore; empty if it is not set.', returned: always,
        type: str}
    rosdistro: {description: 'The parameter C(/rosdistro), empty if it is not set.', returned: always, type: str}
    rosversion: {description: 'The parameter C(/rosversion), empty if it is not set.', returned: always, type: str}
    nodes: {description: 'How many nodes are registered with a topic or a service, those of other robots included.', returned: always,
        type: int}
    topics: {description: How many topics have a publisher or a subscriber., returned: always, type: int}
    services: {description: How many services are registered., returned: always, type: int}
    discovery: {description: 'The robot''s own discovery nodes, known by a service C(list_masters) in any namespace; eight at
          most.', returned: always, type: list, elements: dict}
    sync: {description: 'The robot''s own sync nodes, known by a service C(get_sync_info) in any namespace; eight at most.',
        returned: always, type: list, elements: dict}
    error: {description: 'Why the roscore gave no answer, or empty. If something else than a roscore answers on a port, there
          is no entry.', returned: always, type: str}
exports:
  description: Assignments of ROS_MASTER_URI, ROS_IP and ROS_HOSTNAME in the files that shells read, other than
    the collection's.
  returned: with the part V(exports)
  type: list
  elements: dict
  sample:
    - {file: /home/robot/.bashrc, line: 118, variable: ROS_MASTER_URI, value: 'http://localhost:11311', text: 'export
          ROS_MASTER_URI=http://localhost:11311', person: robot, shell: interactive}
  contains:
    file: {description: 'The file; empty if a shell has the variable, and no line was found.', returned: always, type: str}
    line: {description: 'The number of the line, 0 if none was found.', returned: always, type: int}
    variable: {description: The variable., returned: always, type: str}
    value: {description: 'The value in the shell of RV(exports[].person). If none was asked, the value that the line sets,
          as far as that is a plain word.', returned: always, type: str}
    text: {description: 'The statement in the line, or its form in the shell; other variables are without their values.',
        returned: always, type: str}
    person: {description: 'The person whose shell was asked, and has the value; empty if none was asked.', version_added: 1.1.0,
        returned: always, type: str}
    shell: {description: 'V(interactive), V(login), or empty if no shell was asked.', version_added: 1.1.0, returned: always,
        type: str}
sshd:
  description: The ssh server.
  returned: with the part V(sshd)
  type: dict
  sample: {installed: true, includes_drop_ins: true, other_setenv: [{file: /etc/ssh/sshd_config, line: 7, text: SetEnv LANG=C.UTF-8,
          match: false}], match_setenv: true, path: '', service: ssh.service, reload_due: false}
  contains:
    installed: {description: Whether there is one., returned: always, type: bool}
    includes_drop_ins: {description: Whether it reads the files in C(/etc/ssh/sshd_config.d) for every user., returned: always, type: bool}
    other_setenv: {description: The C(SetEnv) lines that are not the collection's., returned: always, type: list, elements: dict}
    match_setenv: {description: Whether it knows C(SetEnv) below a C(Match). OpenSSH 8.4 gives such variables to no user., returned: always,
        type: bool}
    path: {description: The C(PATH) of C(/etc/environment); empty if it sets none., returned: always, type: str}
    service: {description: 'The active unit of the server, empty if it is not a running service.', returned: always, type: str}
    reload_due: {description: Whether the collection's file is newer than the configuration of the running server., returned: always,
        type: bool}
environment:
  description: The variables that really arrive, read by the programs that read the files, for a user without files
    of his own.
  returned: with the part V(environment)
  type: dict
  sample: {login: {ROS_MASTER_URI: 'http://kobuki1computer:11311', ROS_HOSTNAME: kobuki1computer}, ssh: {ROS_MASTER_URI: 'http://kobuki1computer:11311',
        ROS_HOSTNAME: kobuki1computer}, desktop: {ROS_MASTER_URI: 'http://kobuki1computer:11311', ROS_HOSTNAME: kobuki1computer}}
  contains:
    login: {description: In a new login shell. Null if there is no bash., returned: always, type: dict}
    ssh: {description: 'In a command by ssh, as far as sshd sets it. Null if there is no sshd, or its settings cannot be
          read, which needs root.', returned: always, type: dict}
    desktop: {description: 'In a session of systemd''s user manager, as far as C(environment.d) sets it. Null without such
          a manager.', returned: always, type: dict}
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
