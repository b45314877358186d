# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""ufw: rules with our comment, above foreign rules, by ufw(8).

ufw keeps its rules in files that it writes itself. This file only reads them. One case is different: until a change
under the dead-man's switch is confirmed, it restores them as they were. One that was not there goes again, after a
trial and on the way back.
"""

import re
import typing

from ...._base import commands
from ...._base.plain_text import quote
from ...._base.problem import Problem
from ...transaction.deadman import UndoStep
from ..packet_filter import FIRST, LAST, PacketFilter
from . import contract

FILES = {4: "/etc/ufw/user.rules", 6: "/etc/ufw/user6.rules"}
SETTINGS, DEFAULTS = "/etc/ufw/ufw.conf", "/etc/default/ufw"
ANYBODY = {4: "0.0.0.0/0", 6: "::/0"}
_TUPLE = re.compile(r"^### tuple ### (.*)$", re.MULTILINE)
_COMMENT = " comment=" + contract.MARK.encode().hex()
_RANGE = f"{FIRST}:{LAST}"
# What ufw itself does for each of its commands: $1: iptables or ip6tables, $2: the beginning of its chains, $3: the file with its rules.
# The file names the chains of these rules, which empties them; all of it is one step of the kernel.
_READ_AGAIN = '"$1" -w -nL "$2-user-input" >/dev/null 2>&1 || exit 0; "$1-restore" -w -n <"$3"'


class UfwRule(typing.NamedTuple):
    """A rule as the files of ufw have it in their comments."""

    action: str  # allow or deny, with "route:" before it for packets that are passed on
    protocol: str = "any"
    port: str = "any"
    destination: str = ""
    source: str = ""

    @property
    def text(self) -> str:
        """The rule as `read_rules` returns it."""
        return f"{self.action} {self.protocol} {self.port} {self.destination} any {self.source} in"

    @property
    def version(self) -> int:
        """The version of the internet protocol."""
        return 6 if ":" in self.source else 4

    @property
    def is_allow(self) -> bool:
        """True where the rule lets packets in."""
        return self.action.endswith("allow")

    def command(self, *verb: str) -> contract.Command:
        """The command of ufw for the rule; `verb` is prepend, insert and a position, or delete."""
        route, action = (["route"], self.action[6:]) if self.action.startswith("route:") else ([], self.action)
        protocol = ["proto", self.protocol] if self.protocol != "any" else []
        port = ["port", self.port] if self.port != "any" else []
        force = ["--force"] if verb == ("delete",) else []
        words = ["ufw", *force, *route, *verb, action, *protocol, "from", self.source, "to", self.destination, *port]
        return words if force else [*words, "comment", contract.MARK]


def _parse_rule(text: str) -> UfwRule:
    """The rule in a line of `read_rules`. Raises Problem for a rule that this file has not written."""
    words = text.split()
    if len(words) != 7 or words[4] != "any" or words[6] != "in":
        raise Problem(
            f"ufw has a rule with the comment {contract.MARK} that this module has not written ({quote(text)}); expected its own ones "
            "only: give it another comment, or remove it."
        )
    return UfwRule(words[0], words[1], words[2], words[3], words[5])


class BackEnd(contract.BackEnd):
    """ufw, where it is enabled."""

    name = "ufw"

    @staticmethod
    def is_active() -> bool:
        enabled = re.search(r"(?mi)^[ \t]*ENABLED=[\"']?yes", commands.text(SETTINGS))
        return bool(enabled) and "Status: active" in contract.run_command(["ufw", "status"]).text

    def read_rules(self) -> contract.Rules:
        if not contract.find_program("ufw"):
            return []
        return sorted(text for texts in _read_tuples().values() for text in _select_own(texts))

    def plan_rules(self, packet_filter: PacketFilter) -> contract.Rules:
        return sorted(rule.text for rule in list_rules(packet_filter, self._list_versions()))

    def is_ready_for_boot(self) -> bool:
        return not self._find_misplaced()

    def load(self) -> None:
        self._arrange(list_rules(self.packet_filter, self._list_versions()) if self.packet_filter else [])

    def restore(self) -> None:
        self._arrange([_parse_rule(text) for text in self.before])

    def _arrange(self, planned: typing.List[UfwRule]) -> None:
        """Make these rules our only ones, each in its place."""
        good = {rule.text for rule in planned} - self._find_misplaced()
        current = [_parse_rule(text) for text in self.read_rules()]
        # Rules that allow come first and go last, so no member of the fleet is kept out meanwhile.
        for rule in sorted(current, key=lambda rule: rule.is_allow):
            if rule.text not in good:
                contract.run_or_fail(rule.command("delete"))
        missing = [rule for rule in planned if rule.text not in good & {other.text for other in current}]
        for rule in reversed([rule for rule in missing if rule.is_allow]):
            contract.run_or_fail(rule.command("prepend"))
        for rule in [rule for rule in missing if not rule.is_allow]:
            contract.run_or_fail(rule.command(*self._choose_position(rule.version)))

    def try_out(self) -> None:
        with contract.keep_files(contract.read_files(FILES.values())):
            self.load()

    def undo_steps(self) -> typing.List[UndoStep]:
        files = contract.read_files(FILES.values())
        if any(file.content is None for file in files):
            return [*files, ["ufw", "reload"]]
        # A reload of ufw lets everything in for a moment, and loses rules that others have put into its other chains.
        names = ((4, "iptables", "ufw"), (6, "ip6tables", "ufw6"))
        return [*files, *(["sh", "-c", _READ_AGAIN, "sh", *words, FILES[version]] for version, *words in names)]

    # The files of ufw

    def _list_versions(self) -> typing.List[int]:
        without_ipv6 = re.search(r"(?mi)^[ \t]*IPV6=[\"']?no", commands.text(DEFAULTS))
        return [4] if without_ipv6 else [4, 6]

    def _find_misplaced(self) -> typing.Set[str]:
        """Our rules that deny and stand before one of ours that allows."""
        misplaced = set()
        for texts in _read_tuples().values():
            rules = [_parse_rule(text) for text in _select_own(texts)]
            last = max((number for number, rule in enumerate(rules) if rule.is_allow), default=0)
            misplaced |= {rule.text for rule in rules[:last] if not rule.is_allow}
        return misplaced

    def _choose_position(self, version: int) -> typing.Tuple[str, ...]:
        """The position of a rule that denies: below our last one that allows. ufw counts all rules of IPv4 first."""
        tuples = _read_tuples()
        ours = [number for number, text in enumerate(tuples[version]) if text.endswith(_COMMENT)]
        allows = [number for number in ours if _parse_rule(tuples[version][number][: -len(_COMMENT)]).is_allow]
        if not allows:
            return ("prepend",)
        place = allows[-1] + 1
        if place >= len(tuples[version]):
            return ()
        return ("insert", str(place + 1 + (len(tuples[4]) if version == 6 else 0)))


def _read_tuples() -> typing.Dict[int, typing.List[str]]:
    """The rules of each version in their order."""
    return {version: _TUPLE.findall(commands.text(path)) for version, path in FILES.items()}


def _select_own(texts: typing.Iterable[str]) -> typing.List[str]:
    """Our rules among these, without the comment."""
    return [text[: -len(_COMMENT)] for text in texts if text.endswith(_COMMENT)]


def list_rules(packet_filter: PacketFilter, versions: typing.Iterable[int]) -> typing.List[UfwRule]:
    """The wanted rules in their order: those that allow come first."""
    rules: typing.List[UfwRule] = []
    for version in versions:
        anybody = ANYBODY[version]
        for protocol in ("tcp", "udp"):
            rules += [
                UfwRule("allow", protocol, _RANGE, anybody, member) for member in packet_filter.list_members(version)
            ]
            rules += _list_port_rules(packet_filter, protocol, "", anybody, anybody)
    # A switch sends its IGMP queries from any address; ufw's default refuses them.
    rules.append(UfwRule("allow", "igmp", "any", ANYBODY[4], ANYBODY[4]))
    for network in packet_filter.networks:
        for member in packet_filter.list_members(4):
            if member != network:
                rules.append(UfwRule("route:allow", destination=network, source=member))
                rules.append(UfwRule("route:allow", destination=member, source=network))
        for protocol in ("tcp", "udp"):
            rules += _list_port_rules(packet_filter, protocol, "route:", network, ANYBODY[4])
    return sorted(dict.fromkeys(rules), key=lambda rule: not rule.is_allow)


def _list_port_rules(
    packet_filter: PacketFilter, protocol: str, kind: str, destination: str, source: str
) -> typing.List[UfwRule]:
    """The rules for all senders: ports that stay open, and ports that are closed.

    Foreign rules decide about those of ssh.
    """
    opens = [(port.number, port.number) for port in packet_filter.open_ports if port.protocol == protocol]
    return [
        UfwRule(kind + action, protocol, str(first) if first == last else f"{first}:{last}", destination, source)
        for action, ranges in (("allow", opens), ("deny", packet_filter.list_closed_ranges(protocol)))
        for first, last in ranges
    ]
