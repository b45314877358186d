# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""nftables: a table of our own, replaced in one transaction, and loaded at boot by a unit of our own.

Of TCP, only packets that begin a connection are dropped. So no connection that is there already is touched, also where the
kernel has not followed it from its beginning, or sees one direction of it only.

A packet with an address of the computer itself as its source is dropped where it comes from a wire: the kernel checks that of IPv4
alone, and not everywhere (accept_local). What the computer sends to itself has no wire: the loopback interface, and the copies
of its own multicast, for which the kernel's `fib` names an interface in the hook prerouting alone.
"""

import os
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.backends import contract
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.wanted import FIRST, LAST, Wanted
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import systemd
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import LINE, quote
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.problem import Problem

TABLE = "rosfleet_multimaster"
UNIT = "multimaster-firewall.service"
RULES_FILE = "/etc/rosfleet-multimaster/firewall.nft"
UNIT_FILE = "/etc/systemd/system/" + UNIT

# Both lines are needed: the first makes sure that there is a table to delete.
_GONE = f"table inet {TABLE}\ndelete table inet {TABLE}\n"
# A table without a name in use, to learn how nft writes rules on this computer, and whether its kernel takes them.
_SCRATCH = f'nft "$1" && nft -s list table inet {TABLE}'

# nftables.service flushes everything when it starts, reloads or stops, so this unit follows it: PartOf= for a stop, and the
# second WantedBy= for the start after that.
_UNIT = """\
# {header}
[Unit]
Description=Packet filter of the fleet (rosfleet.multimaster)
DefaultDependencies=no
Wants=network-pre.target
Before=network-pre.target
After=local-fs.target nftables.service
PartOf=nftables.service
ReloadPropagatedFrom=nftables.service

[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart={nft} -f {file}
ExecReload={nft} -f {file}
ExecStop={nft} delete table inet {table}

[Install]
WantedBy=sysinit.target nftables.service
"""


class BackEnd(contract.BackEnd):
    """The kernel's own packet filter, by nft(8)."""

    name = "nftables"

    def active(self) -> bool:
        return True

    def read(self) -> contract.Rules:
        if not contract.program("nft"):
            return []
        answer = contract.ask(["nft", "-s", "list", "table", "inet", TABLE])
        return answer.output.decode("utf-8", "replace").splitlines() if answer.status == 0 else []

    def rules(self, wanted: Wanted) -> contract.Rules:
        if not contract.program("nft"):
            raise Problem(
                "There is no nft, expected it for the packet filter, since neither ufw nor firewalld is active: install it "
                "(apt-get install nftables), or turn one of the two on."
            )
        answer = contract.ask(["unshare", "--net", "sh", "-c", _SCRATCH, "sh", text(wanted)])
        if answer.status != 0:
            raise Problem(_why_not(" ".join(answer.error.split())[:200]))
        return answer.output.decode("utf-8", "replace").splitlines()

    def files(self, wanted: Wanted) -> typing.List[contract.File]:
        nft = contract.program("nft") or "/usr/sbin/nft"
        unit = _UNIT.format(header=contract.HEADER, nft=nft, file=RULES_FILE, table=TABLE)
        rules = f"# {contract.HEADER}\n{_GONE}{text(wanted)}"
        return [
            {"path": RULES_FILE, "content": rules, "mode": "0644"},
            {"path": UNIT_FILE, "content": unit, "mode": "0644"},
        ]

    def in_order(self, wanted: typing.Optional[Wanted]) -> bool:
        if not self.booted:
            return True
        if wanted is None:
            return not os.path.lexists(UNIT_FILE)
        unit = systemd.show([UNIT], ["ActiveState", "UnitFileState", "NeedDaemonReload"]).units
        right = {"ActiveState": "active", "UnitFileState": "enabled", "NeedDaemonReload": "no"}
        return unit == [right]

    def prepare(self, wanted: typing.Optional[Wanted]) -> None:
        if self.booted and wanted is None and os.path.lexists(UNIT_FILE):
            contract.do(["systemctl", "disable", "--now", UNIT])

    def load(self, wanted: typing.Optional[Wanted]) -> None:
        self.try_out(wanted)
        if self.booted:
            contract.do(["systemctl", "daemon-reload"])
            if wanted is not None:
                contract.do(["systemctl", "enable", "--now", UNIT])
            else:
                contract.ask(["systemctl", "reset-failed", UNIT])

    def try_out(self, wanted: typing.Optional[Wanted]) -> None:
        contract.do(["nft", _GONE + ("" if wanted is None else text(wanted))])

    def restore(self, before: contract.Rules) -> None:
        if self.booted:
            contract.do(["systemctl", "daemon-reload"])
            if os.path.lexists(UNIT_FILE) and before:
                contract.do(["systemctl", "enable", "--now", UNIT])
            elif not os.path.lexists(UNIT_FILE):
                contract.ask(["systemctl", "disable", UNIT])
        for command in self.undo_commands(before):
            contract.do(command)

    def undo_commands(self, before: contract.Rules) -> typing.List[contract.Command]:
        return [["nft", _GONE + "\n".join(before)]]


def _why_not(said: str) -> str:
    """The sentence for a computer on which the rules could not be tried."""
    if said.startswith("unshare"):
        return (
            f"The rules of the packet filter could not be tried in a network namespace of their own ({quote(said, LINE)}), expected root with the "
            "right to make one, as on a computer or in a container with CAP_SYS_ADMIN: give it that right, or set "
            "multimaster_firewall to none."
        )
    return (
        f"This computer does not take the packet filter (nft says: {quote(said, LINE)}), expected a kernel with nftables (nf_tables, nft_ct, "
        "nft_fib_inet): use such a kernel, or set multimaster_firewall to none."
    )


def text(wanted: Wanted) -> str:
    """The table, without what was there before."""
    sets, known = "", ""
    for version, kind in ((4, "ip"), (6, "ip6")):
        members = wanted.of_version(version)
        if members:
            elements = ", ".join(members)
            sets += f"\tset members{version} {{\n\t\ttype ipv{version}_addr\n\t\tflags interval\n\t\telements = {{ {elements} }}\n\t}}\n"
            known += f"\t\t{kind} saddr @members{version} accept\n"
    for protocol in ("tcp", "udp"):
        ports = ", ".join(str(port) for port in wanted.open(protocol))
        known += f"\t\t{protocol} dport {{ {ports} }} accept\n" if ports else ""
    known += "\t\tct state established,related accept\n"
    chains = _chain("prerouting", _forged())
    chains += _chain("input", '\t\tiifname "lo" accept\n\t\tfib saddr type local accept\n' + known + _drops(""))
    if wanted.networks:
        chains += _chain("forward", known + _drops(f"ip daddr {{ {', '.join(wanted.networks)} }} "))
    return f"table inet {TABLE} {{\n{sets}{chains}}}\n"


def _chain(hook: str, rules: str) -> str:
    return f"\tchain {hook} {{\n\t\ttype filter hook {hook} priority 0; policy accept;\n{rules}\t}}\n"


def _forged() -> str:
    """The rules against packets that come from outside with an address of this computer, to itself or to be passed on."""
    own = "fib saddr type local fib saddr . iif oif missing"
    return "".join(f"\t\t{own} {protocol} dport {FIRST}-{LAST} drop\n" for protocol in ("tcp", "udp"))


def _drops(destination: str) -> str:
    return (
        f"\t\t{destination}tcp dport {FIRST}-{LAST} tcp flags & (syn | ack) == syn drop\n"
        f"\t\t{destination}udp dport {FIRST}-{LAST} drop\n"
    )
