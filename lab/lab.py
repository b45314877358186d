# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The lab: real systems in containers or virtual machines, with the addresses of an inventory.

python lab/lab.py up --name demo --inventory inventory/single_computer
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path

from machines import containers, image, kinds
from machines.layout import Extra, choose_suites, hosts_of, read_inventory
from progress import carry_out

EXTRA, MOUNT = "HOST=ADDRESS[/PREFIX][,...]", "HOST=SOURCE:TARGET"


def _extra(text: str) -> tuple[str, list[str]]:
    name, separator, addresses = text.partition("=")
    if not (name and separator and addresses):
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form {EXTRA}")
    return name, addresses.split(",")


def _mount(text: str) -> tuple[str, str]:
    name, _equals, mount = text.partition("=")
    source, _colon, target = mount.partition(":")
    if not (name and source.startswith("/") and target.startswith("/")):
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form {MOUNT} with absolute paths")
    return name, mount


def _name(text: str) -> str:
    """A name of a lab. One with a dot is a rehearsal's (rehearsal.py), which may be shown or removed here."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*|rehearse\.[a-z0-9_]+", text):
        raise argparse.ArgumentTypeError(f"'{text}' is not a name of letters, digits, hyphens and underscores")
    return text


def _extras(options: argparse.Namespace) -> dict[str, Extra]:
    """Return the wishes beyond the inventory, by host."""
    names = dict.fromkeys(name for name, _given in [*options.extra, *options.mount])
    return {
        name: Extra(
            tuple(address for host, addresses in options.extra if host == name for address in addresses),
            tuple(mount for host, mount in options.mount if host == name),
        )
        for name in names
    }


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="lab.py", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)

    def command(name: str, text: str, *, inventory: bool = False, lab: bool = True) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        if lab:
            sub.add_argument(
                "--name", metavar="LAB", type=_name, default="demo", help="name of the lab (default: demo)"
            )
        if inventory:
            sub.add_argument("--inventory", metavar="DIR", type=Path, required=True, help="the shipped inventory")
            sub.add_argument(
                "--extra",
                metavar=EXTRA,
                type=_extra,
                action="append",
                default=[],
                help="one more host, or more addresses for one; with a prefix length an address makes its own network",
            )
            sub.add_argument(
                "--mount", metavar=MOUNT, type=_mount, action="append", default=[], help="a read-only mount of a host"
            )
        return sub

    images = command("image", "build images if they are missing", lab=False)
    images.add_argument("suite", nargs="*", default=[image.SUITE], help=f"Debian's releases (default: {image.SUITE})")
    images.add_argument("--full", action="store_true", help="with all packages, as for the tests")
    up = command("up", "start the computers of an inventory and write their connection variables", inventory=True)
    up.add_argument(
        "--suite",
        metavar="[HOST=]SUITE",
        action="append",
        default=[],
        help=f"Debian's release of all computers, or of one (default: {image.SUITE})",
    )
    up.add_argument(
        "--kind", choices=list(kinds.KINDS), default="container", help="what a computer is (default: container)"
    )
    command("inventory", "write the connection variables of an inventory's computers", inventory=True).add_argument(
        "--print", action="store_true", help="print them instead, as an inventory script does"
    )
    command("down", "remove a lab").add_argument("--all", action="store_true", help="remove every lab, and the images")
    command("restart", "reboot the computers").add_argument("host", nargs="?", help="only this one")
    command("cut", "cut the power of the computers for a moment, and wait for their boot").add_argument(
        "host", nargs="?", help="only of this one"
    )
    command("shell", "open a shell on a computer").add_argument("host")
    return parser


def run(options: argparse.Namespace) -> None:
    """Do one command."""
    if options.command == "image":
        for suite in options.suite:
            print(image.ensure(suite, full=options.full))
    elif options.command in ("up", "inventory"):
        hosts = hosts_of(read_inventory(options.inventory), _extras(options))
        if options.command == "up":
            kinds.bring_up(options.kind, options.name, choose_suites(hosts, options.suite))
        if options.command == "inventory" and options.print:
            print(json.dumps(containers.script_inventory(options.name, hosts), indent=2))
        else:
            print(kinds.kind_of(options.name).write_inventory(options.name, hosts))
    elif options.command == "down":
        for kind in kinds.KINDS.values():
            kind.take_down(None if options.all else options.name)
        if options.all:
            image.remove()
    elif options.command == "restart":
        kinds.kind_of(options.name).restart(options.name, options.host)
    elif options.command == "cut":
        kinds.kind_of(options.name).cut_power(options.name, options.host)
    elif options.command == "shell":
        kinds.kind_of(options.name).shell(options.name, options.host)


if __name__ == "__main__":
    sys.exit(carry_out(run, _parser().parse_args()))
