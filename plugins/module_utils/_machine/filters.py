# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The packet filter of this machine, as far as it can be read simply: rules of nftables, also those that iptables has made.

Rules with other words than protocol, port, addresses, interfaces, state and length are not understood. They are counted, and left out.
A rule as people know it is only in nft's text: in JSON `-m conntrack --ctstate INVALID` is {"xt": ...}, and {"xt": null} with nft 0.9.8 of Debian 11.
"""

import ipaddress
import json
import typing

from .._base.commands import run

HOOKS = ("input", "output", "forward", "postrouting")
OWN = "rosfleet_multimaster"  # the collection's own table, which the plan has
MOST_RULES = 2000  # of one chain, with those of the chains that it jumps to
DEEPEST = 8

Words = typing.Dict[str, typing.Any]
Rules = typing.Dict[typing.Tuple[str, str, str], typing.List[typing.List[Words]]]  # (family, table, chain) -> rules
Reader = typing.Callable[[typing.Any], Words]
VERDICTS = ("accept", "drop", "reject", "masquerade")
_SILENT = ("counter", "log", "comment")  # words of a rule that decide nothing
_OPERATION = {"payload": {"protocol": "arp", "field": "operation"}}
ANSWERS = {"established", "related"}

NOTHING: Words = {"readable": False, "chains": [], "arp": []}


class WrittenRule(typing.NamedTuple):
    """A rule in nft's text, or the first line of a chain that has a hook ("type filter hook input ...")."""

    table: str  # with its family
    chain: str
    text: str


def list_written_rules(lines: typing.Iterable[str]) -> typing.Iterator[WrittenRule]:
    """List the rules in lines of `nft list ruleset`; no sets and no maps."""
    table = chain = ""  # chain: "" in anything else
    for line in lines:
        words = line.split()
        if words[:1] == ["table"]:
            table = " ".join(words[1:3])
        elif words[-1:] == ["{"]:
            chain = words[1] if words[0] == "chain" else ""
        elif words == ["}"]:
            chain = ""
        elif chain and words and words[0] != "#":
            yield WrittenRule(table, chain, " ".join(words))


class UnknownRule(Exception):
    """A rule with words that this reader does not know."""


def filters() -> Words:
    """Read the chains of IPv4 and ARP. `readable` is false without nft, or without an answer in JSON."""
    answer = run(["nft", "-j", "list", "ruleset"], limit=10)
    try:
        if answer.status == 0:
            ruleset = json.loads(answer.output.decode("utf-8"))
            return {"readable": True, "chains": chains(ruleset), "arp": find_arp_filters(ruleset)}
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        pass  # another form than this one
    return NOTHING


def chains(ruleset: Words) -> typing.List[Words]:
    """The chains at HOOKS, in the order in which a packet meets them, out of the output of `nft -j list ruleset`."""
    bases, rules = _sort_entries(ruleset)
    made: typing.List[Words] = []
    for base in sorted(bases, key=lambda chain: int(chain.get("prio", 0))):
        if base["family"] not in ("ip", "inet") or base["table"] == OWN:
            continue
        read = _ChainReader(base["family"], base["table"], rules)
        read.chain(base["name"], {}, 0)
        policy = base.get("policy", "accept")
        table = f"{base['family']} {base['table']}"
        named = {"hook": base["hook"], "table": table, "policy": policy, "chain": base["name"]}
        # Other words of a chain for addresses are those that translate a target, as Docker's: they drop nothing.
        unread = 0 if base.get("type") == "nat" and base["hook"] != "postrouting" else read.unread
        made.append(dict(named, rules=read.flat, unread=unread))
    return [chain for chain in made if chain["rules"] or chain["unread"] or chain["policy"] != "accept"]


def _sort_entries(ruleset: Words) -> typing.Tuple[typing.List[Words], Rules]:
    """Return the chains at HOOKS, and the rules of each chain."""
    entries = ruleset["nftables"]
    rules: Rules = {}
    for entry in entries:
        if "rule" in entry:
            rule = entry["rule"]
            rules.setdefault((rule["family"], rule["table"], rule["chain"]), []).append(rule["expr"])
    return [entry["chain"] for entry in entries if entry.get("chain", {}).get("hook") in HOOKS], rules


def find_arp_filters(ruleset: Words) -> typing.List[str]:
    """Find the tables that drop ARP, whoever asks or answers: a rule for only some addresses may be intended."""
    bases, rules = _sort_entries(ruleset)
    found = {
        f"arp {base['table']}"
        for base in bases
        if base["family"] == "arp"
        and _drops_all(rules.get(("arp", base["table"], base["name"]), []), base.get("policy", "accept"))
    }
    return sorted(found)


def _drops_all(rules: typing.List[typing.List[Words]], policy: str) -> bool:
    """Return True if a chain drops all questions or all answers, with no rule before that could let some pass."""
    for words in rules:
        kinds = {kind for word in words for kind in word}
        matches = [word["match"]["left"] for word in words if "match" in word]
        if "drop" not in kinds and not kinds <= {"match", *_SILENT}:
            return False
        if "drop" in kinds and kinds <= {"drop", "match", *_SILENT} and all(left == _OPERATION for left in matches):
            return True
    return policy == "drop"


