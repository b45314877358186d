# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_verify
short_description: Measure how this computer sees the other computers and masters
version_added: "1.0.0"
description:
  - Tries the connections of this computer with all others, as sections 3.2, 3.3 and 4.3 of the report IRI-TR-15-1 do by hand.
    It resolves names, pings, asks discovery nodes, compares clocks and registrations, and listens to a topic of each computer.
  - It takes three tasks with the C(linear) strategy. O(action=start) starts a talker, O(action=collect) measures,
    and O(action=stop) ends the talker. O(action=stream) between the last two measures throughput, and needs C(throttle) with V(1).
  - A missing answer is a result and no failure; M(rosfleet.multimaster.fleet_report) judges it.
  - It needs root. Commands of ROS run as the user C(nobody).
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.probe
attributes:
  check_mode:
    support: full
    details: In check mode no talker is started or stopped, and no command of ROS is run.
options:
  action:
    description:
      - V(start) starts a talker, a small node in a unit that ends after O(lifetime); an older talker ends first.
        V(collect) returns the measurements to all others. V(stream) sends a stream to each of O(talkers) and returns RV(streams).
        V(stop) ends the talker.
      - V(started), V(collected), V(streamed) and V(stopped) are former words, and C(state) is the former name of the option.
    type: str
    choices: [start, collect, stream, stop, started, collected, streamed, stopped]
    aliases: [state]
    default: collect
  run:
    description:
      - The label of the run, 1 to 64 letters, digits, dots, hyphens and underscores, for example V(verify-1730000000).
        Talkers of another run are not heard.
    type: str
    default: default
  name:
    description: >-
      The name of this computer in O(members), for example V(kobuki1computer). Required unless O(action=stop).
    type: str
  is_master:
    description: >-
      V(true) if this computer runs the roscore of its robot. Then RV(exchange) is read, and ROS must be there.
    type: bool
    default: false
  is_router:
    description: >-
      V(true) if this computer is the router of the common network. Then only routes, pings by address and kernel
      settings are read.
    type: bool
    default: false
  members:
    description:
      - All computers of the fleet, as RV(rosfleet.multimaster.fleet_plan#module:members).
      - Required with O(action=collect) and O(action=stream).
    type: list
    elements: dict
    suboptions:
      name:
        description: The name of the computer, for example V(kobuki2computer).
        type: str
        required: true
      address:
        description: Its IPv4 address, for example V(192.168.1.239).
        type: str
        required: true
      robot:
        description: Its robot, for example V(kobuki2).
        type: str
        default: ""
      network:
        description: The network of its address, for example V(192.168.1.0/24).
        type: str
        default: ""
      discovery_address:
        description: The address that discovery uses, for example V(192.168.1.239); O(members[].address), if empty.
        type: str
        default: ""
      discovery:
        description: >-
          V(true) if a helper of M(rosfleet.multimaster.multicast_verify) runs there. O(action=start) sends it a few empty
          datagrams, so that it returns the address from which they come.
        type: bool
        default: false
      multicast:
        description: Accepted and not read, so that the plan's members can be given as they are.
        type: bool
        default: false
  fleet:
    version_added: "1.1.0"
    description:
      - The name of the variable with the return of M(rosfleet.multimaster.fleet_plan), for example V(multimaster_fleet). O(members) and
        O(masters) come from it if they are missing, without a template, which takes long in a large fleet.
      - The controller reads it, and the computer does not.
    type: str
  port:
    description: The UDP port of discovery, for example V(11511).
    type: int
    default: 11511
  masters:
    description: >-
      All masters of the fleet, as RV(rosfleet.multimaster.fleet_plan#module:masters). Required with
      O(action=collect).
    type: list
    elements: dict
    suboptions:
      computer:
        description: The computer that runs the roscore, for example V(kobuki2computer).
        type: str
        required: true
      address:
        description: The IPv4 address of that computer, for example V(192.168.1.239).
        type: str
        required: true
      name:
        description: The name of the master, for example V(kobuki2computer).
        type: str
        required: true
      rpc_port:
        description: The TCP port of its discovery node, for example V(11611).
        type: int
        required: true
      monitor_uri:
        description: The URI of its discovery node, for example V(http://192.168.1.239:11611).
        type: str
        required: true
      robot:
        description: Accepted and not read.
        type: str
        default: ""
      uri:
        description: Its master URI, for example V(http://kobuki2computer:11311/); its port is read.
        type: str
        default: ""
      declared:
        description: Accepted and not read.
        type: bool
        default: false
      roscore:
        description: >-
          The IPv4 address of a roscore on a sealed computer, for example V(192.168.1.40); empty on
          O(masters[].computer).
        type: str
        default: ""
  present:
    description: >-
      The computers of this run, for example V([kobuki1computer, kobuki2computer]); only their masters are waited for.
      Default is all O(members).
    type: list
    elements: str
  talkers:
    description: >-
      The computers whose talkers run, for example V([kobuki1computer, kobuki2computer]). Default is O(present).
    type: list
    elements: str
  tried:
    description: >-
      The computers that are measured, for example V([kobuki2computer]); other talkers are not heard. Default is all
      O(members).
    type: list
    elements: str
  services:
    description: >-
      The services of this computer, for example V([watchdog, roscore, discovery]); each is a unit
      C(multimaster-<name>.service).
    type: list
    elements: str
    default: []
  environment_file:
    description: The environment of the services, for example V(/etc/rosfleet-multimaster/environment).
    type: path
    default: /etc/rosfleet-multimaster/environment
  variables:
    description: >-
      Variables that the services need in any case, for example V({ROS_HOSTNAME: kobuki1computer}).
    type: dict
    default: {}
  boot:
    description: The planned values after the next boot, which RV(next_boot) compares. Without it nothing is compared.
    type: dict
    suboptions:
      settings:
        description: Kernel settings, as O(rosfleet.multimaster.sysctl#module:settings).
        type: list
        elements: dict
        default: []
        suboptions:
          name:
            description: The name, for example V(net.ipv4.ip_forward).
            type: str
            required: true
          value:
            description: The value, for example V(1).
            type: str
            required: true
          enough:
            description: Other values that serve as well, for example V(["2"]).
            type: list
            elements: str
            default: []
      routes:
        description: Routes, as O(rosfleet.multimaster.routes#module:routes).
        type: list
        elements: dict
        default: []
        suboptions:
          destination:
            description: The destination, for example V(default).
            type: str
            required: true
          gateway:
            description: The gateway, for example V(192.168.10.1).
            type: str
            required: true
      hosts:
        description: V(true) if C(/etc/hosts) has lines of the collection.
        type: bool
        default: true
  multicast:
    description: >-
      The options of M(rosfleet.multimaster.multicast_verify) without its O(action), for example V({name:
      kobuki1computer}). Its two tasks are done in these runs; see RV(multicast). Without it the group is not
      measured.
    type: dict
  look:
    description: >-
      The options of M(rosfleet.multimaster.multimaster_info), for example V({parts: [computer]}), with
      O(action=start). The same run looks at the machine; see RV(machine). Without it nothing is looked at.
    type: dict
  parameters:
    description: >-
      The planned parameters of the nodes on this computer, for example V({master_discovery: {mcast_port: 11511}}).
      RV(parameters) compares them with those on the roscore.
    type: dict
    suboptions:
      master_discovery:
        description: Those of C(/master_discovery), as in RV(rosfleet.multimaster.fleet_plan#module:computers).
        type: dict
        default: {}
      master_sync:
        description: Those of C(/master_sync).
        type: dict
        default: {}
      master_relay:
        version_added: "1.1.0"
        description: Those of C(/master_relay), in C(/etc/rosfleet-multimaster/master_relay.json).
        type: dict
        default: {}
  crossing:
    version_added: "1.1.0"
    description: >-
      Parameters that cross between robots, for example V([/robot_description]); RV(parameters.crossing) has their
      digests.
    type: list
    elements: str
    default: []
  environment:
    description: >-
      The variables of ROS if O(environment_file) is missing, for example V({ROS_MASTER_URI:
      "http://kobuki1computer:11311"}).
    type: dict
    default: {}
  patience:
    description: Seconds to wait at most for missing masters and topics, from 0 to 600, for example V(20).
    type: int
    default: 20
  lifetime:
    description: >-
      Seconds that a talker lives at most, from 10 to 7200, for example V(300). It covers all tasks from the first
      O(action=start) on.
    type: int
    default: 300
  seconds:
    description: >-
      Seconds of a stream with O(action=stream), from 0.1 to 2, for example V(0.5). It ends earlier after 20 MB.
    type: float
    default: 0.5
  packed:
    version_added: "1.1.0"
    description:
      - V(true) to register lists and dictionaries of more than 30 O(members) as one text, which M(rosfleet.multimaster.fleet_report),
        M(rosfleet.multimaster.fleet_packet_trace) and M(rosfleet.multimaster.fleet_bundle) read. So Ansible needs less memory.
      - The controller reads it, and the computer does not.
    type: bool
    default: false
notes:
  - The return values have one level of fields here. All fields and examples are in C(plugins/module_utils/_contract) of the collection.
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multicast_verify
  - module: rosfleet.multimaster.fleet_report
"""

EXAMPLES = r"""
- name: Measure how every computer sees the others
  hosts: robots
  gather_facts: false
  become: true
  module_defaults:
    rosfleet.multimaster.multimaster_verify:
      run: morning
      name: "{{ inventory_hostname }}"
      is_master: "{{ multimaster_fleet.computers[inventory_hostname].is_master }}"
      members: "{{ multimaster_fleet.members }}"
      masters: "{{ multimaster_fleet.masters }}"
      port: "{{ multimaster_fleet.multicast_port }}"
  tasks:
    - name: Compute the plan of the fleet
      rosfleet.multimaster.fleet_plan:
      run_once: true
      register: multimaster_fleet

    - name: Start the talkers
      rosfleet.multimaster.multimaster_verify:
        action: start

    - name: Look at all others
      rosfleet.multimaster.multimaster_verify:
        action: collect
      register: seen

    - name: Stop the talkers
      rosfleet.multimaster.multimaster_verify:
        action: stop
"""

RETURN = r"""
members:
  description: The measurements from this computer to every computer of the fleet; of itself only the addresses
    of its name.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    name: {description: The name of the computer., type: str}
    address: {description: Its planned address., type: str}
    addresses: {description: 'The IPv4 addresses that its name has on this computer, by the resolver that all programs use.',
        type: list, elements: str}
    file_addresses: {description: The addresses that its name has in C(/etc/hosts)., type: list, elements: str}
    resolve_error: {description: 'Why the name has none, or empty.', type: str}
    route: {description: The route that the kernel takes to the planned address., returned: for every other computer, type: dict}
    discovery_route: {description: 'The route to RV(members[].name)''s O(members[].discovery_address), as RV(members[].route); null
          if that is its address.', returned: for every other computer, type: dict}
    ping_address: {description: Whether an ICMP echo request to the planned address is answered; up to three are sent., returned: for
          every other computer, type: dict}
    ping_name: {description: The same for the first address that the name has on this computer., returned: for every other computer,
        type: dict}
    ping_large: {description: 'The same for packets to the planned address that are as large as this computer''s interface allows,
          1500 bytes at most, and that no router may split.', returned: for every other computer, type: dict}
    neighbour: {description: The hardware address that this computer knows for the planned address; empty for a computer in another
          network., returned: for every other computer, type: str}
    neighbour_fixed: {description: 'Whether a person or a program has set that hardware address, so that the kernel does not ask for
          it.', returned: for every other computer, type: bool}
    user_addresses: {description: 'The IPv4 addresses that its name has for the user C(nobody), or null if that was not looked up.',
        type: list, elements: str}
    loss: {description: 'The share of 20 further small echo requests to the planned address that have no answer, from 0
          to 1; null if none were sent.', returned: for every other computer, type: float}
    tcp: {description: 'If no ping is answered, the answer of TCP port 9 (discard) of the planned address, V(refused) if
          the computer is there all the same, or why nothing came back.', returned: for every other computer, type: str}
    tcp_outcome: {description: 'RV(members[].tcp) as one word, a word of RV(masters[].outcome).', returned: for every other computer,
        type: str}
    silent: {description: 'Whether no ping was answered, and within 3.5 seconds no computer on the way reported a reason,
          neither this computer''s kernel nor a gateway.', returned: for every other computer, type: bool}
default_routes:
  description: The default routes of this computer.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    device: {description: The interface., type: str}
    source: {description: 'The source address, or null if the route names none.', type: str}
    gateway: {description: 'The gateway, or null if the route names none.', type: str}
    metric: {description: 'The metric, or null if the route names none, which is the metric 0.', type: str}
claims:
  description: The computers that answer for an address on the networks of this computer, asked by ARP without an
    address of its own, so that it changes nothing. The own addresses, for which no other computer is to answer,
    and those of O(members) and of gateways, for which one computer is. Empty if the kernel does not allow it, and
    without an interface of Ethernet.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    address: {description: The address that was asked for., type: str}
    interface: {description: The interface by which was asked., type: str}
    macs: {description: The hardware addresses of all who answered; for the own address there should be no answer., type: list,
        elements: str}
policy:
  description: The rules and tables that decide about packets besides the routes of the main table.
  returned: when O(action=collect)
  type: dict
  contains:
    rules: {description: 'The rules without the kernel''s own, as C(ip rule) prints them, 100 at most.', type: list, elements: str}
    closed: {description: 'The routes of all tables that lead nowhere, as C(ip route) prints them, 100 at most.', type: list,
        elements: str}
name_sources:
  description: The sources for the address of a name, in this order, as the line C(hosts) of C(/etc/nsswitch.conf)
    says it. Empty if it says nothing.
  returned: when O(action=collect), but not for the router
  type: list
  elements: str
  sample: [files, dns]
forwarding:
  description: The values that decide about packets from one network to another through this computer.
  returned: when O(action=collect)
  type: dict
  contains:
    ip_forward: {description: 'C(net.ipv4.ip_forward), or null if it cannot be read.', type: int}
    interfaces: {description: The interfaces that have an IPv4 address., type: list, elements: dict}
    icmp_echo_ignore_all: {description: 'C(net.ipv4.icmp_echo_ignore_all), V(1) if the kernel answers no pings, or null if it cannot be
          read.', type: int}
    macs: {description: 'The hardware addresses of all interfaces that are up, also of those without an address, such as
          the ports of a bridge.', version_added: 1.1.0, type: list, elements: str}
masters:
  description: The discovery node of every master.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    computer: {description: The computer that runs the roscore., type: str}
    address: {description: Its address., type: str}
    port: {description: The TCP port of its discovery node., type: int}
    open: {description: Whether a TCP connection from this computer opens., type: bool}
    connect_ms: {description: 'How long that takes in milliseconds, or null.', type: float}
    error: {description: 'Why it does not open, or empty.', type: str}
    outcome: {description: 'The same as one word, V(open), V(refused), V(no_answer), V(network_unreachable), V(host_unreachable),
          V(unknown_name), V(failed) or V(not_tried).', type: str}
    errno: {description: 'The number of the error of the kernel here, or null.', type: int}
    route: {description: 'The route that the kernel takes to that address, as RV(members[].route).', type: dict}
    roscore: {description: 'The answer of the TCP port of its roscore, by O(masters[].uri), V(open) or why it does not open;
          empty if the URI is not given.', type: str}
    roscore_outcome: {description: 'The same as one word, as RV(masters[].outcome).', type: str}
    clock_offset_s: {description: 'How many seconds its clock is ahead of this computer''s by C(getCurrentTime), or null without an
          answer.', type: float}
    clock_uncertainty_s: {description: 'By how many seconds this may be wrong, half of the round-trip time, or null without an answer.',
        type: float}
    clock_error: {description: 'Why there was no answer on an open port, or empty.', type: str}
roscore:
  description: The roscore of this computer's robot.
  returned: when O(action=collect)
  type: dict
  contains:
    uri: {description: C(ROS_MASTER_URI) in O(environment_file)., type: str}
    answer: {description: 'The master URI by which it knows itself, by C(getUri), or empty without an answer.', type: str}
    error: {description: 'Why there was no answer, or empty.', type: str}
    outcome: {description: 'The same as one word, V(answered), or as RV(masters[].outcome).', type: str}
    tcp_outcome: {description: 'If no answer came, the outcome of a TCP connection to it, a word of RV(masters[].outcome).', version_added: 1.1.0,
        type: str}
    waiting: {description: 'If no answer came, how many connections wait at its port to be taken, null if it is not on this
          computer.', version_added: 1.1.0, type: int}
list_masters:
  description: The answer of C(rosservice call /master_discovery/list_masters) on this computer.
  returned: when O(action=collect)
  type: dict
  contains:
    masters: {description: The masters., type: list, elements: dict}
    seconds: {description: 'How long it took until all masters of O(present) were online, or until O(patience) was over.',
        type: float}
    error: {description: 'Why the last call failed, or empty.', type: str}
topics:
  description: The texts of the talkers of the other computers, as heard here.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    computer: {description: The computer of the talker., type: str}
    topic: {description: Its topic., type: str}
    publishers: {description: 'The publishers of the topic as the roscore of this computer''s robot knows them, as C(rostopic
          info) shows.', type: list, elements: dict}
    reached: {description: 'If a publisher is registered and nothing was heard, V(open) if a TCP connection to its URI opens,
          else why not; empty otherwise.', type: str}
    reached_outcome: {description: 'The same as one word, as RV(masters[].outcome).', type: str}
    step: {description: 'If nothing was heard, how far the call to a publisher has come.', type: str}
    listened: {description: Whether the listener of this computer ran., type: bool}
    heard: {description: Whether a subscriber on this computer hears the text of this run's talker., type: bool}
    text: {description: The text that it heard., type: str}
    seconds: {description: 'After how many seconds of listening, or null if it heard nothing.', type: float}
    error: {description: 'Why nothing was heard, or empty.', type: str}
outsiders:
  description: The senders of heartbeats that the discovery node of this computer ignores, since they do not belong
    to the fleet. Empty if the nodes are not the collection's own.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    address: {description: The address from which it sends., type: str}
    name: {description: 'The name that it says, or empty.', type: str}
    uri: {description: 'The URI of its master, or empty.', type: str}
    why: {description: Why it is ignored., type: str}
sources:
  description: The topics in the states of discovery nodes. The own one is asked for all that the roscore has, another
    one for those of talkers that are to be heard here and that the own roscore has not. If O(is_master=false),
    it is empty.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    computer: {description: The computer of the discovery node., type: str}
    topics: {description: The topics that it was asked for., type: list, elements: str}
    given: {description: Those of them that it gives to this computer., type: list, elements: str}
    error: {description: 'Why it gave no answer, or empty.', type: str}
    outcome: {description: 'The same as one word, V(answered), V(refused), V(no_answer), V(network_unreachable), V(host_unreachable),
          V(no_local_port), V(unknown_name) or V(failed).', type: str}
exchange:
  description: The contents of the roscore of this computer, by the robot that it is of, read at the end of the
    run. If O(is_master=false), it is empty, and RV(exchange.error) says so.
  returned: when O(action=collect)
  type: dict
  contains:
    error: {description: 'Why it could not be read, or empty.', type: str}
    types_error: {description: 'Why the md5 sums are not known, or empty.', type: str}
    topics: {description: The topics that the robot's own nodes have registered., type: list, elements: dict}
    services: {description: The services of the robot's own nodes., type: list, elements: dict}
    imports: {description: 'The registrations for other masters, by the parameter C(/rosfleet_multimaster/imports), or by the
          service C(get_sync_info) of another implementation of master_sync.', type: list, elements: dict}
    silent: {description: The robot's own nodes that are registered and do not answer at their URI., type: list, elements: str}
    silences: {description: 'The same, with the reason of each.', type: list, elements: dict}
    announced: {description: 'The robot''s own nodes that announce another host than the planned names and addresses of their
          robot, or whose services are on another computer, 100 at most.', version_added: 1.1.0, type: list, elements: dict}
    unreached: {description: 'The nodes of other robots that are registered here, and to whose port no TCP connection opens from
          here; of more than 300, one of every so many is tried.', version_added: 1.1.0, type: list, elements: dict}
    nodes: {description: The number of the robot's own nodes., version_added: 1.1.0, type: dict}
    connections: {description: 'The connections of the robot''s own nodes with nodes of other robots, by C(getBusInfo).', type: list,
        elements: dict}
    types_outcome: {description: 'What became of the question for the md5 sums, V(answered), V(no_answer) where its time was over,
          or V(failed).', type: str}
traffic:
  description: The traffic of the robot's nodes to nodes of other robots, on the computer of a roscore. Their counters
    (C(getBusStats)) were read twice.
  returned: when O(action=collect)
  type: dict
  contains:
    seconds: {description: The time between the two readings., type: float}
    flows: {description: 'The topics of each node that subscribers on another robot get, those with most bytes first, 200
          at most.', type: list, elements: dict}
relays:
  description: 'The relays of other robots with which the relay of this robot has a channel by O(parameters.master_relay):
    are they reached, and the ports of their data.'
  version_added: 1.1.0
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    robot: {description: The robot., type: str}
    host: {description: Its address., type: str}
    port: {description: The TCP port of its relay., type: int}
    outcome: {description: 'The outcome of the question for its offers, V(answered), or as RV(masters[].outcome).', type: str}
    data_port: {description: 'The TCP port of its data, as it answers, or 0.', type: int}
    data_outcome: {description: 'The outcome of a TCP connection to that port, as RV(masters[].outcome).', type: str}
    error: {description: 'Why one of the two failed, or empty.', type: str}
    crossing: {description: 'Two of the topics that come from that robot alone, none of images or point clouds if there are
          others.', type: list, elements: dict}
parameters:
  description: The parameters of the nodes on the roscore, compared with O(parameters).
  returned: when O(action=collect)
  type: dict
  contains:
    nodes: {description: The nodes whose parameters were compared., type: list, elements: str}
    differing: {description: The parameters with another value than planned., type: list, elements: dict}
    crossing: {description: The parameters of O(crossing)., version_added: 1.1.0, type: list, elements: dict}
    simulated: {description: 'Whether C(/use_sim_time) is true, so that nodes take their time from C(/clock).', version_added: 1.1.0,
        type: bool}
    error: {description: 'Why they could not be read, or empty.', type: str}
clock:
  description: The clock of this computer.
  returned: when O(action=collect)
  type: dict
  contains:
    synchronised: {description: 'Whether something keeps it right, such as chrony, as the kernel knows it; null if it does not report
          that.', type: bool}
    answers: {description: 'Whether a time service answers, or null if none was asked.', version_added: 1.1.0, type: bool}
    service: {description: 'The time service that answers, V(chrony), V(systemd-timesyncd) or V(ntpd), or empty.', version_added: 1.1.0,
        type: str}
    sources: {description: 'The sources of time that it has, at most 32.', version_added: 1.1.0, type: list, elements: dict}
tunnel:
  description: The tunnel of the collection on this computer, as WireGuard shows it. No private key is asked for.
  version_added: 1.1.0
  returned: when O(action=collect)
  type: dict
  contains:
    up: {description: 'Whether there is one, or null if it was not looked at.', type: bool}
    public_key: {description: 'The public half of its own key, or empty.', type: str}
    port: {description: 'Its UDP port, or 0.', type: int}
    time_s: {description: 'The time of its clock, in seconds since 1970, or null if the tunnel was not looked at.', type: float}
    mtu: {description: 'The largest packet that it takes, in bytes, or 0.', type: int}
    peers: {description: The other computers that it lets in., type: list, elements: dict}
disks:
  description: The room that is left for others than root on the disks of services, each file system once.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    path: {description: The first of the folders on it., type: str}
    free_bytes: {description: Bytes., type: int}
    free_files: {description: 'Files, or null if the file system does not count them.', type: int}
file_limits:
  description: Processes of ROS that may open more than 1048576 files, once for each unit, 20 at most.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    node: {description: 'The name of the node, or of its program.', type: str}
    limit: {description: The files that it may open (the soft limit)., type: int}
    unit: {description: 'The systemd service that has started it, or empty, as for a node that was started in a shell or
          a container.', type: str}
    person: {description: The user whose own manager has this unit (C(systemctl --user)); empty for a unit of the computer.,
        version_added: 1.1.0, type: str}
full_processes:
  description: Processes that have as many files open as they may, or one fewer, 20 at most.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    name: {description: 'The name of the node in its command line, or its program.', type: str}
    pid: {description: The number of the process., type: int}
    unit: {description: 'The unit of systemd in which it runs, or empty.', type: str}
    open_files: {description: How many files it has open., type: int}
    most_files: {description: How many it may have open (C(RLIMIT_NOFILE))., type: int}
    person: {description: The user whose own manager has this unit (C(systemctl --user)); empty for a unit of the computer.,
        version_added: 1.1.0, type: str}
container_names:
  description: Containers with processes of ROS whose own C(/etc/hosts) lacks names of the fleet that this computer's
    has, 20 at most.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    node: {description: 'A process there, by the name of its node or of its program.', type: str}
    unit: {description: 'The unit of systemd that has the container, or empty.', type: str}
    missing: {description: The names., type: list, elements: str}
node_hosts:
  description: Processes of ROS on this computer that announce another host than its planned name and addresses,
    use another roscore than planned, or are stopped, and those of which this cannot be read, 100 at most. A node
    announces the host of C(ROS_HOSTNAME) or C(ROS_IP), or else the name of the computer.
  version_added: 1.1.0
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    host: {description: 'The host, or empty if it is not known.', type: str}
    source: {description: 'The variable or argument that has decided it (C(ROS_HOSTNAME), C(ROS_IP), C(__hostname), C(__ip)),
          or C(hostname).', type: str}
    unit: {description: 'The unit of systemd in which the process runs, or empty.', type: str}
    ports: {description: The TCP ports on which the process listens., type: list, elements: int}
    node: {description: 'The name of the node in its command line, or its program.', type: str}
    master: {description: 'The URI of the roscore that it uses, if that is not the planned one; else empty.', type: str}
    starter: {description: 'Its starter, V(shell), V(unit), V(launch) for roslaunch, or V(container).', type: str}
    launch: {description: 'The name of the launch file, or empty.', type: str}
    of_unit: {description: Whether its unit gives the variables that are not as planned; False if a script or a command line
          of the unit does., type: bool}
    stopped: {description: Whether it is stopped by a signal or a debugger., type: bool}
    readable: {description: Whether its environment can be read; in some containers root may not., type: bool}
    apart: {description: 'Whether it is in a network of its own, as a container of a bridge is: its ports are not there on
          the computer.', type: bool}
    master_source: {description: 'The variable or argument that has decided this roscore, C(ROS_MASTER_URI) or C(__master); empty
          if the roscore is the planned one.', version_added: 1.1.0, type: str}
    person: {description: The user whose own manager has this unit (C(systemctl --user)); empty for a unit of the computer.,
        version_added: 1.1.0, type: str}
    pid: {description: The number of the process., type: int}
    topics: {description: 'Some topics that it publishes, of a node without a registration alone, 4 at most.', type: list,
        elements: str}
unregistered:
  description: The nodes on this computer that are registered nowhere at the roscore of its robot, as after it was
    started anew.
  version_added: 1.1.0
  returned: when O(action=collect)
  type: dict
  contains:
    nodes: {description: 'The processes that answer as nodes do, as RV(node_hosts).', type: list, elements: dict}
    unknown: {description: 'How many processes of ROS listen, and have no port that is registered.', type: int}
    asked: {description: How many of them were asked whether they are nodes., type: int}
changes:
  description: When files were changed and services were started that may decide names and packet filters. A change
    of a kernel by hand has no time.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    about: {description: 'The subject of its decision, V(names), the V(order) of name services, the rules of V(ufw), V(firewalld),
          V(docker), V(libvirtd) or V(fail2ban), or those of a table of nftables, such as V(table inet filter).', type: str}
    what: {description: The file or the service., type: str}
    how: {description: V(was changed) or V(was started)., type: str}
    when: {description: 'The time, of a service as systemd writes it.', type: str}
services:
  description: The services of O(services).
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    name: {description: The service., type: str}
    unit: {description: Its unit., type: str}
    load_state: {description: C(LoadState) of systemd., type: str}
    active_state: {description: C(ActiveState) of systemd., type: str}
    sub_state: {description: C(SubState) of systemd., type: str}
    restarts: {description: How often systemd had to start it again by itself., type: int}
    differing: {description: 'The variables of O(environment_file) and of O(variables) that its running process has with another
          value, or not at all.', type: list, elements: str}
    drop_ins: {description: 'The drop-in files of its unit that set, or take away, a variable that differs.', type: list, elements: str}
    command_drop_ins: {description: The drop-in files of its unit with another command., version_added: 1.1.0, type: list, elements: str}
    since: {description: 'C(StateChangeTimestamp) of systemd, the time of its last change of state, empty if it never ran.',
        type: str}
    stopped: {description: 'Whether its process is stopped by a signal or a debugger, so that it runs and does nothing.', type: bool}
    refused: {description: 'The names of other robots that this service refuses, as master_sync reports them to systemd.',
        type: list, elements: str}
    refusals: {description: 'The same names with the reasons, 50 at most; a master_sync of an older release reports none.',
        version_added: 1.1.0, type: list, elements: dict}
    age_s: {description: 'The seconds since its last start, by a clock of this computer that nobody steps, or null.', type: float}
    open_files: {description: 'How many files its process with the fewest left has open, or null if it cannot be looked at.',
        type: int}
    most_files: {description: 'How many files this process may have open (C(RLIMIT_NOFILE)), or null.', type: int}
    result: {description: 'How it ended last, if systemd has started it again, or it has failed.', version_added: 1.1.0, type: str}
    status: {description: 'The exit status of its process then, or the number of the signal that ended it, or null.', version_added: 1.1.0,
        type: int}
next_boot:
  description: Things that work now, or not, and will not be as O(boot) and O(services) say after the next boot.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    kind: {description: 'V(unit) for a service, V(sysctl) for a kernel setting, V(route), or V(names) for C(/etc/hosts).',
        type: str}
    name: {description: 'The unit, the setting, the route or the file.', type: str}
    expected: {description: The planned value., type: str}
    found: {description: The value by the files of this computer., type: str}
    file: {description: The file that decides; empty if none does., type: str}
    when: {description: 'The time of the last change of this file, or an empty text without a file.', type: str}
pace:
  description: How many times longer things take on this computer than if it were idle, 1 to 6; its limits of time
    were stretched by it at least.
  version_added: 1.1.0
  returned: when O(action=collect)
  type: float
  sample: 1.0
talker:
  description: The talker of this computer.
  returned: unless O(action=stop) or O(is_router=true)
  type: dict
  contains:
    running: {description: Whether it runs., type: bool}
    error: {description: 'Why it does not run, or the last line that it wrote.', type: str}
    failed: {description: Whether it should run and could not be started., returned: when O(action=start), type: bool}
    msg: {description: The same as a sentence., returned: when O(action=start) and it was not started, type: str}
ros_missing:
  description: Why no node can run on this computer, or empty if ROS is set up.
  returned: when O(action=collect)
  type: str
  sample: ''
problems:
  description: One sentence for each part that could not be looked at; such a part has an empty value.
  returned: when O(action=collect)
  type: list
  elements: str
  sample: []
streams:
  description: How fast a stream of this computer comes to each of O(talkers).
  returned: when O(action=stream)
  type: list
  elements: dict
  contains:
    computer: {description: The computer., type: str}
    mbit_s: {description: How many megabits came there in a second; null if that is not known., type: float}
    error: {description: 'Why it is not known, or empty.', type: str}
multicast:
  description: The result of M(rosfleet.multimaster.multicast_verify) with the same action; if that fails, V(failed)
    and the sentence in C(msg).
  returned: when O(multicast), with O(action=start) or O(action=collect)
  type: dict
  sample: {udp: [], heard: [], missing: [], unexpected: [], msg: Every other computer (0) is heard on the group and hears
        this one.}
machine:
  description: The result of M(rosfleet.multimaster.multimaster_info).
  returned: when O(action=start) and O(look)
  type: dict
  sample: {problems: [], hostname: kobuki1computer, owned: [routes, sysctl]}
seconds:
  description: How long the looking took.
  returned: when O(action=collect)
  type: float
  sample: 2.3
msg:
  description: The result, in a sentence.
  returned: always
  type: str
  sample: Looked at 2 computers in 2.3 s.
"""

from ..module_utils._base import actions
from ..module_utils._base.module import Module
from ..module_utils._probe.options import find_wrong_option
from ..module_utils._probe.run import ACTIONS

TEXT = {"type": "str", "required": True}
MEMBER = {
    "name": TEXT,
    "address": TEXT,
    "robot": {"type": "str", "default": ""},
    "network": {"type": "str", "default": ""},
    "discovery_address": {"type": "str", "default": ""},
    "discovery": {"type": "bool", "default": False},
    "multicast": {"type": "bool", "default": False},
}
MASTER = {
    "computer": TEXT,
    "address": TEXT,
    "name": TEXT,
    "rpc_port": {"type": "int", "required": True},
    "monitor_uri": TEXT,
    "robot": {"type": "str", "default": ""},
    "uri": {"type": "str", "default": ""},
    "declared": {"type": "bool", "default": False},
    "roscore": {"type": "str", "default": ""},
}
SETTING = {"name": TEXT, "value": TEXT, "enough": {"type": "list", "elements": "str", "default": []}}
ROUTE = {"destination": TEXT, "gateway": TEXT}
BOOT = {
    "settings": {"type": "list", "elements": "dict", "default": [], "options": SETTING},
    "routes": {"type": "list", "elements": "dict", "default": [], "options": ROUTE},
    "hosts": {"type": "bool", "default": True},
}
PARAMETERS = {name: {"type": "dict", "default": {}} for name in ("master_discovery", "master_sync", "master_relay")}
ARGUMENTS = {
    "action": {"type": "str", "choices": actions.list_words(*ACTIONS), "aliases": ["state"], "default": "collect"},
    "run": {"type": "str", "default": "default"},
    "name": {"type": "str"},
    "is_master": {"type": "bool", "default": False},
    "is_router": {"type": "bool", "default": False},
    "members": {"type": "list", "elements": "dict", "options": MEMBER},
    "fleet": {"type": "str"},  # read by the action
    "port": {"type": "int", "default": 11511},
    "masters": {"type": "list", "elements": "dict", "options": MASTER},
    "present": {"type": "list", "elements": "str"},
    "talkers": {"type": "list", "elements": "str"},
    "tried": {"type": "list", "elements": "str"},
    "services": {"type": "list", "elements": "str", "default": []},
    "environment_file": {"type": "path", "default": "/etc/rosfleet-multimaster/environment"},
    "variables": {"type": "dict", "default": {}},
    "parameters": {"type": "dict", "options": PARAMETERS},
    "crossing": {"type": "list", "elements": "str", "default": []},
    "environment": {"type": "dict", "default": {}},
    "multicast": {"type": "dict"},
    "look": {"type": "dict"},
    "boot": {"type": "dict", "options": BOOT},
    "patience": {"type": "int", "default": 20},
    "lifetime": {"type": "int", "default": 300},
    "seconds": {"type": "float", "default": 0.5},
    "packed": {"type": "bool", "default": False},  # read by the action
}


NEEDED = {"start": ["name"], "collect": ["name", "members", "masters"], "stream": ["name", "members"]}


def main() -> None:
    module = Module(
        argument_spec=ARGUMENTS,
        required_if=[
            ("action", word, needed) for action, needed in NEEDED.items() for word in actions.list_words(action)
        ],
        supports_check_mode=True,
    )
    actions.carry_out(module, find_wrong_option, ACTIONS)


if __name__ == "__main__":
    main()
