# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The findings of multimaster_info on a machine before it becomes a computer of the fleet."""

import typing

from .clock import TimeSource
from .fields import Struct, field
from .installations import RosFacts, RunningMaster
from .network import FilterChains, ForwardingSettings


class OperatingSystem(Struct):
    """The operating system of a machine."""

    id: str = field("Its short name.", "debian")
    version: str = field("Its version.", "12")
    name: str = field("Its name for people.", "Debian GNU/Linux 12 (bookworm)")


class ServiceManager(Struct):
    """The service manager of a machine."""

    running: bool = field("Whether systemd runs this machine.", True)
    version: int = field("Its version, 0 if it is not installed.", 252)
    net_admin: bool = field(
        "Whether it may give C(CAP_NET_ADMIN) to services, which some containers do not let it.", True, default=True
    )


class InterfaceAddress(Struct):
    """An address of an interface."""

    address: str = field("The address.", "192.168.1.229")
    prefix: int = field("The length of its network's prefix, in bits.", 24)
    family: str = field("V(inet) for IPv4, V(inet6) for IPv6.", "inet")


class InterfaceFacts(Struct):
    """A network interface of a machine."""

    name: str = field("The name of the interface.", "eth0")
    up: bool = field("Whether it is switched on.", True)
    multicast: bool = field("Whether it does multicast.", True)
    loopback: bool = field("Whether it is the loopback interface.", False)
    mtu: int = field("The largest packet, in bytes.", 1500)
    port_of: str = field(
        "The bridge or bond of which it is a port, or empty. A packet that comes in at a port belongs to the interface above it.",
        "",
        added="1.1.0",
    )
    macvlan_of: str = field(
        "The interface below it, if it is a macvlan, or empty. Both answer ARP for each address of the machine.",
        "",
        added="1.1.0",
    )
    point_to_point: bool = field("Whether it is one end of a link with two ends, such as a tunnel.", False)
    addresses: typing.Tuple[InterfaceAddress, ...] = field("Its addresses.")


class LookedUpRoute(Struct):
    """The route that the kernel would take to an address."""

    destination: str = field("The address that was asked for.", "192.168.10.1")
    gateway: typing.Optional[str] = field(
        "The next hop, null if the address is on a network of this machine or there is no route.", "192.168.11.101"
    )
    device: typing.Optional[str] = field("The interface on which packets leave, null if there is no route.", "eth0")
    source: typing.Optional[str] = field(
        "The address from which packets leave, null if there is no route.", "192.168.11.100"
    )
    error: str = field("Why there is no route, else empty.", "")


class TableRoute(Struct):
    """A route of a table."""

    destination: str = field("The network, V(0.0.0.0/0) for a default route.", "192.168.10.0/24")
    gateway: str = field(
        "The next hop, empty if the network is on the interface itself, and for several next hops.", "192.168.1.202"
    )
    device: str = field("The interface, empty for a route that leads nowhere, and for several next hops.", "eth0")
    metric: int = field("The metric; of two routes to a network the one with the lower metric counts.", 0)
    source: str = field("The address from which packets leave, empty if the route does not say it.", "192.168.1.201")
    type: str = field(
        "V(unicast), or V(blackhole), V(unreachable), V(prohibit), V(throw) for a route that leads nowhere.", "unicast"
    )


class RoutingTable(Struct):
    """A table of routes other than the main one."""

    table: str = field("The name or the number of the table, as the rules have it.", "100")
    routes: typing.Tuple[TableRoute, ...] = field("Its routes, as RV(routing.routes).")


class Routing(Struct):
    """The routes and rules that decide how packets leave a machine."""

    routes: typing.Tuple[TableRoute, ...] = field(
        "The routes of the main table, also those that the kernel makes for addresses."
    )
    rules: typing.Tuple[str, ...] = field(
        "The rules of policy routing without the kernel's own, as C(ip rule) prints them.",
        ["100: from 10.0.0.0/8 lookup 100"],
    )
    tables: typing.Tuple[RoutingTable, ...] = field("The other tables to which the rules lead, 32 at most.")


class MulticastRouter(Struct):
    """The program that passes multicast on between the interfaces of a machine."""

    smcrouted: str = field("The program of smcroute, empty if it is not installed.", "/usr/sbin/smcrouted")
    others: typing.Tuple[str, ...] = field(
        "The active units of Debian's packages that do it already; the kernel takes one program at a time.", []
    )


class TunnelSupport(Struct):
    """The needs of a tunnel of WireGuard on a machine."""

    kernel: bool = field("Whether the kernel has WireGuard.", True, default=True)
    device: bool = field("Whether there is C(/dev/net/tun), which wireguard-go needs.", True, default=True)


