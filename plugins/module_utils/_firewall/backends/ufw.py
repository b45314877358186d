# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""ufw: rules with our comment at the top of ufw's own, by ufw(8); the rules of others stay below them.

ufw keeps its rules in files that it writes itself. This file only reads them, but for the dead-man's switch: it puts them
back as they were until the change is confirmed.
"""

import os
import re
import stat
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.backends import contract
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.wanted import FIRST, LAST, Wanted
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import quote
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process import commands

FILES = {4: "/etc/ufw/user.rules", 6: "/etc/ufw/user6.rules"}
SETTINGS, DEFAULTS = "/etc/ufw/ufw.conf", "/etc/default/ufw"
ANYBODY = {4: "0.0.0.0/0", 6: "::/0"}
_TUPLE = re.compile(r"^### tuple ### (.*)$", re.MULTILINE)
_COMMENT = " comment=" + contract.MARK.encode().hex()
_RANGE = f"{FIRST}:{LAST}"


class Rule(typing.NamedTuple):
    """A rule as the files of ufw have it in their comments."""

    action: str  # allow or deny, with "route:" before it for packets that are passed on
    protocol: str = "any"
    port: str = "any"
    destination: str = ""
    source: str = ""

    @property
    def text(self) -> str:
        """The rule as `read` shows it."""
        return f"{self.action} {self.protocol} {self.port} {self.destination} any {self.source} in"

    @property
    def version(self) -> int:
        """The version of the internet protocol."""
        return 6 if ":" in self.source else 4

    @property
    def lets(self) -> bool:
        """True where it lets packets in."""
        return self.action.endswith("allow")

    def command(self, *verb: str) -> contract.Command:
        """The command of ufw for it; `verb` is prepend, insert and a position, or delete."""
        route, action = (["route"], self.action[6:]) if self.action.startswith("route:") else ([], self.action)
        protocol = ["proto", self.protocol] if self.protocol != "any" else []
        port = ["port", self.port] if self.port != "any" else []
        force = ["--force"] if verb == ("delete",) else []
        words = ["ufw", *force, *route, *verb, action, *protocol, "from", self.source, "to", self.destination, *port]
        return words if force else [*words, "comment", contract.MARK]


def _rule(text: str) -> Rule:
    """The rule of a line that `read` shows. Raises Problem for one that this file has not written."""
    words = text.split()
    if len(words) != 7 or words[4] != "any" or words[6] != "in":
        raise Problem(
            f"ufw has a rule with the comment {contract.MARK} that this module has not written ({quote(text)}); expected its own ones "
            "only: give it another comment, or remove it."
        )
    return Rule(words[0], words[1], words[2], words[3], words[5])


class BackEnd(contract.BackEnd):
    """ufw, where it is enabled."""

    name = "ufw"

    def active(self) -> bool:
        enabled = re.search(r"(?mi)^[ \t]*ENABLED=[\"']?yes", commands.text(SETTINGS))
        if not enabled or not contract.program("ufw"):
            return False
        return "Status: active" in contract.ask(["ufw", "status"]).output.decode("utf-8", "replace")

    def read(self) -> contract.Rules:
        if not contract.program("ufw"):
            return []
        return sorted(text for texts in self._tuples(ours=True).values() for text in texts)

    def rules(self, wanted: Wanted) -> contract.Rules:
        return sorted(rule.text for rule in rules(wanted, self._versions()))

    def in_order(self, wanted: typing.Optional[Wanted]) -> bool:
        return not self._misplaced()

    def load(self, wanted: typing.Optional[Wanted]) -> None:
        planned = [] if wanted is None else rules(wanted, self._versions())
        missing = self._without_the_others(planned)
        # Who gets in comes first and goes last, so nobody of the fleet is kept out meanwhile.
        for rule in reversed([rule for rule in missing if rule.lets]):
            contract.do(rule.command("prepend"))
        for rule in [rule for rule in missing if not rule.lets]:
            contract.do(rule.command(*self._below(rule.version)))

    def _without_the_others(self, planned: typing.List[Rule]) -> typing.List[Rule]:
        """Delete our rules that are not planned or not in their place; returns those of the plan that are missing then."""
        texts = {rule.text for rule in planned}
        misplaced = self._misplaced()
        there = [_rule(text) for text in self.read()]
        for rule in sorted(there, key=lambda rule: rule.lets):
            if rule.text not in texts or rule.text in misplaced:
                contract.do(rule.command("delete"))
        stays = {rule.text for rule in there if rule.text in texts and rule.text not in misplaced}
        return [rule for rule in planned if rule.text not in stays]

    def try_out(self, wanted: typing.Optional[Wanted]) -> None:
        before = self.undo_files()
        try:
            self.load(wanted)
        finally:
            for path, content in before:
                _put_back(path, content)

    def restore(self, before: contract.Rules) -> None:
        """Bring back what can be brought back with the words of ufw; the next run finds the rest."""
        for rule in [_rule(text) for text in self.read()]:
            if rule.text not in before:
                contract.do(rule.command("delete"))
        missing = [_rule(text) for text in before if text not in self.read()]
        for rule in sorted(missing, key=lambda rule: rule.lets):
            contract.do(rule.command("prepend"))

    def undo_files(self) -> typing.List[typing.Tuple[str, typing.Optional[bytes]]]:
        return [(path, atomic.read_bytes(path)) for path in FILES.values() if os.path.exists(path)]

    def undo_last(self) -> typing.List[contract.Command]:
        return [["ufw", "reload"]]

    # The files of ufw

    def _versions(self) -> typing.List[int]:
        off = re.search(r"(?mi)^[ \t]*IPV6=[\"']?no", commands.text(DEFAULTS))
        return [4] if off else [4, 6]

    def _tuples(self, ours: bool) -> typing.Dict[int, typing.List[str]]:
        """The rules of each version in their order: ours without the comment, or all."""
        found = {version: _TUPLE.findall(commands.text(path)) for version, path in FILES.items()}
        if not ours:
            return found
        own = {version: [text for text in texts if text.endswith(_COMMENT)] for version, texts in found.items()}
        return {version: [text[: -len(_COMMENT)] for text in texts] for version, texts in own.items()}

    def _misplaced(self) -> typing.Set[str]:
        """Our rules that keep out and stand before one of ours that lets in."""
        found = set()
        for texts in self._tuples(ours=True).values():
            lets = [number for number, text in enumerate(texts) if _rule(text).lets]
            found |= {text for number, text in enumerate(texts) if lets and number < lets[-1] and number not in lets}
        return found

    def _below(self, version: int) -> typing.Tuple[str, ...]:
        """Where a rule goes that keeps out: below our last one that lets in. ufw counts all rules of IPv4 first."""
        everything = self._tuples(ours=False)
        ours = [number for number, text in enumerate(everything[version]) if text.endswith(_COMMENT)]
        lets = [number for number in ours if _rule(everything[version][number][: -len(_COMMENT)]).lets]
        if not lets:
            return ("prepend",)
        place = lets[-1] + 1
        if place >= len(everything[version]):
            return ()
        return ("insert", str(place + 1 + (len(everything[4]) if version == 6 else 0)))


def rules(wanted: Wanted, versions: typing.Iterable[int]) -> typing.List[Rule]:
    """The wanted rules in their order."""
    lets, keeps = [], []
    for version in versions:
        anybody = ANYBODY[version]
        for protocol in ("tcp", "udp"):
            lets += [Rule("allow", protocol, _RANGE, anybody, member) for member in wanted.of_version(version)]
            lets += [Rule("allow", protocol, port, anybody, anybody) for port in _opened(wanted, protocol)]
            keeps += [Rule("deny", protocol, ports, anybody, anybody) for ports in _closed(wanted, protocol)]
    # A switch asks from any address who listens to which group; ufw's default refuses that.
    lets.append(Rule("allow", "igmp", "any", ANYBODY[4], ANYBODY[4]))
    for network in wanted.networks:
        for member in wanted.of_version(4):
            if member != network:
                ways = ((network, member), (member, network))
                lets += [Rule("route:allow", destination=there, source=here) for there, here in ways]
        for protocol in ("tcp", "udp"):
            lets += [Rule("route:allow", protocol, port, network, ANYBODY[4]) for port in _opened(wanted, protocol)]
            keeps += [Rule("route:deny", protocol, ports, network, ANYBODY[4]) for ports in _closed(wanted, protocol)]
    return [*dict.fromkeys(lets), *dict.fromkeys(keeps)]


def _opened(wanted: Wanted, protocol: str) -> typing.List[str]:
    """The ports that are opened. Those of ssh are not: the rules of others about them have the last word."""
    return [str(port.number) for port in wanted.open_ports if port.protocol == protocol]


def _closed(wanted: Wanted, protocol: str) -> typing.List[str]:
    return [str(first) if first == last else f"{first}:{last}" for first, last in wanted.closed(protocol)]


def _put_back(path: str, content: typing.Optional[bytes]) -> None:
    status = os.stat(path)
    if content is not None and atomic.read_bytes(path) != content:
        atomic.write_by_rename(path, content, stat.S_IMODE(status.st_mode), (status.st_uid, status.st_gid))
