# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_info
short_description: Find out what a machine is before it becomes a computer of the fleet
version_added: "1.0.0"
description:
  - Reads in one run what has to be known before a robot's computer is changed. Its interfaces and addresses, where
    ROS 1 is, who holds the ports of the services, which files set other values of C(ROS_MASTER_URI), and what sshd is
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
      - Where ROS 1 is. V(auto) takes the only C(/opt/ros/<distro>), and Debian's packages where there is none.
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
      - What is looked at, for example only V(environment) to read back what shells see. A part that is not listed is
        not returned.
      - The part V(system) returns RV(hostname), RV(python), RV(kernel), RV(os) and RV(systemd); every other part returns the value
        of its name.
      - The part V(masters) is not looked at by default, since it asks roscores and nodes.
    type: list
    elements: str
    choices:
      [system, owned, interfaces, ways, routing, forwarding, filters, multicast_routing, ros, packages, clock, tunnel, folders, ports, masters,
       exports, sshd, environment]
    default:
      [system, owned, interfaces, ways, routing, forwarding, filters, multicast_routing, ros, packages, clock, tunnel, folders, ports, exports,
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
        RV(ros.found[].nodes).
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
        description: Other programs that it uses, for example V([screen]); see RV(ros.found[].nodes[].lacks).
        type: list
        elements: str
        default: []
      environment:
        description: Variables that it needs, which are set for the import where the ROS does not set them, such as E(ROS_VERSION).
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

    - name: Read back what a new login shell sees
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

    - name: Say what is missing
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
    id:
      description: Its short name.
      returned: always
      type: str
      sample: debian
    version:
      description: Its version.
      returned: always
      type: str
      sample: "12"
    name:
      description: Its name for people.
      returned: always
      type: str
      sample: Debian GNU/Linux 12 (bookworm)
systemd:
  description: The service manager.
  returned: with the part V(system)
  type: dict
  contains:
    running:
      description: Whether systemd runs this machine.
      returned: always
      type: bool
      sample: true
    version:
      description: Its version, 0 where it is not installed.
      returned: always
      type: int
      sample: 252
    net_admin:
      description: Whether it may give C(CAP_NET_ADMIN) to services, which some containers do not let it.
      returned: always
      type: bool
      sample: true
owned:
  description: The records of what modules of the collection have put on this machine, by their names.
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
    name:
      description: The name of the interface.
      returned: always
      type: str
      sample: eth0
    up:
      description: Whether it is switched on.
      returned: always
      type: bool
      sample: true
    multicast:
      description: Whether it does multicast.
      returned: always
      type: bool
      sample: true
    loopback:
      description: Whether it is the loopback interface.
      returned: always
      type: bool
      sample: false
    mtu:
      description: The largest packet, in bytes.
      returned: always
      type: int
      sample: 1500
    port_of:
      description: The bridge or bond of which it is a port, or empty. What comes in at a port belongs to the interface above it.
      returned: always
      type: str
      sample: ""
    macvlan_of:
      description: The interface below it, where it is a macvlan, or empty. Both answer ARP for each address of the machine.
      returned: always
      type: str
      sample: ""
    point_to_point:
      description: Whether it is one end of a link with two ends, such as a tunnel.
      returned: always
      type: bool
      sample: false
    addresses:
      description: Its addresses.
      returned: always
      type: list
      elements: dict
      contains:
        address:
          description: The address.
          returned: always
          type: str
          sample: 192.168.1.229
        prefix:
          description: The length of its network's prefix, in bits.
          returned: always
          type: int
          sample: 24
        family:
          description: V(inet) for IPv4, V(inet6) for IPv6.
          returned: always
          type: str
          sample: inet
ways:
  description: The routes that the kernel would take to O(destinations).
  returned: with the part V(ways)
  type: list
  elements: dict
  contains:
    destination:
      description: The address that was asked for.
      returned: always
      type: str
      sample: 192.168.10.1
    gateway:
      description: The next hop, null where the address is on a network of this machine or there is no route.
      returned: always
      type: str
      sample: 192.168.11.101
    device:
      description: The interface on which packets leave, null where there is no route.
      returned: always
      type: str
      sample: eth0
    source:
      description: The address from which packets leave, null where there is no route.
      returned: always
      type: str
      sample: 192.168.11.100
    error:
      description: Why there is no route, else empty.
      returned: always
      type: str
      sample: ""
routing:
  description: The routes of IPv4, which decide where packets leave.
  returned: with the part V(routing)
  type: dict
  contains:
    routes:
      description: The routes of the main table, also those that the kernel makes for addresses.
      returned: always
      type: list
      elements: dict
      contains:
        destination:
          description: The network, V(0.0.0.0/0) for a default route.
          returned: always
          type: str
          sample: 192.168.10.0/24
        gateway:
          description: The next hop, empty where the network is on the interface itself, and for several next hops.
          returned: always
          type: str
          sample: 192.168.1.202
        device:
          description: The interface, empty for a route that leads nowhere, and for several next hops.
          returned: always
          type: str
          sample: eth0
        metric:
          description: The metric; of two routes to a network the one with the lower metric counts.
          returned: always
          type: int
          sample: 0
        source:
          description: The address from which packets leave, empty where the route does not say it.
          returned: always
          type: str
          sample: 192.168.1.201
        type:
          description: V(unicast), or V(blackhole), V(unreachable), V(prohibit), V(throw) for a route that leads nowhere.
          returned: always
          type: str
          sample: unicast
    rules:
      description: The rules of policy routing beside the kernel's own, as C(ip rule) prints them.
      returned: always
      type: list
      elements: str
      sample: ["100: from 10.0.0.0/8 lookup 100"]
    tables:
      description: The other tables to which the rules lead, 32 at most.
      returned: always
      type: list
      elements: dict
      sample: [{table: "100", routes: []}]
      contains:
        table:
          description: The name or the number of the table, as the rules have it.
          returned: always
          type: str
          sample: "100"
        routes:
          description: Its routes, as RV(routing.routes).
          returned: always
          type: list
          elements: dict
          sample: []
forwarding:
  description: The kernel's settings that decide what passes through this machine.
  returned: with the part V(forwarding)
  type: dict
  contains:
    ip_forward:
      description: C(net.ipv4.ip_forward), null where it cannot be read.
      returned: always
      type: int
      sample: 1
    icmp_echo_ignore_all:
      description: C(net.ipv4.icmp_echo_ignore_all), V(1) where the kernel answers no pings, or null where it cannot be read.
      returned: always
      type: int
      sample: 0
    macs:
      description: >-
        The hardware addresses of all interfaces that are up, also of those without an address, such as the ports of a bridge.
      returned: always
      type: list
      elements: str
      sample: ['02:42:c0:a8:01:c9']
    interfaces:
      description: The interfaces with an address of IPv4.
      returned: always
      type: list
      elements: dict
      contains:
        interface:
          description: The name of the interface.
          returned: always
          type: str
          sample: eth0
        addresses:
          description: Its addresses.
          returned: always
          type: list
          elements: str
          sample: [192.168.1.201]
        forwarding:
          description: V(1) if what comes in there is passed on, null where it cannot be read.
          returned: always
          type: int
          sample: 1
        rp_filter:
          description: The reverse-path filter, the larger value of C(all) and the interface, null where it cannot be read.
          returned: always
          type: int
          sample: 2
        send_redirects:
          description: V(1) if ICMP redirects are sent there, null where it cannot be read.
          returned: always
          type: int
          sample: 1
        prefixes:
          description: The length of the network prefix of each of the addresses.
          returned: always
          type: list
          elements: int
          sample: [24]
        mtu:
          description: The largest packet that the interface sends, in bytes, or null where it cannot be read.
          returned: always
          type: int
          sample: 1500
        port_of:
          description: The bridge or bond of which it is a port, or empty. What comes in at a port belongs to the interface above it.
          returned: always
          type: str
          sample: ""
        point_to_point:
          description: Whether the interface is one end of a link with two ends, such as a tunnel.
          returned: always
          type: bool
          sample: false
        mac:
          description: The hardware address of the interface, or empty.
          returned: always
          type: str
          sample: 02:42:c0:a8:01:c9
        state:
          description: The operational state of the interface as the kernel tells it, such as V(up) or V(down), or empty.
          returned: always
          type: str
          sample: up
        carrier_changes:
          description: How often its link came or went since the interface is there, or null where the kernel does not count.
          returned: always
          type: int
          sample: 2
        last:
          description: Of an interface that is down, the last line of the journal about its link, with its time, or empty.
          returned: always
          type: str
          sample: "2026-11-22T09:12:44+0000 kobuki2computer kernel: eth0: Link is Down"
        power_save:
          description: Whether a wireless interface saves power, as C(iw) tells; null of any other one, and without C(iw).
          returned: always
          type: bool
          sample: false
filters:
  description: The packet filter of nftables, also what iptables has made of it, as far as it can be read simply.
  returned: with the part V(filters)
  type: dict
  contains:
    readable:
      description: Whether C(nft) is there and prints its rules.
      returned: always
      type: bool
      sample: true
    chains:
      description: The chains that may drop or translate packets, in the order in which a packet meets them, without the collection's own.
      returned: always
      type: list
      elements: dict
      contains:
        hook:
          description: V(input), V(output), V(forward) or V(postrouting).
          returned: always
          type: str
          sample: forward
        table:
          description: The family and the table.
          returned: always
          type: str
          sample: ip filter
        policy:
          description: What becomes of a packet that no rule decides about, V(accept) or V(drop).
          returned: always
          type: str
          sample: drop
        rules:
          description:
            - The rules that are understood, those of chains that are jumped to in their place. Each has C(verdict), the C(chain) in
              which it stands, and what it asks for of C(protocol), C(ports) (the first and the last one), C(sources), C(destinations),
              C(incoming), C(leaving), C(state) and C(above) (only packets of more bytes).
          returned: always
          type: list
          elements: dict
          sample: [{verdict: accept, chain: input, protocol: tcp, ports: [22, 22]}]
        unread:
          description: The number of rules that say more than that.
          returned: always
          type: int
          sample: 0
    arp:
      description: The family and the name of each table that drops ARP, whoever asks or answers.
      returned: always
      type: list
      elements: str
      sample: [arp filter]
multicast_routing:
  description: What passes multicast on between interfaces.
  returned: with the part V(multicast_routing)
  type: dict
  contains:
    smcrouted:
      description: The program of smcroute, empty where it is not installed.
      returned: always
      type: str
      sample: /usr/sbin/smcrouted
    others:
      description: The active units of Debian's packages that do it already; the kernel takes one program at a time.
      returned: always
      type: list
      elements: str
      sample: []
clock:
  description: The time services of this machine.
  returned: with the part V(clock)
  type: dict
  contains:
    chronyd:
      description: The program of chrony, empty where it is not installed.
      returned: always
      type: str
      sample: /usr/sbin/chronyd
    enabled:
      description: Whether C(chrony.service) starts at boot.
      returned: always
      type: bool
      sample: true
    settable:
      description: Whether systemd may let a service set the clock (CAP_SYS_TIME). In most containers it may not.
      returned: always
      type: bool
      sample: true
    others:
      description: The configurations of time services that somebody has written, not their Debian package and not the collection; at most 20.
      returned: always
      type: list
      elements: dict
      sample: []
      contains:
        service:
          description: The unit of systemd.
          returned: always
          type: str
          sample: systemd-timesyncd.service
        file:
          description: The file.
          returned: always
          type: str
          sample: /etc/systemd/timesyncd.conf
        line:
          description: The line that names a source of time, or a remark in its place.
          returned: always
          type: str
          sample: NTP=192.168.1.9
    sources:
      description: The sources of time that the time service has, at most 32. Those without an address, such as a radio clock, are left out.
      returned: always
      type: list
      elements: dict
      sample: [{address: 192.168.1.201, selected: true, reachable: true, offset_s: 0.0001}]
      contains:
        address:
          description: The address of the source.
          returned: always
          type: str
          sample: 192.168.1.201
        selected:
          description: Whether the clock follows it, alone or with others.
          returned: always
          type: bool
          sample: true
        reachable:
          description: Whether it has answered one of the last four requests.
          returned: always
          type: bool
          sample: true
        offset_s:
          description: How many seconds this machine's clock was ahead of the source at its last answer, or null where the service does not tell.
          returned: always
          type: float
          sample: 0.0001
    restart_due:
      description: Whether chrony runs since before the present files of the collection, or does not run with them.
      returned: always
      type: bool
      sample: false
tunnel:
  description: What a tunnel of WireGuard needs.
  returned: with the part V(tunnel)
  type: dict
  contains:
    kernel:
      description: Whether the kernel has WireGuard.
      returned: always
      type: bool
      sample: true
    device:
      description: Whether there is C(/dev/net/tun), which wireguard-go needs.
      returned: always
      type: bool
      sample: true
ros:
  description: ROS 1 on this machine.
  returned: with the part V(ros)
  type: dict
  contains:
    problem:
      description: One sentence about why there is none to use, or what the chosen one lacks. Empty where all is well.
      returned: always
      type: str
      sample: ""
    chosen:
      description: The installation to use, one of RV(ros.found), or null.
      returned: always
      type: dict
      sample: {kind: debian, setup: "", distro: debian, rospy: true}
    found:
      description: The installations that O(ros_setup) may mean, the preferred one first.
      returned: always
      type: list
      elements: dict
      contains:
        kind:
          description: V(prefix) below C(/opt/ros), V(workspace) for another set-up file, V(debian) for Debian's
            packages.
          returned: always
          type: str
          sample: prefix
        setup:
          description: The set-up file, empty for Debian's packages, which need none.
          returned: always
          type: str
          sample: /opt/ros/noetic/setup.bash
        distro:
          description: The distribution of ROS, V(debian) for Debian's packages.
          returned: always
          type: str
          sample: noetic
        version:
          description: V(1) or V(2). A ROS 2 is never chosen.
          returned: always
          type: str
          sample: "1"
        python:
          description: The interpreter that ROS is used with, that of the prefix where the prefix has one of its own, as those of conda have.
          returned: always
          type: str
          sample: /usr/bin/python3
        python_version:
          description: The version of that interpreter, empty where it was not asked.
          returned: always
          type: str
          sample: 3.8.10
        environment:
          description: The variables that the set-up file makes; of C(PATH) only the entries that it adds.
          returned: always
          type: dict
          sample: {ROS_DISTRO: noetic, PATH: /opt/ros/noetic/bin}
        for_root:
          description:
            - The variables that root may have.
            - Where the set-up file or a folder of its lists is not root's alone, they are those of the set-up file below C(/opt/ros) on which
              the workspace is built, and none where it is built on none, or that one is not root's alone either.
          returned: always
          type: dict
          sample: {ROS_DISTRO: noetic, PATH: /opt/ros/noetic/bin}
        below:
          description: The set-up file of RV(ros.found[].for_root) where it differs from RV(ros.found[].setup), or empty.
          returned: always
          type: str
          sample: ""
        person:
          description: The user who gets all of RV(ros.found[].environment), V(*) for every user but root, empty for no user. Services get them in any case.
          returned: always
          type: str
          sample: "*"
        doubt:
          description: Why root may not have them, in a few words, or empty.
          returned: always
          type: str
          sample: /home/robot belongs to robot
        left_out:
          description: Variables that no process gets, and entries of lists that are not absolute, or have C(;), C($), a quote or a backslash.
          returned: always
          type: list
          elements: str
          sample: [LD_PRELOAD, PATH (./bin)]
        rospy:
          description: Whether an unprivileged user can import rospy.
          returned: always
          type: bool
          sample: true
        missing:
          description: The needed Python modules that cannot be imported.
          returned: always
          type: list
          elements: str
          sample: []
        commands:
          description: Where the commands C(roscore), C(rostopic) and C(rosservice) are, each empty where it is not
            there.
          returned: always
          type: dict
          sample: {roscore: /opt/ros/noetic/bin/roscore, rostopic: /opt/ros/noetic/bin/rostopic, rosservice: ""}
        hooks:
          description: The folder of shell files that the set-up file sources at its end, where root alone can change it, or empty.
          returned: always
          type: str
          sample: /opt/ros/noetic/etc/catkin/profile.d
        hooks_doubt:
          description: Which such folder was passed over and why, in a few words, or empty.
          returned: always
          type: str
          sample: below /home/robot/ws/devel, since /home/robot belongs to robot
        nodes:
          description: The executables of O(nodes), looked for in the chosen installation only.
          returned: always
          type: list
          elements: dict
          contains:
            package:
              description: The ROS package.
              returned: always
              type: str
              sample: fkie_master_discovery
            executable:
              description: The executable.
              returned: always
              type: str
              sample: master_discovery
            path:
              description: Where it is, empty where it was not found.
              returned: always
              type: str
              sample: /opt/ros/noetic/lib/fkie_master_discovery/master_discovery
            problem:
              description: Why an unprivileged user could not run it, or empty.
              returned: always
              type: str
              sample: ""
            lacks:
              description: Those of its programs that are not in the PATH of ROS.
              returned: always
              type: list
              elements: str
              sample: [screen]
        problem:
          description: One sentence about what is wrong with this installation, or empty.
          returned: always
          type: str
          sample: ""
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
    name:
      description: The name of the package.
      returned: always
      type: str
      sample: ros-noetic-fkie-master-sync
    installed:
      description: The version that is installed, or empty.
      returned: always
      type: str
      sample: 1.3.2-2focal
    candidate:
      description: The version that apt would install, empty where its sources have none.
      returned: always
      type: str
      sample: 1.3.2-2focal
    ours:
      description: Whether the collection installed it.
      returned: always
      type: bool
      sample: true
ports:
  description: The listening TCP and bound UDP sockets on O(ports).
  returned: with the part V(ports)
  type: list
  elements: dict
  contains:
    protocol:
      description: V(tcp) or V(udp).
      returned: always
      type: str
      sample: tcp
    port:
      description: The number of the port.
      returned: always
      type: int
      sample: 11311
    address:
      description: The address that the socket is bound to.
      returned: always
      type: str
      sample: 0.0.0.0
    pid:
      description: The process that has it open, 0 where that cannot be seen.
      returned: always
      type: int
      sample: 512
    command:
      description: The command line of that process.
      returned: always
      type: str
      sample: /usr/bin/python3 /usr/bin/rosmaster --core -p 11311
    user:
      description: The user who owns the socket.
      returned: always
      type: str
      sample: robot
    unit:
      description: The systemd unit of that process, empty where it has none.
      returned: always
      type: str
      sample: roscore.service
    container:
      description: Whether that process has numbers of its own below this machine's, as processes in a container have.
      returned: always
      type: bool
      sample: false
masters:
  description:
    - The roscores on the TCP ports among O(ports), with the discovery and sync nodes that are registered there.
    - They are asked by their own protocols, so no ROS is needed, and it does not matter who has started them. Each question takes
      at most five seconds. What others tell is plain text of at most 200 characters.
  returned: with the part V(masters)
  type: list
  elements: dict
  contains:
    port:
      description: The TCP port on which it listens.
      returned: always
      type: int
      sample: 11311
    process:
      description: The process that has the port open, as far as this user may see it.
      returned: always
      type: dict
      contains:
        pid:
          description: Its number, 0 where it cannot be seen.
          returned: always
          type: int
          sample: 512
        command:
          description: Its command line.
          returned: always
          type: str
          sample: /usr/bin/python3 /usr/bin/rosmaster --core -p 11311
        user:
          description: The user who owns the socket.
          returned: always
          type: str
          sample: robot
        unit:
          description: Its systemd unit, empty where it has none.
          returned: always
          type: str
          sample: roscore.service
        container:
          description: Whether it runs in a container.
          returned: always
          type: bool
          sample: false
    uri:
      description: The URI by which the roscore calls itself.
      returned: always
      type: str
      sample: http://kobuki1computer:11311/
    pid:
      description: The process number that the roscore tells.
      returned: always
      type: int
      sample: 512
    run_id:
      description: The parameter C(/run_id), another one for each start of a roscore; empty where it is not set.
      returned: always
      type: str
      sample: 2bb5b2a4-e5e1-11f1-8d6a-0242c0a801e5
    rosdistro:
      description: The parameter C(/rosdistro), empty where it is not set.
      returned: always
      type: str
      sample: noetic
    rosversion:
      description: The parameter C(/rosversion), empty where it is not set.
      returned: always
      type: str
      sample: 1.15.15
    nodes:
      description: How many nodes are registered with a topic or a service, those of other robots included.
      returned: always
      type: int
      sample: 7
    topics:
      description: How many topics have a publisher or a subscriber.
      returned: always
      type: int
      sample: 12
    services:
      description: How many services are registered.
      returned: always
      type: int
      sample: 30
    discovery:
      description: The robot's own discovery nodes, known by a service C(list_masters) in any namespace; eight at most.
      returned: always
      type: list
      elements: dict
      contains:
        node:
          description: The name of the node.
          returned: always
          type: str
          sample: /master_discovery
        service:
          description: The name of its service.
          returned: always
          type: str
          sample: /master_discovery/list_masters
        implementation:
          description:
            - V(bundled), V(upstream) for multimaster_fkie, or V(fkie_mas) for its successor, which the type of its service tells.
            - Empty where it does not answer at RV(masters[].discovery[].uri).
          returned: always
          type: str
          sample: upstream
        uri:
          description: Where it answers other robots, empty where it does not list its own master.
          returned: always
          type: str
          sample: http://192.168.1.229:11611
        group:
          description: Its multicast group, as its parameter at the roscore says; empty where that is not set.
          returned: always
          type: str
          sample: 226.0.0.0
        group_port:
          description: The UDP port of the heartbeats, as its parameter at the roscore says; 0 where that is not set.
          returned: always
          type: int
          sample: 11511
        masters:
          description: The masters that it lists, its own among them.
          returned: always
          type: list
          elements: dict
          contains:
            name:
              description: The name of the master.
              returned: always
              type: str
              sample: kobuki2computer
            uri:
              description: The URI of its roscore.
              returned: always
              type: str
              sample: http://kobuki2computer:11311/
            online:
              description: Whether it is heard.
              returned: always
              type: bool
              sample: true
            discoverer_name:
              description: The name of its discovery node.
              returned: always
              type: str
              sample: /master_discovery
            monitoruri:
              description: Where its discovery node answers.
              returned: always
              type: str
              sample: http://192.168.1.239:11611
        error:
          description: Why it did not tell its masters, or empty.
          returned: always
          type: str
          sample: ""
    sync:
      description: The robot's own sync nodes, known by a service C(get_sync_info) in any namespace; eight at most.
      returned: always
      type: list
      elements: dict
      contains:
        node:
          description: The name of the node.
          returned: always
          type: str
          sample: /master_sync
        service:
          description: The name of its service.
          returned: always
          type: str
          sample: /master_sync/get_sync_info
        implementation:
          description: V(bundled), V(upstream) or V(fkie_mas). The bundled one writes the parameter C(/rosfleet_multimaster/imports).
          returned: always
          type: str
          sample: upstream
        imports:
          description: What it has registered for each other master.
          returned: always
          type: list
          elements: dict
          contains:
            master:
              description: The URI of that master's roscore.
              returned: always
              type: str
              sample: http://kobuki2computer:11311/
            nodes:
              description: How many of its nodes.
              returned: always
              type: int
              sample: 3
            topics:
              description: How many of its topics.
              returned: always
              type: int
              sample: 5
            services:
              description: How many of its services.
              returned: always
              type: int
              sample: 8
        error:
          description: Why it did not tell them, or empty.
          returned: always
          type: str
          sample: ""
    error:
      description: Why the roscore gave no answer, or empty. Where something else than a roscore answers on a port, there is no entry.
      returned: always
      type: str
      sample: ""
exports:
  description: Assignments of ROS_MASTER_URI, ROS_IP and ROS_HOSTNAME in the files that shells read, other than the
    collection's.
  returned: with the part V(exports)
  type: list
  elements: dict
  contains:
    file:
      description: The file.
      returned: always
      type: str
      sample: /home/robot/.bashrc
    line:
      description: The number of the line.
      returned: always
      type: int
      sample: 118
    variable:
      description: The variable.
      returned: always
      type: str
      sample: ROS_MASTER_URI
    value:
      description: What it is set to, as far as that is a plain word.
      returned: always
      type: str
      sample: http://localhost:11311
    text:
      description: The line.
      returned: always
      type: str
      sample: export ROS_MASTER_URI=http://localhost:11311
sshd:
  description: The ssh server.
  returned: with the part V(sshd)
  type: dict
  contains:
    installed:
      description: Whether there is one.
      returned: always
      type: bool
      sample: true
    includes_drop_ins:
      description: Whether it reads the files in C(/etc/ssh/sshd_config.d) for every user.
      returned: always
      type: bool
      sample: true
    other_setenv:
      description: The C(SetEnv) lines that are not the collection's.
      returned: always
      type: list
      elements: dict
      contains:
        file:
          description: The file.
          returned: always
          type: str
          sample: /etc/ssh/sshd_config
        line:
          description: The number of the line.
          returned: always
          type: int
          sample: 7
        text:
          description: The line.
          returned: always
          type: str
          sample: SetEnv LANG=C.UTF-8
        match:
          description: Whether it is below a C(Match) and so concerns some users only.
          returned: always
          type: bool
          sample: false
    match_setenv:
      description: Whether it knows C(SetEnv) below a C(Match). OpenSSH 8.4 gives such variables to no user.
      returned: always
      type: bool
      sample: true
    path:
      description: The C(PATH) of C(/etc/environment), empty where there is none.
      returned: always
      type: str
      sample: ""
    service:
      description: The active unit of the server, empty where it is not a running service.
      returned: always
      type: str
      sample: ssh.service
    reload_due:
      description: Whether the collection's file is newer than what the running server has read.
      returned: always
      type: bool
      sample: false
environment:
  description: The variables that really arrive, read by the programs that read the files, for a user without files of
    his own.
  returned: with the part V(environment)
  type: dict
  contains:
    login:
      description: In a new login shell. Null where there is no bash.
      returned: always
      type: dict
      sample: {ROS_MASTER_URI: "http://kobuki1computer:11311", ROS_HOSTNAME: kobuki1computer}
    ssh:
      description: In a command by ssh, as far as sshd sets it. Null where there is no sshd, or its settings cannot
        be read, which needs root.
      returned: always
      type: dict
      sample: {ROS_MASTER_URI: "http://kobuki1computer:11311", ROS_HOSTNAME: kobuki1computer}
    desktop:
      description: In a session of systemd's user manager, as far as C(environment.d) sets it. Null where there is none.
      returned: always
      type: dict
      sample: {ROS_MASTER_URI: "http://kobuki1computer:11311", ROS_HOSTNAME: kobuki1computer}
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
