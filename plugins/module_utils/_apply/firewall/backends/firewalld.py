# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""firewalld: two policies of our own, which apply before every zone (firewalld.policy(5)). Zones stay as they are.

firewalld takes a new policy only from its files, by a reload. A reload forgets changes that are only in the run time, so the module
refuses if there is such a change. A reload also empties the tables of iptables (firewalld 1.3 with its back end for nftables),
and with them the chains of container engines and of persons: they are taken over.
"""

import os
import re
import typing

from ...._base.plain_text import LINE, quote
from ...._base.problem import Problem
from ...transaction.deadman import FileBefore, UndoStep
from ..packet_filter import FIRST, LAST, PacketFilter
from . import contract

FOLDER = "/etc/firewalld/policies"
INPUT, FORWARD = "rosfleet-input", "rosfleet-forward"  # firewalld takes 17 letters at most
_COMPARED = (
    ("--list-all-zones",),
    ("--list-all-policies",),
    *(("--direct", f"--get-all-{what}") for what in ("chains", "rules", "passthroughs")),
)
_EGRESS = {INPUT: "HOST", FORWARD: "ANY"}
_PRIORITY = -14000  # after firewalld's own policy for IPv6, before every zone
_ACCEPT, _DROP = -2, -1  # priorities of our rules: those that accept come first
_RANGE = f"{FIRST}-{LAST}"
# With its back end for iptables, its own rules are among those, so nothing can be taken over.
_RELOAD_SCRIPT = """
kept=$(mktemp -d) || exit 1
grep -qi '^[[:space:]]*FirewallBackend=iptables' /etc/firewalld/firewalld.conf ||
    for tool in iptables ip6tables; do "$tool-save" -c >"$kept/$tool" 2>/dev/null; done
