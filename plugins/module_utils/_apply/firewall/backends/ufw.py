# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""ufw: rules with our comment, above foreign rules, in the files that ufw reads (ufw(8)).

All rules change in one write of each file and one step of the kernel, as ufw does it for each of its commands: a fleet of
30 robots has 65 rules and more, and each command of ufw takes a second on a robot, and ends where another program holds the lock
of iptables. Only stanzas with our comment are written and taken out; every other byte of the files stays.
"""

import contextlib
import errno
import fcntl
import re
import time
import typing

from ...._base import commands
from ...._base.plain_text import quote
from ...._base.problem import Problem
from ...transaction import atomic
from ...transaction.deadman import FileBefore, UndoStep
from ..packet_filter import FIRST, LAST, PacketFilter
from . import contract

FILES = {4: "/etc/ufw/user.rules", 6: "/etc/ufw/user6.rules"}
SETTINGS, DEFAULTS = "/etc/ufw/ufw.conf", "/etc/default/ufw"
LOCK = "/run/ufw.lock"  # which each command of ufw has while it reads and writes
ANYBODY = {4: "0.0.0.0/0", 6: "::/0"}
_TOOLS = {4: ("iptables", "ufw"), 6: ("ip6tables", "ufw6")}
_TUPLE = re.compile(r"^### tuple ### (.*)$", re.MULTILINE)
_COMMENT = " comment=" + contract.MARK.encode().hex()
# With the empty line before it, where it has one.
_OURS = re.compile(
    rf"(?m)(?:(?<=\n)\n)?^### tuple ### (?P<rule>[^\n]*){re.escape(_COMMENT)}\n(?:-A ufw6?-user-(?:input|forward) [^\n]*\n)?"
)
_RULES = re.compile(r"(?m)^### RULES ###\n")
_RANGE = f"{FIRST}:{LAST}"
_TARGETS = {"allow": "ACCEPT", "deny": "DROP"}
# $1: iptables or ip6tables, $2: the beginning of ufw's chains, $3: the file with its rules, $4: seconds to wait for others that change rules.
# The file names the chains of these rules, which empties them; all of it is one step of the kernel. Before 1.6.2, the tool did not wait for another one.
_READ_AGAIN = """\
"$1" -w $4 -nL "$2-user-input" >/dev/null
case $? in 0) ;; 4) exit 4 ;; *) exit 0 ;; esac
wait=; "$1-restore" --help 2>&1 | grep -qe --wait && wait="-w $4"
"$1-restore" $wait -n <"$3"
"""
_WAIT = 25  # seconds; whoever holds a lock for longer is named


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
        """True if the rule lets packets in."""
        return self.action.endswith("allow")

    def render(self) -> str:
        """The rule as ufw writes it: its words in a comment, and the line of iptables-restore(8)."""
        route, action = self.action.startswith("route:"), self.action.rpartition(":")[2]
        words = ["-A", f"{_TOOLS[self.version][1]}-user-{'forward' if route else 'input'}"]
        words += ["-p", self.protocol] if self.protocol != "any" else []
        several = ":" in self.port
        words += ["-m", "multiport", "--dports", self.port] if several else []
        words += ["-d", self.destination] if self.destination not in ANYBODY.values() else []
        words += ["--dport", self.port] if not several and self.port != "any" else []
        words += ["-s", self.source] if self.source not in ANYBODY.values() else []
        return f"\n### tuple ### {self.text}{_COMMENT}\n{' '.join([*words, '-j', _TARGETS[action]])}\n"


def _parse_rule(text: str) -> UfwRule:
    """The rule in a line of `read_rules`. Raises Problem for a rule that other code wrote."""
    words = text.split()
    if len(words) != 7 or words[4] != "any" or words[6] != "in":
        raise Problem(
            f"ufw has a rule with the comment {contract.MARK} that this module has not written ({quote(text)}); expected its own ones "
            "only: give it another comment, or remove it."
        )
    return UfwRule(words[0], words[1], words[2], words[3], words[5])


class BackEnd(contract.BackEnd):
    """ufw, if it is enabled."""

    name = "ufw"

    @staticmethod
    def is_active() -> bool:
        enabled = re.search(r"(?mi)^[ \t]*ENABLED=[\"']?yes", commands.text(SETTINGS))
        return bool(enabled) and "Status: active" in contract.run_command(["ufw", "status"]).text

    def read_rules(self) -> contract.Rules:
        if not contract.find_program("ufw"):
            return []
        return sorted(_select_own(_read_tuples()))

    def plan_rules(self, packet_filter: PacketFilter) -> contract.Rules:
        return sorted(rule.text for rule in list_rules(packet_filter, self._list_versions()))

    def is_ready_for_boot(self) -> bool:
        return not any(_find_misplaced(commands.text(path)) for path in FILES.values())

    def load(self) -> None:
        self._arrange(list_rules(self.packet_filter, self._list_versions()) if self.packet_filter else [])

    def restore(self) -> None:
        self._arrange([_parse_rule(text) for text in self.before])

    def _arrange(self, planned: typing.List[UfwRule]) -> None:
        """Make these rules our only ones, each in its place: in the files, and at once in the kernel. Raises Problem, OSError."""
        with _lock():
            for version, path in FILES.items():
                content = atomic.read_bytes(path)
                wanted = [rule for rule in planned if rule.version == version]
                if content is None and not wanted:
                    continue
                text = (content or b"").decode("utf-8", "surrogateescape")
                arranged = arrange(text, wanted, path).encode("utf-8", "surrogateescape")
                contract.write_files([FileBefore(path, arranged)])
                contract.run_or_fail(_read_again(version, str(_WAIT)))

    def try_out(self) -> None:
        with contract.keep_files(contract.read_files(FILES.values())):
            self.load()

    def undo_steps(self) -> typing.List[UndoStep]:
        files = contract.read_files(FILES.values())
        if any(file.content is None for file in files):
            return [*files, ["ufw", "reload"]]
        # A reload of ufw lets everything in for a moment, and loses rules that others have put into its other chains.
        return [*files, *(_read_again(version, "") for version in FILES)]

    # The files of ufw

    def _list_versions(self) -> typing.List[int]:
        without_ipv6 = re.search(r"(?mi)^[ \t]*IPV6=[\"']?no", commands.text(DEFAULTS))
        return [4] if without_ipv6 else [4, 6]


@contextlib.contextmanager
def _lock() -> typing.Iterator[None]:
    """Hold the lock of ufw, as its commands do: none of them reads or writes the files meanwhile. Raises OSError, Problem."""
    end = time.monotonic() + _WAIT
    with open(LOCK, "w", encoding="utf-8") as stream:
        while True:
            try:
                fcntl.lockf(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as problem:
                if problem.errno not in (errno.EACCES, errno.EAGAIN) or time.monotonic() > end:
                    raise _explain_lock(problem) from None
            time.sleep(0.1)
        yield


def _explain_lock(problem: OSError) -> Exception:
    """The sentence where a command of ufw works for too long, as one that waits for a person's answer; else the problem itself."""
    if problem.errno not in (errno.EACCES, errno.EAGAIN):
        return problem
    return Problem(
        f"A command of ufw holds {LOCK} for more than {_WAIT} s, expected it to end: look for it (fuser -v {LOCK}), since it may wait for "
        "somebody's answer, and run again."
    )


