# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""firewalld: two policies of our own, which are asked before every zone (firewalld.policy(5)). Zones stay as they are.

firewalld takes a new policy only from its files, by a reload. A reload forgets what was changed at run time alone, so the
module refuses where there is such a change.
"""

import os
import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.backends import contract
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.wanted import FIRST, LAST, Wanted
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import quote

FOLDER = "/etc/firewalld/policies"
INPUT, FORWARD = "rosfleet-input", "rosfleet-forward"  # firewalld takes 17 letters at most
_EGRESS = {INPUT: "HOST", FORWARD: "ANY"}
_PRIORITY = -14000  # after firewalld's own policy for IPv6, before every zone
_LET, _DROP = -2, -1  # of our rules: who gets in comes first
_RANGE = f"{FIRST}-{LAST}"
# An interface may be bound to a zone at run time, for example by NetworkManager; a reload keeps that.
_BOUND = re.compile(r"(?m)^  interfaces:.*$|[ ]\((?:default, )?active\)$|[ ]\(default\)$")


class Rule(typing.NamedTuple):
    """A rich rule (firewalld.richlanguage(5))."""

    action: str  # accept or drop
    source: str = ""
    destination: str = ""
    protocol: str = ""  # with ports: tcp or udp
    ports: str = ""

    @property
    def words(self) -> typing.List[typing.Tuple[str, typing.Dict[str, str]]]:
        """The elements of the rule with their attributes, the action last."""
        found: typing.List[typing.Tuple[str, typing.Dict[str, str]]] = []
        if self.source:
            found.append(("source", {"address": self.source}))
        if self.destination:
            found.append(("destination", {"address": self.destination}))
        if self.ports:
            found.append(("port", {"port": self.ports, "protocol": self.protocol}))
        elif self.protocol:
            found.append(("protocol", {"value": self.protocol}))
        return [*found, (self.action, {})]

    @property
    def attributes(self) -> typing.Dict[str, str]:
        """The attributes of the rule itself, in the order of firewall-cmd."""
        found = {"priority": str(_LET if self.action == "accept" else _DROP)}
        addresses = self.source + self.destination
        if addresses:
            found["family"] = "ipv6" if ":" in addresses else "ipv4"
        return found

    @property
    def text(self) -> str:
        """The rule as firewall-cmd lists it."""
        words = ["rule" + _attributes(self.attributes)]
        return " ".join(words + [name + _attributes(attributes) for name, attributes in self.words])

    @property
    def xml(self) -> str:
        """The rule as a file of firewalld has it."""
        inner = "".join(f"<{name}{_attributes(attributes)}/>" for name, attributes in self.words)
        return f"  <rule{_attributes(self.attributes)}>{inner}</rule>\n"


def _attributes(values: typing.Mapping[str, str]) -> str:
    return "".join(f' {name}="{value}"' for name, value in values.items())


class BackEnd(contract.BackEnd):
    """firewalld, where it runs."""

    name = "firewalld"

    def active(self) -> bool:
        if not contract.program("firewall-cmd"):
            return False
        return contract.ask(["firewall-cmd", "--state"]).status == 0

    def read(self) -> contract.Rules:
        if not self.active():
            return []
        found = []
        for policy in _EGRESS:
            answer = contract.ask(["firewall-cmd", f"--policy={policy}", "--list-rich-rules"])
            if answer.status == 0:
                found += [f"{policy}: {line}" for line in answer.output.decode("utf-8", "replace").splitlines() if line]
        return sorted(found)

    def rules(self, wanted: Wanted) -> contract.Rules:
        return sorted(f"{policy}: {rule.text}" for policy, rules in policies(wanted).items() for rule in rules)

    def files(self, wanted: Wanted) -> typing.List[contract.File]:
        return [
            {"path": f"{FOLDER}/{policy}.xml", "content": _file(policy, rules), "mode": "0644"}
            for policy, rules in policies(wanted).items()
        ]

    def refusal(self) -> str:
        if not self.active():
            return ""
        if not os.path.isdir(FOLDER):
            return (
                f"firewalld has no {FOLDER}, expected firewalld 0.9 or later, which has policies: stop it for good (systemctl "
                "disable --now firewalld), or set multimaster_firewall to none."
            )
        for what in ("--list-all-zones", "--list-all-policies"):
            now, kept = (_without_ours(contract.do(["firewall-cmd", *how, what])) for how in ((), ("--permanent",)))
            if now != kept:
                line = next(iter(sorted(set(now.splitlines()) ^ set(kept.splitlines()))), "").strip()
                return (
                    f"firewalld differs at run time from its files ({quote(line)}), which a reload would undo; expected the same: keep "
                    "the change (firewall-cmd --runtime-to-permanent) or drop it (firewall-cmd --reload)."
                )
        return ""

    def load(self, wanted: typing.Optional[Wanted]) -> None:
        if self.active() and self.read() != ([] if wanted is None else self.rules(wanted)):
            contract.do(["firewall-cmd", "--reload"])

    def try_out(self, wanted: typing.Optional[Wanted]) -> None:
        """Reload with the files of the plan, and put back those that were there, for the next boot."""
        before = self.undo_files()
        try:
            planned = {} if wanted is None else {file["path"]: file["content"] for file in self.files(wanted)}
            _write([(path, planned[path].encode("utf-8") if path in planned else None) for path, _content in before])
            contract.do(["firewall-cmd", "--reload"])
        finally:
            _write(before)

    def restore(self, before: contract.Rules) -> None:
        if self.active() and self.read() != before:
            contract.do(["firewall-cmd", "--reload"])

    def undo_files(self) -> typing.List[typing.Tuple[str, typing.Optional[bytes]]]:
        paths = [f"{FOLDER}/{policy}.xml" for policy in _EGRESS]
        return [(path, atomic.read_bytes(path)) for path in paths]

    def undo_last(self) -> typing.List[contract.Command]:
        return [["firewall-cmd", "--reload"]]


def policies(wanted: Wanted) -> typing.Dict[str, typing.List[Rule]]:
    """The policies that are wanted, with their rules."""
    both = ("tcp", "udp")
    open_ports = [Rule("accept", protocol=port.protocol, ports=str(port.number)) for port in wanted.open_ports]
    let_in = [Rule("accept", member, "", name, _RANGE) for member in wanted.members for name in both]
    # A switch asks from any address who listens to which group; zones may refuse that.
    igmp = [Rule("accept", protocol="igmp")]
    # Ports of ssh are neither opened nor closed: the zones decide about them.
    closed = [(name, _ports(*ports)) for name in both for ports in wanted.closed(name)]
    found = {INPUT: let_in + igmp + open_ports + [Rule("drop", "", "", *what) for what in closed]}
    if wanted.networks:
        passing = [
            Rule("accept", *way)
            for network in wanted.networks
            for member in wanted.of_version(4)
            for way in ((member, network), (network, member))
            if member != network
        ]
        drops = [Rule("drop", "", network, *what) for network in wanted.networks for what in closed]
        found[FORWARD] = passing + open_ports + drops
    return found


def _ports(first: int, last: int) -> str:
    return str(first) if first == last else f"{first}-{last}"


def _file(policy: str, rules: typing.Iterable[Rule]) -> str:
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f"<!-- {contract.HEADER} -->\n"
        f'<policy target="CONTINUE" priority="{_PRIORITY}">\n'
        "  <short>Fleet</short>\n"
        '  <ingress-zone name="ANY"/>\n'
        f'  <egress-zone name="{_EGRESS[policy]}"/>\n'
        f"{''.join(rule.xml for rule in rules)}</policy>\n"
    )


def _without_ours(listing: str) -> str:
    """A listing of zones or policies, without what a reload keeps anyway, and without our own policies."""
    blocks = [block.strip("\n") for block in _BOUND.sub("", listing).split("\n\n")]
    return "\n\n".join(sorted(block for block in blocks if block and block.split("\n")[0].strip() not in _EGRESS))


def _write(files: typing.Iterable[typing.Tuple[str, typing.Optional[bytes]]]) -> None:
    for path, content in files:
        if content is None:
            atomic.remove(path)
        else:
            atomic.write_by_rename(path, content)