class Package(Struct):
    """A Debian package."""

    name: str = field("The name of the package.", "ros-noetic-fkie-master-sync")
    installed: str = field("The version that is installed, or empty.", "1.3.2-2focal")
    candidate: str = field("The version that apt would install, empty if its sources have none.", "1.3.2-2focal")
    ours: bool = field("Whether the collection installed it.", True)


class PortHolder(Struct):
    """A socket on a port, and the process that has it."""

    protocol: str = field("V(tcp) or V(udp).", "tcp")
    port: int = field("The number of the port.", 11311)
    address: str = field("The address that the socket is bound to.", "0.0.0.0")
    pid: int = field("The process that has it open, 0 if that cannot be seen.", 512)
    command: str = field("The command line of that process.", "/usr/bin/python3 /usr/bin/rosmaster --core -p 11311")
    user: str = field("The user who owns the socket.", "robot")
    unit: str = field("The systemd unit of that process, empty if it has none.", "roscore.service")
    container: bool = field(
        "Whether that process has numbers of its own below this machine's, as processes in a container have.", False
    )
    person: str = field(
        "The user whose own manager has this unit (C(systemctl --user)); empty for a unit of the computer.",
        "",
        added="1.1.0",
    )


class ExportLine(Struct):
    """A foreign line that sets a variable of ROS for shells."""

    file: str = field("The file; empty if a shell has the variable, and no line was found.", "/home/robot/.bashrc")
    line: int = field("The number of the line, 0 if none was found.", 118)
    variable: str = field("The variable.", "ROS_MASTER_URI")
    value: str = field(
        "The value in the shell of RV(exports[].person). If none was asked, the value that the line sets, as far as that is a plain word.",
        "http://localhost:11311",
    )
    text: str = field(
        "The statement in the line, or its form in the shell; other variables are without their values.",
        "export ROS_MASTER_URI=http://localhost:11311",
    )
    person: str = field(
        "The person whose shell was asked, and has the value; empty if none was asked.", "robot", added="1.1.0"
    )
    shell: str = field("V(interactive), V(login), or empty if no shell was asked.", "interactive", added="1.1.0")


class SilentShell(Struct):
    """A question about the variables of a person's shell without an answer."""

    person: str = field("The person.", "robot")
    shell: str = field("V(interactive) or V(login) for a shell, V(files) for the files of that person.", "interactive")


class SetEnv(Struct):
    """A foreign line SetEnv."""

    file: str = field("The file.", "/etc/ssh/sshd_config")
    line: int = field("The number of the line.", 7)
    text: str = field("The line.", "SetEnv LANG=C.UTF-8")
    match: bool = field("Whether it is below a C(Match) and so concerns some users only.", False)


class SshServer(Struct):
    """The ssh server of a machine."""

    installed: bool = field("Whether there is one.", True)
    includes_drop_ins: bool = field("Whether it reads the files in C(/etc/ssh/sshd_config.d) for every user.", True)
    other_setenv: typing.Tuple[SetEnv, ...] = field("The C(SetEnv) lines that are not the collection's.")
    match_setenv: bool = field(
        "Whether it knows C(SetEnv) below a C(Match). OpenSSH 8.4 gives such variables to no user.", True, default=True
    )
    path: str = field("The C(PATH) of C(/etc/environment); empty if it sets none.", "")
    service: str = field("The active unit of the server, empty if it is not a running service.", "ssh.service")
    reload_due: bool = field(
        "Whether the collection's file is newer than the configuration of the running server.", False
    )


class Shells(Struct):
    """The variables that shells really see; of any name."""

    login: typing.Optional[typing.Dict[str, typing.Any]] = field(
        "In a new login shell. Null if there is no bash.",
        {"ROS_MASTER_URI": "http://kobuki1computer:11311", "ROS_HOSTNAME": "kobuki1computer"},
    )
    ssh: typing.Optional[typing.Dict[str, typing.Any]] = field(
        "In a command by ssh, as far as sshd sets it. Null if there is no sshd, or its settings cannot be read, which needs root.",
        {"ROS_MASTER_URI": "http://kobuki1computer:11311", "ROS_HOSTNAME": "kobuki1computer"},
    )
    desktop: typing.Optional[typing.Dict[str, typing.Any]] = field(
        "In a session of systemd's user manager, as far as C(environment.d) sets it. Null without such a manager.",
        {"ROS_MASTER_URI": "http://kobuki1computer:11311", "ROS_HOSTNAME": "kobuki1computer"},
    )


class TimeConfiguration(Struct):
    """A configuration of a time service that a person or a program has written."""

    service: str = field("The unit of systemd.", "systemd-timesyncd.service")
    file: str = field("The file.", "/etc/systemd/timesyncd.conf")
    line: str = field("The line that names a source of time, or a remark in its place.", "NTP=192.168.1.9")