def _read_again(version: int, wait: str) -> contract.Command:
    """The command that makes the rules in the kernel those of the file; `wait` for the lock of iptables, in seconds, "" for ever."""
    return ["sh", "-c", _READ_AGAIN, "sh", *_TOOLS[version], FILES[version], wait]


def arrange(text: str, planned: typing.Sequence[UfwRule], path: str) -> str:
    """Return the text of a file of ufw with these rules as our only ones; every other byte stays. Raises Problem.

    A rule that is there already stays in its place. New ones that allow go above all others, new ones that deny below our
    last one that allows: so no member of the fleet is kept out, and no rule of others lets in what ours keep out.
    """
    if not planned and not _OURS.search(text):
        return text
    rules = _RULES.search(text)
    if not rules:
        raise Problem(
            f"{path} has no line '### RULES ###', expected the file as ufw writes it: have ufw write it anew (ufw logging low), and run again."
        )
    top = rules.end()
    text, kept = _take_out(text, {rule.text for rule in planned} - _find_misplaced(text))
    missing = [rule for rule in planned if rule.text not in kept]
    text = text[:top] + "".join(rule.render() for rule in missing if rule.is_allow) + text[top:]
    allows = [match.end() for match in _OURS.finditer(text) if _parse_rule(match.group("rule")).is_allow]
    place = allows[-1] if allows else top
    return text[:place] + "".join(rule.render() for rule in missing if not rule.is_allow) + text[place:]


def _find_misplaced(text: str) -> typing.Set[str]:
    """Our rules in a file that deny and come before one of ours that allows. Raises Problem."""
    rules = [_parse_rule(rule) for rule in _select_own(_TUPLE.findall(text))]
    last = max((number for number, rule in enumerate(rules) if rule.is_allow), default=0)
    return {rule.text for rule in rules[:last] if not rule.is_allow}


def _take_out(text: str, good: typing.Set[str]) -> typing.Tuple[str, typing.Set[str]]:
    """Return the text without our rules that are not good, or stand there twice; and those that it keeps."""
    kept: typing.Set[str] = set()

    def keep(match: "typing.Match[str]") -> str:
        rule = match.group("rule")
        if rule not in good or rule in kept:
            return ""
        kept.add(rule)
        return match.group()

    return _OURS.sub(keep, text), kept


def _read_tuples() -> typing.List[str]:
    """The rules in the files of ufw, in their order."""
    return [rule for path in FILES.values() for rule in _TUPLE.findall(commands.text(path))]


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
