# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of a computer: power, limits, settings, the state after the next boot. Ids RF-1xx."""

from __future__ import annotations

from collections.abc import Mapping

from .fault import ALWAYS, READ, Fault, Key, change, controller, hand, keep_settings, on, reinstall, site, verify_again

OPEN_FILES = "may open millions of files, for which each node of C++ takes gigabytes, and those of Python 2 minutes"
ROUTES = on("ip rule; ip route")
ADDRESSES = on("ip -br address; ip -s link")
#: Prints the processes with most open files.
MOST_FILES = "for p in /proc/[0-9]*; do echo $(ls $p/fd 2>/dev/null | wc -l) $(cat $p/comm) ${{p#/proc/}}; done | sort -rn | head -5"

COMPUTER: Mapping[Key, Fault] = {
    ("computer", "off"): Fault(
        "RF-101",
        "{place} is switched off, or not on its network",
        do=(hand("switch {place} on, and plug its network cable in"),),
        look=(controller("ansible {place} -i {inventory} -m ansible.builtin.ping"), ADDRESSES),
        cost=1.0,
        why="robots are switched off every day",
    ),
    ("computer", "login"): Fault(
        "RF-102",
        "{place} is there, but the controller cannot log in",
        do=(
            controller(
                "ssh-copy-id {address}",
                "USER@ before the address if your name differs there; or correct ansible_host and ansible_user of {place} in the inventory",
            ),
        ),
        look=(controller("ansible {place} -i {inventory} -m ansible.builtin.ping -vvv"),),
        cost=2.0,
        why="keys and addresses change seldom",
    ),
    ("computer", "sealed"): Fault(
        "RF-103",
        "{place} is sealed: nobody logs in there, so its settings, clock, routes back, packet filter and own view were not looked at",
        do=(hand("nothing, if its nodes are well; ask the maker of {place} for the values that only a login shows"),),
        look=(hand("docs/operate/sealed.md describes how the others see it"),),
        read=ALWAYS,
        why="the plan says so",
    ),
    ("computer", "unmeasured"): Fault(
        "RF-104",
        "{place} could not be looked at: {what}",
        do=(
            controller(
                "ansible-playbook -i {inventory} rosfleet.multimaster.verify{limit} -vv", "shows the error of the task"
            ),
        ),
        look=(controller("ansible {place} -i {inventory} -b -m ansible.builtin.command -a 'python3 --version'"),),
        read=READ,
        what="a measurement gave no result",
        why="the answer of the module says so",
    ),
    ("computer", "overloaded"): Fault(
        "RF-105",
        "{place} is overloaded",
        do=(
            hand("end the program on {place} that the look lists first, or move it to another computer"),
            verify_again("waits longer for it", "-e verify_patience=60"),
        ),
        look=(on("top -b -n1 | head -20"),),
        cost=5.0,
        hard=False,
        why="answers that come late have nearer reasons",
    ),
    ("computer", "ports"): Fault(
        "RF-106",
        "{place} has no free local port for a new connection",
        do=(
            on("sysctl -w net.ipv4.ip_local_port_range='32768 60999'", "the kernel's own range"),
            hand("end the program on {place} that holds thousands of connections: the last column of the look has it"),
        ),
        look=(
            on("ss -tnp state established | awk '{{print $NF}}' | sort | uniq -c | sort -rn | head -5"),
            on("sysctl net.ipv4.ip_local_port_range net.ipv4.ip_local_reserved_ports"),
        ),
        read=ALWAYS,
        why="the kernel says EADDRNOTAVAIL",
    ),
    ("computer", "limit"): Fault(
        "RF-107",
        "{place} cannot open a connection: {what}",
        do=(
            hand(
                "on {place}, end the program that holds most files or sockets (the look names it), or raise its LimitNOFILE and start it again"
            ),
        ),
        look=(
            on(MOST_FILES),
            on("sysctl fs.file-nr net.ipv4.tcp_mem; ss -s; free -m"),
        ),
        what="it has reached a limit",
        read=ALWAYS,
        why="the kernel says EMFILE, ENFILE or ENOMEM",
    ),
    ("computer", "disk"): Fault(
        "RF-108",
        "{place} has no room on {what}",
        do=(
            on("journalctl --vacuum-size=100M", "removes old lines of the journal, if it is larger"),
            hand("delete files that nobody needs: the look lists the largest folders"),
        ),
        look=(on("df -h; df -i; du -xh / 2>/dev/null | sort -rh | head -20"),),
        what="a disk",
        why="a value of the file system shows it",
    ),
    ("limit", "unit"): Fault(
        "RF-109",
        "{what} on {place} " + OPEN_FILES,
        do=(
            on("systemctl edit {what}", "write: [Service] and LimitNOFILE=1024:524288"),
            on("systemctl restart {what}"),
        ),
        look=(on("systemctl show --property LimitNOFILESoft {what}"),),
        what="a unit",
        read=ALWAYS,
        why="the limits of the process show it",
    ),
    ("limit", "shell"): Fault(
        "RF-110",
        "nodes on {place} " + OPEN_FILES + ": {what}",
        do=(
            on("ulimit -Sn 1024", "in the shell that starts them; then start them again"),
            hand("a container: docker run --ulimit nofile=1024:524288 ..."),
        ),
        look=(on("grep 'open files' /proc/[0-9]*/limits"),),
        what="see ulimit -n",
        read=ALWAYS,
        why="the limits of the process show it",
    ),
    ("container", "names"): Fault(
        "RF-111",
        "a container on {place} was started before the names of the fleet came, and does not know them: {what}",
        do=(on("docker compose restart", "in the folder of its compose file; without one: docker restart NAME"),),
        look=(on("grep -c rosfleet /etc/hosts /proc/[0-9]*/root/etc/hosts"), hand("docs/start/containers.md")),
        what="see its /etc/hosts",
        read=ALWAYS,
        why="its /etc/hosts shows it",
    ),
    ("ros", "broken"): Fault(
        "RF-112",
        "nodes of the ROS on {place} cannot start any more; those that run were started before",
        do=(reinstall("*-rospy", "or the package that the look misses"),),
        look=(on("python3 -c 'import rospy'"),),
        cost=2.0,
        read=ALWAYS,
        why="a user without rights has tried to import rospy",
    ),
    ("set_up", "never"): Fault(
        "RF-113",
        "site.yml has not run on {place}, or teardown.yml has run since",
        do=(site("sets it up"),),
        look=(on("ls /var/lib/rosfleet-multimaster"),),
        read=ALWAYS,
        cost=1.0,
        why="the collection has no record there",
    ),
    ("set_up", "by_hand"): Fault(
        "RF-114",
        "{place} was set up by hand, or by something else",
        do=(site("takes it over; do nothing if it is intended, since the other checks say if the fleet talks"),),
        look=(on("rosnode list; ls /var/lib/rosfleet-multimaster"),),
        why="nodes run that no unit of ours has started",
    ),
    ("set_up", "others"): Fault(
        "RF-115",
        "on {place} nodes of the plan were started by hand, or by something else: {what}; they are judged as they are",
        do=(hand("do nothing if it is meant; else stop them on {place}"), site("starts its own")),
        look=(on("ps -eo pid,user,args | grep -E 'roscore|rosmaster|master_(discovery|sync)'"),),
        what="see ps",
        why="nodes run that no unit of ours has started",
    ),
    ("set_up", "refused"): Fault(
        "RF-116",
        "site.yml would refuse {place}, before it changes anything",
        do=(hand("change what each sentence of the result asks for"), site("sets it up then")),
        look=(controller("ansible-playbook -i {inventory} rosfleet.multimaster.site --check{limit}"),),
        why="preflight says so",
    ),
    ("setting", "icmp_group"): Fault(
        "RF-117",
        "{place} does not answer pings of a group; discovery does not depend on it",
        do=(
            site("sets net.ipv4.icmp_echo_ignore_broadcasts to 0, unless multimaster_answer_broadcast_pings is false"),
        ),
        look=(on("sysctl net.ipv4.icmp_echo_ignore_broadcasts"),),
        cost=2.0,
        why="it is the default of Linux",
    ),
    ("setting", "icmp_all"): Fault(
        "RF-118",
        "{place} answers no pings, by a setting of its kernel",
        do=(keep_settings("pings", {"net.ipv4.icmp_echo_ignore_all": 0}),),
        look=(on("grep -rn icmp_echo_ignore_all /etc/sysctl.conf /etc/sysctl.d /run/sysctl.d /usr/lib/sysctl.d"),),
        read=ALWAYS,
        why="the value was read",
    ),
    ("setting", "ttl"): Fault(
        "RF-119",
        "packets of {place} begin with a time to live that is too small for the way",
        do=(keep_settings("ttl", {"net.ipv4.ip_default_ttl": 64}),),
        look=(
            on(
                "sysctl net.ipv4.ip_default_ttl; grep -rn ip_default_ttl /etc/sysctl.conf /etc/sysctl.d; nft list ruleset | grep -i ttl"
            ),
        ),
        cost=3.0,
        hard=False,
        why="nobody lowers it without need",
    ),
    ("setting", "unread"): Fault(
        "RF-120",
        "on {place} {what} cannot be looked at, as in some containers",
        do=(
            hand("nothing, if {place} is a container"),
            change("else take ansible_become: false of {place} out", "verify reads it as root"),
        ),
        look=(on("sysctl {what}"),),
        what="a value",
        why="reading it fails",
    ),
    ("boot", "unit"): Fault(
        "RF-121",
        "{what} works on {place} now, and does not start at the next boot",
        do=(on("systemctl unmask {what}; systemctl enable {what}"),),
        look=(on("systemctl is-enabled {what}; systemctl cat {what}"),),
        what="multimaster-*",
        why="systemd says so",
    ),
    ("boot", "sysctl"): Fault(
        "RF-122",
        "{what} is right on {place} now, and not after the next boot",
        do=(site("writes its own file, and names the one that decides"),),
        look=(on("grep -rn {what} /etc/sysctl.conf /etc/sysctl.d /run/sysctl.d /usr/lib/sysctl.d"),),
        what="a kernel setting",
        why="the files that set it were read",
    ),
    ("boot", "route"): Fault(
        "RF-123",
        "{place} has its routes now, and not after the next boot",
        do=(site("writes the file of its routes"),),
        look=(ROUTES,),
        why="the file that makes them was read",
    ),
    ("boot", "names"): Fault(
        "RF-124",
        "/etc/hosts of {place} is right now, and is written anew at the next boot",
        do=(site("keeps cloud-init from writing it"),),
        look=(on("grep -rn manage_etc_hosts /etc/cloud"),),
        why="the configuration of cloud-init was read",
    ),
    ("program", "full"): Fault(
        "RF-125",
        "a program on {place} can open no further file or connection: {what}",
        do=(
            hand(
                "on {place}, start that program again, or first raise its limit: LimitNOFILE= in its unit, ulimit -n in its shell"
            ),
        ),
        look=(on(MOST_FILES),),
        what="it has all of its files open",
        read=ALWAYS,
        why="its open files and its limit show it",
    ),
}
