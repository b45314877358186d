# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""nftables: a table of our own, replaced in one transaction, and loaded at boot by a unit of our own.

It has the guards with every back end: no way in which ufw, firewalld or the tunnel starts, stops or reloads touches this table. Only
who flushes all rules does, as nftables.service. A drop-in lets that one flush and load ours in one transaction.

Of TCP, only packets that begin a connection are dropped. So every connection that is there already stays, also if the
kernel has not followed it from its beginning, or sees one direction of it only.

A packet with an address of the computer itself as its source is dropped if it comes from a wire. The kernel itself checks this
only for IPv4, and not everywhere (accept_local). Packets from the computer to itself come from no wire: those of the loopback
interface, and the copies of its own multicast. For these copies, `fib` names an interface only in the hook prerouting.
"""

import os
import re
import typing

from ...._base.commands import text
from ...._base.plain_text import LINE, quote
from ...._base.problem import Problem
from ...._machine import systemd
from ..packet_filter import FIRST, LAST, PacketFilter
from . import contract

TABLE = "rosfleet_multimaster"
UNIT = "multimaster-firewall.service"
RULES_FILE = "/etc/rosfleet-multimaster/firewall.nft"
UNIT_FILE = "/etc/systemd/system/" + UNIT
FLUSHES = "nftables.service"
DROP_IN = f"/etc/systemd/system/{FLUSHES}.d/rosfleet-multimaster.conf"

# Both lines are needed: the first makes sure that there is a table to delete.
DELETE = f"table inet {TABLE}\ndelete table inet {TABLE}\n"
# A table without a name in use, to learn how nft writes rules on this computer, and whether its kernel takes them.
_SCRATCH = f'nft "$1" && nft -s list table inet {TABLE}'

# Without an ExecStop=, the rules stay while the unit is started again.
_UNIT = """\
# {header}
[Unit]
Description=Packet filter of the fleet (rosfleet.multimaster)
DefaultDependencies=no
Wants=network-pre.target
Before=network-pre.target
After=local-fs.target nftables.service

