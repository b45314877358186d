# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The lab with virtual machines instead of containers: a kernel and an udev of their own.

python lab/vm.py up --name net --machine ana=192.168.1.11/24 --manager networkd --suite trixie
python lab/vm.py run --name net ana 'ip route'
"""

from __future__ import annotations

import argparse
import ipaddress
import sys
from dataclasses import replace
from pathlib import Path

from machines import disk, image, managers, virtual
from machines.layout import Host, choose_suites, hosts_of, read_inventory
from machines.managers import Interface
from progress import carry_out

MACHINE = "NAME=ADDRESS/PREFIX[,...]"


def _machine(text: str) -> tuple[str, list[str]]:
    name, _equals, addresses = text.partition("=")
    try:
        ports = [ipaddress.ip_interface(address).with_prefixlen for address in addresses.split(",")]
    except ValueError as problem:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form {MACHINE} ({problem})") from problem
    return name, ports


def make_host(name: str, addresses: list[str], manager: str, suite: str) -> Host:
    """A machine with an interface for each address. Its default route leads to the first address of the first network."""
    ports = [ipaddress.ip_interface(address) for address in addresses]
    interfaces = tuple(
        Interface(f"eth{number}", str(port.network), port.with_prefixlen, None if number else str(port.network[1]))
        for number, port in enumerate(ports)
    )
    return Host(name, interfaces, manager, suite=suite)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="vm.py", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)

    def command(name: str, text: str, *words: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.add_argument("--name", metavar="LAB", default="vm", help="name of the lab (default: vm)")
        for word in words:
            sub.add_argument(word)
        return sub

    build = command("image", "build disks if they are missing")
    build.add_argument("suite", nargs="*", default=[image.SUITE])
    up = command("up", "start machines; prints the file of their connection variables")
    for sub in (build, up):
        sub.add_argument("--disk", choices=sorted(disk.KINDS), default="disk", help="kind of the disks")
    up.add_argument("--inventory", metavar="DIR", type=Path, help="the computers of an inventory")
    up.add_argument("--machine", metavar=MACHINE, type=_machine, action="append", default=[], help="one machine")
    up.add_argument("--manager", choices=sorted(managers.MANAGERS), default="networkd", help="of all --machine")
    up.add_argument("--suite", metavar="[HOST=]SUITE", action="append", default=[], help="Debian's release")
    command("down", "remove a lab").add_argument("--all", action="store_true", help="all labs of machines")
    command("run", "run a command as root over a console, which needs no network", "host", "line")
    command("shell", "open a shell by ssh", "host")
    command("reboot", "reboot a machine and wait for it", "host")
    command("cut", "cut the power of a machine for a moment, and wait for its boot", "host")
    command("carrier", "plug a cable in or pull it", "host", "interface").add_argument("state", choices=["on", "off"])
    return parser


def run(options: argparse.Namespace) -> None:
    """Do one command."""
    name = options.name
    if options.command == "image":
        for suite in options.suite:
            print(disk.ensure(suite, options.disk))
    elif options.command == "up":
        hosts = hosts_of(read_inventory(options.inventory)) if options.inventory else []
        hosts += [make_host(host, addresses, options.manager, image.SUITE) for host, addresses in options.machine]
        hosts = [replace(host, disk=options.disk) for host in choose_suites(hosts, options.suite)]
        virtual.bring_up(name, hosts)
        print(virtual.write_inventory(name, hosts))
    elif options.command == "down":
        virtual.take_down_all(None if options.all else name)
    elif options.command == "run":
        print(virtual.run(name, options.host, options.line, timeout=600), end="")
    elif options.command == "shell":
        virtual.shell(name, options.host)
    elif options.command == "reboot":
        virtual.reboot(name, options.host)
    elif options.command == "cut":
        virtual.cut_and_give_power(name, options.host)
    elif options.command == "carrier":
        virtual.set_carrier(name, options.host, options.interface, options.state == "on")


if __name__ == "__main__":
    sys.exit(carry_out(run, _parser().parse_args()))