class _ChainReader:
    """Reads one chain, and puts the rules of the chains that it jumps to in its place."""

    def __init__(self, family: str, table: str, rules: Rules) -> None:
        self.family, self.table, self.rules = family, table, rules
        self.flat: typing.List[Words] = []
        self.unread = 0

    def chain(self, name: str, before: Words, depth: int) -> None:
        rules = self.rules.get((self.family, self.table, name), [])
        for words in rules:
            if len(self.flat) >= MOST_RULES:
                self.unread += 1
                return
            if words is rules[-1] and "return" in words[-1]:
                return
            try:
                self._rule(name, words, before, depth)
            except UnknownRule:
                self.unread += 1

    def _rule(self, name: str, words: typing.List[Words], before: Words, depth: int) -> None:
        rule = dict(before)
        for word in words:
            kind, value = next(iter(word.items()))
            if kind == "match":
                _together(rule, _match(value))
            elif kind in VERDICTS:
                self.flat.append(dict(rule, verdict=kind, chain=name))
                return
            elif kind in ("jump", "goto"):
                if depth >= DEEPEST:
                    raise UnknownRule
                self.chain(value["target"], rule, depth + 1)
                return
            elif kind == "return" or kind not in _SILENT:
                raise UnknownRule
        # A rule without a verdict counts or logs.


def _together(rule: Words, more: Words) -> None:
    """Add the words of a match. Raises UnknownRule for a word with two values."""
    for name, value in more.items():
        if rule.get(name, value) != value:
            raise UnknownRule
        rule[name] = value


def _match(words: Words) -> Words:
    """Read one match. Raises UnknownRule."""
    left, right = words["left"], words["right"]
    if left in _LENGTHS and words.get("op") in (">", ">=") and isinstance(right, int):
        return {"above": right - (words["op"] == ">=")}
    if words.get("op") == "!=" and right == "lo" and left in _INTERFACES:
        return {}  # a packet of another computer never comes by the loopback interface
    if words.get("op") not in ("==", "in") or not isinstance(left, dict):
        raise UnknownRule
    kind, value = next(iter(left.items()))
    if kind == "payload":
        return _payload(value, right)
    reader = _READERS.get((kind, value["key"])) if kind in ("meta", "ct") else None
    if reader is None:
        raise UnknownRule
    return reader(right)


def _interface(name: str) -> Reader:
    def read(right: typing.Any) -> Words:
        if not isinstance(right, str) or "*" in right:
            raise UnknownRule
        return {name: right}

    return read


def _payload(value: Words, right: typing.Any) -> Words:
    field = value.get("field")
    if value.get("protocol") == "ip" and field in ("saddr", "daddr"):
        return {"sources" if field == "saddr" else "destinations": _networks(right)}
    if value.get("protocol") == "ip" and field == "protocol":
        return {"protocol": _protocol(right)}
    if value.get("protocol") in ("tcp", "udp") and field == "dport":
        return {"protocol": value["protocol"], "ports": _ports(right)}
    if value.get("protocol") == "icmp" and field == "type" and right == "echo-request":
        return {"protocol": "icmp", "state": "new"}
    raise UnknownRule


def _protocol(right: typing.Any) -> str:
    if right not in ("tcp", "udp", "icmp"):
        raise UnknownRule
    return str(right)


def _state(right: typing.Any) -> str:
    states = set(right if isinstance(right, list) else right.get("set", []) if isinstance(right, dict) else [right])
    if states == {"new"}:
        return "new"
    if states and states <= ANSWERS | {"untracked"} and "established" in states:
        return "answer"
    raise UnknownRule


def _networks(right: typing.Any) -> typing.List[str]:
    networks = []
    for entry in right["set"] if isinstance(right, dict) and "set" in right else [right]:
        text = (
            f"{entry['prefix']['addr']}/{entry['prefix']['len']}"
            if isinstance(entry, dict) and "prefix" in entry
            else entry
        )
        try:
            networks.append(str(ipaddress.IPv4Network(text)))
        except ValueError:
            raise UnknownRule from None  # a range, or the name of a set
    return networks


def _ports(right: typing.Any) -> typing.List[int]:
    if isinstance(right, int):
        return [right, right]
    if isinstance(right, dict) and "range" in right:
        return [int(number) for number in right["range"]]
    raise UnknownRule  # several of them


_INTERFACES: typing.Tuple[Words, ...] = tuple({"meta": {"key": key}} for key in ("iifname", "iif", "oifname", "oif"))
_LENGTHS: typing.Tuple[Words, ...] = ({"meta": {"key": "length"}}, {"payload": {"protocol": "ip", "field": "length"}})

_READERS: typing.Mapping[typing.Tuple[str, str], Reader] = {
    ("meta", "iifname"): _interface("incoming"),
    ("meta", "iif"): _interface("incoming"),
    ("meta", "oifname"): _interface("leaving"),
    ("meta", "oif"): _interface("leaving"),
    ("meta", "l4proto"): lambda right: {"protocol": _protocol(right)},
    ("meta", "protocol"): lambda right: {} if right == "ip" else {"protocol": _protocol(right)},
    ("ct", "state"): lambda right: {"state": _state(right)},
}