class TimeServices(Struct):
    """The time services of a machine."""

    chronyd: str = field("The program of chrony, empty if it is not installed.", "/usr/sbin/chronyd")
    enabled: bool = field("Whether C(chrony.service) starts at boot.", True)
    settable: bool = field(
        "Whether systemd may let a service set the clock (CAP_SYS_TIME). In most containers it may not.",
        True,
        default=True,
    )
    others: typing.Tuple[TimeConfiguration, ...] = field(
        "The configurations of time services that a person or a program has written, not their Debian package and not the collection; at most 20."
    )
    sources: typing.Tuple[TimeSource, ...] = field(
        "The sources of time that the time service has, at most 32. Those without an address, such as a radio clock, are left out."
    )
    restart_due: bool = field(
        "Whether chrony runs since before the present files of the collection, or does not run with them.", False
    )


class MachineFacts(Struct):
    """The answer of multimaster_info."""

    hostname: str = field(
        "The name that the machine calls itself.", "kobuki1computer", returned="with the part V(system)"
    )
    python: str = field(
        "The version of the Python that runs the modules.", "3.11.2", returned="with the part V(system)"
    )
    kernel: str = field("The release of the kernel.", "6.1.0-28-amd64", returned="with the part V(system)")
    os: OperatingSystem = field("The operating system, as C(/etc/os-release) says.", returned="with the part V(system)")
    systemd: ServiceManager = field("The service manager.", returned="with the part V(system)")
    owned: typing.Tuple[str, ...] = field(
        "The records of the changes of the collection's modules on this machine, by their names.",
        ["files-nodes", "hosts_entries", "services-multimaster", "sysctl"],
        returned="with the part V(owned)",
    )
    interfaces: typing.Tuple[InterfaceFacts, ...] = field(
        "The network interfaces.", returned="with the part V(interfaces)"
    )
    ways: typing.Tuple[LookedUpRoute, ...] = field(
        "The routes that the kernel would take to O(destinations).", returned="with the part V(ways)"
    )
    routing: Routing = field("The routes of IPv4, which decide how packets leave.", returned="with the part V(routing)")
    forwarding: ForwardingSettings = field(
        "The kernel's settings that decide about packets through this machine.", returned="with the part V(forwarding)"
    )
    filters: FilterChains = field(
        "The packet filter of nftables, also the rules of iptables in it, as far as it can be read simply.",
        returned="with the part V(filters)",
    )
    multicast_routing: MulticastRouter = field(
        "The state of multicast routing between interfaces.", returned="with the part V(multicast_routing)"
    )
    clock: TimeServices = field("The time services of this machine.", returned="with the part V(clock)", added="1.1.0")
    tunnel: TunnelSupport = field(
        "The support for a tunnel of WireGuard.", returned="with the part V(tunnel)", added="1.1.0"
    )
    ros: RosFacts = field("ROS 1 on this machine.", returned="with the part V(ros)")
    folders: typing.Tuple[str, ...] = field(
        "Those of O(folders) that are there, and are folders.",
        ["/var/lib/prometheus/node-exporter"],
        returned="with the part V(folders)",
    )
    packages: typing.Tuple[Package, ...] = field(
        "The Debian packages of O(packages), and those that the collection installed.",
        returned="with the part V(packages)",
    )
    ports: typing.Tuple[PortHolder, ...] = field(
        "The listening TCP and bound UDP sockets on O(ports).", returned="with the part V(ports)"
    )
    masters: typing.Tuple[RunningMaster, ...] = field(
        "The roscores on the TCP ports among O(ports), with the discovery and sync nodes that are registered there. They are asked by "
        "their own protocols, so no ROS is needed, and it does not matter who has started them. Each question takes at most five "
        "seconds. Texts from other machines are plain text of at most 200 characters.",
        returned="with the part V(masters)",
    )
    exports: typing.Tuple[ExportLine, ...] = field(
        "Assignments of ROS_MASTER_URI, ROS_IP and ROS_HOSTNAME in the files that shells read, other than the collection's.",
        returned="with the part V(exports)",
    )
    silent_shells: typing.Tuple[SilentShell, ...] = field(
        "What gave no answer, so that its variables are unknown.",
        [],
        added="1.1.0",
        returned="with the part V(exports)",
    )
    sshd: SshServer = field("The ssh server.", returned="with the part V(sshd)")
    environment: Shells = field(
        "The variables that really arrive, read by the programs that read the files, for a user without files of his own.",
        returned="with the part V(environment)",
    )
    problems: typing.Tuple[str, ...] = field(
        "One sentence for each part of the machine that could not be looked at; such a part has an empty value.", []
    )