firewall-cmd --reload
status=$?
for tool in iptables ip6tables; do [ ! -s "$kept/$tool" ] || "$tool-restore" -w -c <"$kept/$tool" || status=1; done
rm -rf "$kept"
exit $status
"""
_RELOAD = ["sh", "-c", _RELOAD_SCRIPT, "firewall-cmd"]
# An interface may be bound to a zone at run time, for example by NetworkManager; a reload keeps that.
_BOUND = re.compile(r"(?m)^  interfaces:.*$|[ ]\((?:default, )?active\)$|[ ]\(default\)$")


class RichRule(typing.NamedTuple):
    """A rich rule (firewalld.richlanguage(5))."""

    action: str  # accept or drop
    source: str = ""
    destination: str = ""
    protocol: str = ""  # with ports: tcp or udp
    ports: str = ""

    @property
    def elements(self) -> typing.List[typing.Tuple[str, typing.Dict[str, str]]]:
        """The rule itself and its elements with their attributes, in the order of firewall-cmd."""
        attributes = {"priority": str(_ACCEPT if self.action == "accept" else _DROP)}
        addresses = self.source + self.destination
        if addresses:
            attributes["family"] = "ipv6" if ":" in addresses else "ipv4"
        elements = [("rule", attributes)]
        if self.source:
            elements.append(("source", {"address": self.source}))
        if self.destination:
            elements.append(("destination", {"address": self.destination}))
        if self.ports:
            elements.append(("port", {"port": self.ports, "protocol": self.protocol}))
        elif self.protocol:
            elements.append(("protocol", {"value": self.protocol}))
        return [*elements, (self.action, {})]

    @property
    def text(self) -> str:
        """The rule as firewall-cmd lists it."""
        return " ".join(name + _format_attributes(attributes) for name, attributes in self.elements)

    @property
    def xml(self) -> str:
        """The rule as a file of firewalld has it."""
        tags = [f"{name}{_format_attributes(attributes)}" for name, attributes in self.elements]
        opening, inner = f"<{tags[0]}>", "".join(f"<{tag}/>" for tag in tags[1:])
        return f"  {opening}{inner}</rule>\n"


def _format_attributes(values: typing.Mapping[str, str]) -> str:
    return "".join(f' {name}="{value}"' for name, value in values.items())


class BackEnd(contract.BackEnd):
    """firewalld, if it runs."""

    name = "firewalld"

    @staticmethod
    def is_active() -> bool:
        return contract.run_command(["firewall-cmd", "--state"]).status == 0

    def read_rules(self) -> contract.Rules:
        if not self.is_active():
            return []
        rules = []
        for policy in _EGRESS:
            answer = contract.run_command(["firewall-cmd", f"--policy={policy}", "--list-rich-rules"])
            if answer.status == 0:
                rules += [f"{policy}: {line}" for line in answer.text.splitlines() if line]
        return sorted(rules)

    def plan_rules(self, packet_filter: PacketFilter) -> contract.Rules:
        return sorted(
            f"{policy}: {rule.text}" for policy, rules in plan_policies(packet_filter).items() for rule in rules
        )

    def plan_files(self, packet_filter: PacketFilter) -> typing.List[contract.File]:
        return [
            {"path": f"{FOLDER}/{policy}.xml", "content": _render_policy(policy, rules), "mode": "0644"}
            for policy, rules in plan_policies(packet_filter).items()
        ]

    def refusal(self) -> str:
        if not self.is_active():
            return ""
        if not os.path.isdir(FOLDER):
            return (
                f"firewalld has no {FOLDER}, expected firewalld 0.9 or later, which has policies: stop it for good (systemctl "
                "disable --now firewalld), or set multimaster_firewall to none."
            )
        for option in _COMPARED:
            runtime, permanent = (
                _strip_own_policies(contract.run_or_fail(["firewall-cmd", *place, *option]))
                for place in ((), ("--permanent",))
            )
            if runtime != permanent:
                line = next(iter(sorted(set(runtime.splitlines()) ^ set(permanent.splitlines()))), "").strip()
                return (
                    f"firewalld differs at run time from its files ({quote(line)}), which a reload would undo; expected the same: keep "
                    "the change (firewall-cmd --runtime-to-permanent) or drop it (firewall-cmd --reload)."
                )
        return ""

    def load(self) -> None:
        if self.is_active() and self.read_rules() != self.after:
            _reload()

    def try_out(self) -> None:
        """Reload with the files of the plan. Then restore the former files, for the next boot."""
        before = _read_policies()
        files = self.plan_files(self.packet_filter) if self.packet_filter else []
        planned = {file["path"]: file["content"].encode("utf-8") for file in files}
        with contract.keep_files(before):
            contract.write_files(file._replace(content=planned.get(file.path)) for file in before)
            _reload()

    def restore(self) -> None:
        if self.is_active() and self.read_rules() != self.before:
            _reload()

    def undo_steps(self) -> typing.List[UndoStep]:
        return [*_read_policies(), _RELOAD]


def _reload() -> None:
    """Let firewalld read its files. Raises Problem."""
    answer = contract.run_command(_RELOAD)
    if answer.status != 0:
        message = quote(answer.error, LINE) or f"status {answer.status}"
        raise Problem(
            f"'firewall-cmd --reload' failed ({message}), expected it to read the policies: read its message."
        )


def plan_policies(packet_filter: PacketFilter) -> typing.Dict[str, typing.List[RichRule]]:
    """The wanted policies, with their rules."""
    protocols = ("tcp", "udp")
    members = [RichRule("accept", member, "", name, _RANGE) for member in packet_filter.members for name in protocols]
    # A switch sends its IGMP queries from any address; zones may refuse them.
    igmp = [RichRule("accept", protocol="igmp")]
    policies = {INPUT: members + igmp + _list_port_rules(packet_filter, "")}
    if packet_filter.networks:
        policies[FORWARD] = [
            RichRule("accept", *ends)
            for network in packet_filter.networks
            for member in packet_filter.list_members(4)
            for ends in ((member, network), (network, member))
            if member != network
        ] + [rule for network in packet_filter.networks for rule in _list_port_rules(packet_filter, network)]
    return policies


def _list_port_rules(packet_filter: PacketFilter, destination: str) -> typing.List[RichRule]:
    """The rules for all senders: ports that stay open, and ports that are closed. Zones decide about those of ssh."""
    opens = [RichRule("accept", "", destination, port.protocol, str(port.number)) for port in packet_filter.open_ports]
    return opens + [
        RichRule("drop", "", destination, protocol, _format_range(*ports))
        for protocol in ("tcp", "udp")
        for ports in packet_filter.list_closed_ranges(protocol)
    ]


def _format_range(first: int, last: int) -> str:
    return str(first) if first == last else f"{first}-{last}"


def _render_policy(policy: str, rules: typing.Iterable[RichRule]) -> str:
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f"<!-- {contract.HEADER} -->\n"
        f'<policy target="CONTINUE" priority="{_PRIORITY}">\n'
        "  <short>Fleet</short>\n"
        '  <ingress-zone name="ANY"/>\n'
        f'  <egress-zone name="{_EGRESS[policy]}"/>\n'
        f"{''.join(rule.xml for rule in rules)}</policy>\n"
    )


def _strip_own_policies(listing: str) -> str:
    """A listing of zones or policies, without our own policies, and without the bindings that survive a reload."""
    blocks = [block.strip("\n") for block in _BOUND.sub("", listing).split("\n\n")]
    return "\n\n".join(sorted(block for block in blocks if block and block.split("\n")[0].strip() not in _EGRESS))


def _read_policies() -> typing.List[FileBefore]:
    return contract.read_files(f"{FOLDER}/{policy}.xml" for policy in _EGRESS)