[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart={nft} -f {file}
ExecReload={nft} -f {file}

[Install]
WantedBy=sysinit.target
"""

# The work that Debian gives nftables.service includes ours. With a wildcard, nft goes on if there is no such file. Rules of
# others never depend on ours: if these are not taken, they are loaded without.
_TOGETHER = """\
ExecStart=
ExecStart=/bin/sh -c '{nft} "$$1" || exec {nft} -f /etc/nftables.conf' sh 'include "/etc/nftables.conf"; include "{pattern}"'
ExecReload=
ExecReload=/bin/sh -c '{nft} "$$1" || exec {nft} -f /etc/nftables.conf' sh 'include "/etc/nftables.conf"; include "{pattern}"'
ExecStop=
ExecStop=/bin/sh -c '{nft} "$$1" || exec {nft} flush ruleset' sh 'flush ruleset; include "{pattern}"'
"""
_DEBIANS = [
    ("ExecReload", "/usr/sbin/nft -f /etc/nftables.conf"),
    ("ExecStart", "/usr/sbin/nft -f /etc/nftables.conf"),
    ("ExecStop", "/usr/sbin/nft flush ruleset"),
]
# Foreign work of this unit goes on as ever, and ours is loaded after that: for these milliseconds it is away.
_DROP_IN = """\
# {header}
[Service]
{together}ExecStartPost=-{nft} -f {file}
ExecReload=-{nft} -f {file}
ExecStopPost=-{nft} -f {file}
"""
_COMMAND = re.compile(r"^[ \t]*(Exec\w+)[ \t]*=[ \t]*(.*?)[ \t]*$", re.M)
_NO_NFT = "There is no nft, expected it for the packet filter{reason}: install it (apt-get install nftables){instead}."


class BackEnd(contract.BackEnd):
    """The kernel's own packet filter, by nft(8)."""

    name = "nftables"

    @staticmethod
    def is_active() -> bool:
        return True

    def read_rules(self) -> contract.Rules:
        answer = contract.run_command(["nft", "-s", "list", "table", "inet", TABLE])
        return answer.text.splitlines() if answer.status == 0 else []

    def plan_rules(self, packet_filter: PacketFilter) -> contract.Rules:
        if not contract.find_program("nft"):
            if packet_filter.members:
                neither = ", since neither ufw nor firewalld is active"
                raise Problem(_NO_NFT.format(reason=neither, instead=", or turn one of the two on"))
            return render_table(packet_filter).splitlines()  # it is to be installed before anything changes
        answer = contract.run_command(["unshare", "--net", "sh", "-c", _SCRATCH, "sh", render_table(packet_filter)])
        if answer.status != 0:
            raise Problem(_explain_failure(" ".join(answer.error.split())[:200]))
        return answer.text.splitlines()

    def plan_files(self, packet_filter: PacketFilter) -> typing.List[contract.File]:
        nft = contract.find_program("nft") or "/usr/sbin/nft"
        words = {"header": contract.HEADER, "nft": nft, "file": RULES_FILE}
        together = _TOGETHER.format(nft=nft, pattern=RULES_FILE[:-1] + "[t]") if self._is_debians() else ""
        rules = f"# {contract.HEADER}\n{DELETE}{render_table(packet_filter)}"
        return [
            {"path": RULES_FILE, "content": rules, "mode": "0644"},
            {"path": UNIT_FILE, "content": _UNIT.format(**words), "mode": "0644"},
            {"path": DROP_IN, "content": _DROP_IN.format(together=together, **words), "mode": "0644"},
        ]

    def _is_debians(self) -> bool:
        """True if nftables.service works as Debian's package has it, but for our drop-in."""
        unit = systemd.states([FLUSHES], ["FragmentPath", "DropInPaths"])[0] if self.booted else {}
        paths = [unit.get("FragmentPath", ""), *unit.get("DropInPaths", "").split()]
        found = [pair for path in paths if path not in ("", DROP_IN) for pair in _COMMAND.findall(text(path))]
        return sorted(found) == _DEBIANS

    def is_ready_for_boot(self) -> bool:
        if not self.booted:
            return True
        if self.packet_filter is None:
            return not os.path.lexists(UNIT_FILE)
        unit = systemd.show([UNIT], ["ActiveState", "UnitFileState", "NeedDaemonReload"]).units
        right = {"ActiveState": "active", "UnitFileState": "enabled", "NeedDaemonReload": "no"}
        return unit == [right] and systemd.show([FLUSHES], ["NeedDaemonReload"]).units == [{"NeedDaemonReload": "no"}]

    def prepare(self) -> None:
        if self.booted and self.packet_filter is None and os.path.lexists(UNIT_FILE):
            contract.run_or_fail(["systemctl", "disable", "--now", UNIT])

    def load(self) -> None:
        self.try_out()
        if self.booted:
            contract.run_or_fail(["systemctl", "daemon-reload"])
            if self.packet_filter is not None:
                # `enable` would leave the link to nftables.service that version 1.0.0 has made.
                contract.run_or_fail(["systemctl", "reenable", UNIT])
                contract.run_or_fail(["systemctl", "start", UNIT])
            else:
                contract.run_command(["systemctl", "reset-failed", UNIT])

    def try_out(self) -> None:
        if self.packet_filter is not None and not contract.find_program("nft"):
            raise Problem(_NO_NFT.format(reason=", with every other one", instead=""))
        contract.run_or_fail(["nft", DELETE + ("" if self.packet_filter is None else render_table(self.packet_filter))])

    def restore(self) -> None:
        if self.booted:
            contract.run_or_fail(["systemctl", "daemon-reload"])
            if os.path.lexists(UNIT_FILE) and self.before:
                contract.run_or_fail(["systemctl", "enable", "--now", UNIT])
            elif not os.path.lexists(UNIT_FILE):
                contract.run_command(["systemctl", "disable", UNIT])
        for command in self.undo_steps():
            contract.run_or_fail(command)

    def undo_steps(self) -> typing.List[contract.Command]:
        return [["nft", DELETE + "\n".join(self.before)]]


def _explain_failure(message: str) -> str:
    """The sentence for a computer on which the rules could not be tried."""
    if message.startswith("unshare"):
        return (
            f"The rules of the packet filter could not be tried in a network namespace of their own ({quote(message, LINE)}), expected root with the "
            "right to make one, as on a computer or in a container with CAP_SYS_ADMIN: give it that right, or set "
            "multimaster_firewall to none."
        )
    return (
        f"This computer does not take the packet filter (nft says: {quote(message, LINE)}), expected a kernel with nftables (nf_tables, nft_ct, "
        "nft_fib_inet): use such a kernel, or set multimaster_firewall to none."
    )


def render_table(packet_filter: PacketFilter) -> str:
    """The table as nft reads it."""
    sets, accepts = "", ""
    for version, kind in ((4, "ip"), (6, "ip6")):
        members = packet_filter.list_members(version)
        if members:
            elements = ", ".join(members)
            sets += f"\tset members{version} {{\n\t\ttype ipv{version}_addr\n\t\tflags interval\n\t\telements = {{ {elements} }}\n\t}}\n"
            accepts += f"\t\t{kind} saddr @members{version} accept\n"
    for protocol in ("tcp", "udp"):
        ports = ", ".join(str(port) for port in packet_filter.list_open_ports(protocol))
        accepts += f"\t\t{protocol} dport {{ {ports} }} accept\n" if ports else ""
    accepts += "\t\tct state established,related accept\n"
    chains = (
        _render_chain("guard", _list_guard_rules(packet_filter), "prerouting", "raw") if packet_filter.guards else ""
    )
    if not packet_filter.members:  # another back end has the rest
        return f"table inet {TABLE} {{\n{chains}}}\n"
    chains += _render_chain("prerouting", _antispoof_rules())
    chains += _render_chain(
        "input", '\t\tiifname "lo" accept\n\t\tfib saddr type local accept\n' + accepts + _drop_rules("")
    )
    if packet_filter.networks:
        chains += _render_chain(
            "forward", accepts + _drop_rules(f"ip daddr {{ {', '.join(packet_filter.networks)} }} ")
        )
    return f"table inet {TABLE} {{\n{sets}{chains}}}\n"


def _render_chain(name: str, rules: str, hook: str = "", priority: str = "0") -> str:
    return f"\tchain {name} {{\n\t\ttype filter hook {hook or name} priority {priority}; policy accept;\n{rules}\t}}\n"


def _list_guard_rules(packet_filter: PacketFilter) -> str:
    """The rules that drop packets from a network that come in at another interface than its own, for this computer or passed on.

    They have names, no routes: a route goes with its interface, and then the default route would lead to the network.
    """
    rules = "\t\tip6 saddr ::ffff:0:0/96 drop\n"  # no wire has addresses of IPv4 within IPv6, and a socket of both takes them for those
    for networks, interface in packet_filter.guards:
        for kind, colon in (("ip", False), ("ip6", True)):
            own = ", ".join(network for network in networks if (":" in network) == colon)
            rules += f'\t\tiifname != {{ "lo", "{interface}" }} {kind} saddr {{ {own} }} drop\n' if own else ""
    return rules


def _antispoof_rules() -> str:
    """The rules against packets from outside with an address of this computer as source, to it or through it."""
    own = "fib saddr type local fib saddr . iif oif missing"
    return "".join(f"\t\t{own} {protocol} dport {FIRST}-{LAST} drop\n" for protocol in ("tcp", "udp"))


def _drop_rules(destination: str) -> str:
    return (
        f"\t\t{destination}tcp dport {FIRST}-{LAST} tcp flags & (syn | ack) == syn drop\n"
        f"\t\t{destination}udp dport {FIRST}-{LAST} drop\n"
    )
