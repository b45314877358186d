# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The addresses, routes, rules and the packet filter of this computer before and after a change, of whomever they are.

A change makes programs read their files again, and they may drop foreign items. So a sentence such as "as it was before"
follows a comparison: items that are gone and were not to go are put back, and those that cannot be put back are listed.

Left out are items that come back by themselves: those of the kernel for an address, and those of DHCP and router advertisements.
Missing rules of the packet filter are only listed: the place of a rule among others counts, and is not known afterwards.
"""

import json
import re
import shutil
import typing

from ...._base import commands
from ...._base.plain_text import LINE, quote
from ...._machine.filters import list_written_rules
from ..transaction import Sentence, Step, Unseen

KINDS = ("address", "route", "rule", "filter")  # in the order in which they are put back: each needs the ones before
_RETURNING = ("kernel", "redirect", "ra", "dhcp")
_DAEMONS = ("babel", "bgp", "bird", "eigrp", "gated", "isis", "mrt", "openr", "ospf", "rip", "zebra")
_PROTOCOL = re.compile(r" proto (\S+)")
_BY_HAND = ("boot", "static")  # the protocols that are looked at if there are too many routes for all
_IN_PART = "{} in part"
_LIMIT = 10.0  # seconds; 100,000 routes take half of one
MOST = 20000  # routes of one version, those of routing daemons last; more of them are not compared
_MOST_SAID = 10
# Marks of `ip` behind a route or a rule that are no words of it, and the time that is left of it.
_MARKS = re.compile(
    r" (?:linkdown|dead|pervasive|offload|offload_failed|trap|rt_offload|rt_trap|rt_offload_failed|notify|unresolved"
    r"|error -?\d+|expires -?\d+sec|\[detached\]|\[unresolved\])(?= |$)"
)
# Tables that firewalld makes anew from its files, ufw from its own, and tables of ours.
_MANAGED = re.compile(r"inet rosfleet_\w+ |(?:inet|ip6?) firewalld(?:_\w+)? |ip6? filter ufw6?-user-")
_NOUNS = {"filter": "part of the packet filter"}
_WITHOUT_INPUT = {"[l3mdev-table]": "l3mdev"}


class NetworkItem(typing.NamedTuple):
    """An address, a route or a rule; or a rule of the packet filter, or a chain of it that drops by default."""

    kind: str  # of KINDS
    version: int  # of IP; 0 for both
    text: str  # the words behind `ip -VERSION KIND add`, or `nft add`

    @property
    def device(self) -> str:
        """The interface that it needs, "" if it needs no interface, or several. A rule stays without its interface."""
        words = self.text.split()
        return words[words.index("dev") + 1] if self.kind in ("address", "route") and words.count("dev") == 1 else ""

    @property
    def key(self) -> typing.Tuple[str, ...]:
        """The words by which the kernel identifies it: of a route the destination, with its kind, table and metric."""
        if self.kind != "route":
            return (self.text,)
        words = self.text.split()
        return tuple(words[:2]) + tuple(find_word(words, name) for name in ("tos", "table", "metric"))

    @property
    def command(self) -> str:
        """The command that makes it again."""
        return f"nft add {self.text}" if self.kind == "filter" else f"ip -{self.version} {self.kind} add {self.text}"


def find_word(words: typing.Sequence[str], name: str) -> str:
    """The word that follows `name`, "" if the words do not have it."""
    return words[words.index(name) + 1] if name in words[:-1] else ""


class Snapshot(typing.NamedTuple):
    """The network state of this computer at one moment."""

    items: typing.List[NetworkItem]
    links: typing.List[str]  # the names of the interfaces
    unseen: typing.Dict[str, str]  # a sentence for each part that could not be looked at, such as "route 4"
    filtered: bool = False  # the packet filter was looked at, too

    def to_json(self) -> typing.Dict[str, typing.Any]:
        """The snapshot as plain data."""
        return dict(self._asdict(), items=[list(item) for item in self.items])


def from_json(data: typing.Mapping[str, typing.Any]) -> Snapshot:
    """The snapshot in plain data of `to_json`."""
    return Snapshot([NetworkItem(*item) for item in data["items"]], data["links"], data["unseen"], data["filtered"])


# Reading


def read(most: typing.Optional[int] = None, filtered: bool = False) -> Snapshot:
    """Read this computer's network state, of it at most so many routes of each version, and the packet filter if asked for."""
    snapshot = Snapshot([], [], {}, filtered)
    text = _ask(snapshot, "address 4", "The addresses", ["ip", "-json", "address"])
    try:
        links, items = parse_addresses(json.loads(text or "[]"))
        snapshot.links.extend(links)
        snapshot.items.extend(items)
    except (ValueError, KeyError, TypeError):  # versions of ip write the details of some links as broken JSON
        snapshot.unseen["address 4"] = "The addresses could not be looked at (no JSON of ip)."
    for version in (4, 6):
        routes = _read_routes(snapshot, version)
        if most is not None and len(routes) > most:
            snapshot.unseen[f"{version} over {most}"] = (
                f"Of {len(routes)} routes of IPv{version}, {most} were looked at."
            )
        snapshot.items.extend(routes[:most])
        rules = _ask(snapshot, f"rule {version}", f"The rules of IPv{version}", ["ip", f"-{version}", "rule", "show"])
        snapshot.items.extend(parse_rules(rules.split("\n"), version))
    if filtered and shutil.which("nft", path=commands.BASE_PATH):
        text = _ask(snapshot, "filter 0", "The packet filter", ["nft", "-s", "list", "ruleset"])
        if len(text) >= commands.MOST:
            snapshot.unseen["filter 0"] = "The packet filter could not be looked at, since it has too many rules."
        snapshot.items.extend(parse_filter(text.split("\n")))
    return snapshot


def _read_routes(snapshot: Snapshot, version: int) -> typing.List[NetworkItem]:
    show = ["ip", "-oneline", "-details", f"-{version}", "route", "show", "table", "all"]
    part, what = f"route {version}", f"The routes of IPv{version}"
    text = _ask(snapshot, part, what, show)
    if len(text) >= commands.MOST:
        # A protocol that is asked for is not repeated: it comes before the scope.
        texts = ((protocol, _ask(snapshot, part, what, [*show, "proto", protocol])) for protocol in _BY_HAND)
        text = "".join(re.sub("(?m)^(.*?)(?= scope )", rf"\1 proto {protocol}", lines) for protocol, lines in texts)
        snapshot.unseen[_IN_PART.format(version)] = (
            f"Of the routes of IPv{version}, which are many, those of the protocols {' and '.join(_BY_HAND)} were looked at."
        )
    return parse_routes(text.split("\n"), version)


def _ask(snapshot: Snapshot, part: str, what: str, words: typing.List[str]) -> str:
    """Return the output of a command, "" if it fails; the failure goes into the snapshot as a sentence."""
    answer = commands.run(words, limit=_LIMIT)
    if answer.status != 0 and "Address family not supported" not in answer.error:
        reason = quote(answer.last_error, LINE) or f"status {answer.status}"
        snapshot.unseen[part] = f"{what} could not be looked at ({reason})."
    return answer.text if answer.status == 0 else ""


def parse_addresses(links: typing.Any) -> typing.Tuple[typing.List[str], typing.List[NetworkItem]]:
    """The names of the interfaces and their addresses, without those with a lifetime, in the JSON of `ip address`."""
    links = [link for link in links if "ifname" in link]  # old versions leave empty objects
    items = []
    for link in links:
        for entry in link.get("addr_info", ()):
            if "local" not in entry or entry.get("dynamic") or entry.get("temporary"):
                continue
            items.append(_make_address(link["ifname"], entry))
    return [link["ifname"] for link in links], items


def _make_address(interface: str, entry: typing.Dict[str, typing.Any]) -> NetworkItem:
    """An address in the words of `ip address add`."""
    peer = ["peer", f"{entry['address']}/{entry['prefixlen']}"] if "address" in entry else []
    words = [entry["local"], *peer] if peer else [f"{entry['local']}/{entry['prefixlen']}"]
    words += ["brd", entry["broadcast"]] if "broadcast" in entry else []
    words += ["dev", interface, "scope", str(entry.get("scope", "global"))]
    words += ["label", entry["label"]] if entry.get("label", interface) != interface else []
    words += [flag for flag in ("home", "nodad", "mngtmpaddr", "noprefixroute") if entry.get(flag)]
    return NetworkItem("address", 6 if entry["family"] == "inet6" else 4, " ".join(words))


def parse_routes(lines: typing.Iterable[str], version: int) -> typing.List[NetworkItem]:
    """The routes in lines of `ip -oneline -details route show table all`; those of routing daemons come last."""
    own: typing.List[NetworkItem] = []
    of_daemons: typing.List[NetworkItem] = []
    for line in lines:
        match = _PROTOCOL.search(line)
        protocol = match.group(1) if match else ""
        if line.strip() and line[0] != "\t" and protocol not in _RETURNING:
            text = _MARKS.sub("", " ".join(line.replace("\\", " ").split()))
            (of_daemons if protocol in _DAEMONS else own).append(NetworkItem("route", version, text))
    return own + of_daemons


def parse_rules(lines: typing.Iterable[str], version: int) -> typing.List[NetworkItem]:
    """The rules in lines of `ip rule show`."""
    items = []
    for line in lines:
        priority, colon, words = line.partition(":")
        if colon and priority.strip().isdigit():
            text = _MARKS.sub("", " " + " ".join(words.split())).strip()
            for output, word in _WITHOUT_INPUT.items():
                text = text.replace(f"lookup {output}", word)
            items.append(NetworkItem("rule", version, f"{text} priority {priority.strip()}"))
    return items


def parse_filter(lines: typing.Iterable[str]) -> typing.List[NetworkItem]:
    """The foreign rules in lines of `nft -s list ruleset`, and the chains that drop by default; no elements of sets."""
    items = []
    for table, chain, text in list_written_rules(lines):
        place = f"{table} {chain}"
        if _MANAGED.match(place + " "):
            continue
        if not text.startswith("type "):
            items.append(NetworkItem("filter", 0, f"rule {place} {text}"))
        elif "policy drop" in text:
            items.append(NetworkItem("filter", 0, f"chain {place} {{ {text} }}"))
    return items


# Comparing


def find_missing(before: Snapshot, now: Snapshot) -> typing.List[NetworkItem]:
    """The items that were there before and are gone, in the order in which it is put back. Pure.

    Without items that went with their interface, and those that could not be looked at now.
    """
    there, devices = set(now.items), {"", *now.links}
    missing = [item for item in before.items if item not in there and item.device in devices and _is_seen(item, now)]
    # A network on a link comes before the routes whose gateway is in it.
    return sorted(missing, key=lambda item: (KINDS.index(item.kind), " via " in item.text or " nexthop " in item.text))


def _is_seen(item: NetworkItem, now: Snapshot) -> bool:
    """True if the kind of an item was looked at."""
    if item.kind == "route" and _IN_PART.format(item.version) in now.unseen:
        return find_word(item.text.split(), "proto") in _BY_HAND
    return f"{item.kind} {item.version}" not in now.unseen


def plan_batches(missing: typing.Iterable[NetworkItem], before: Snapshot) -> typing.Dict[typing.Tuple[str, int], str]:
    """The input of `ip -batch` that puts items back, by kind and version. Pure.

    An item never takes the place of another one. Of several routes with one key, each is added to the others.
    """
    numbers: typing.Dict[typing.Tuple[str, ...], int] = {}
    for item in before.items:
        key = (item.kind, str(item.version), *item.key)
        numbers[key] = numbers.get(key, 0) + 1
    batches: typing.Dict[typing.Tuple[str, int], str] = {}
    for item in missing:
        if item.kind == "filter":
            continue
        key = (item.kind, str(item.version), *item.key)
        several = item.kind == "route" and numbers[key] > 1
        line = f"{item.kind} {'append' if several else 'add'} {item.text}\n"
        batches[(item.kind, item.version)] = batches.get((item.kind, item.version), "") + line
    return batches


def list_sentences(left: typing.Sequence[NetworkItem]) -> typing.List[str]:
    """The sentences on items that could not be put back."""
    sentences: typing.List[str] = [
        Sentence(
            f"The {_NOUNS.get(item.kind, item.kind)} {quote(item.text, LINE)} was there before this change and is gone: "
            f"put it back by {quote(item.command, LINE)}."
        )
        for item in left[:_MOST_SAID]
    ]
    if len(left) > _MOST_SAID:
        sentences.append(Sentence(f"{len(left) - _MOST_SAID} more of them are gone."))
    return sentences


# The look


def put_back(
    before: Snapshot, planned: typing.Callable[[NetworkItem], bool]
) -> typing.Tuple[typing.List[NetworkItem], typing.List[str]]:
    """Compare with now, and put back the items that are gone and were not `planned` to go.

    Returns the items that were put back, and the sentences on those that are still gone or could not be looked at.
    """
    now = read(filtered=before.filtered)
    missing = [item for item in find_missing(before, now) if not planned(item)]
    left = missing
    if missing:
        for (_kind, version), lines in plan_batches(missing, before).items():
            commands.run(["ip", f"-{version}", "-force", "-batch", "-"], limit=_LIMIT, given=lines.encode("utf-8"))
        now = read(filtered=before.filtered)
        left = [item for item in find_missing(before, now) if not planned(item)]
    unseen = dict.fromkeys([*before.unseen.values(), *now.unseen.values()])
    return [item for item in missing if item not in left], [*list_sentences(left), *map(Unseen, unseen)]


class StateWatch:
    """The network state of before, over one change."""

    def __init__(
        self, planned: typing.Callable[[NetworkItem], bool] = lambda item: False, filtered: bool = False
    ) -> None:
        """`planned`: is it to go by the change? `filtered`: the packet filter counts, too."""
        self.planned, self.filtered = planned, filtered
        self.before: typing.Optional[Snapshot] = None

    def begin(self) -> Snapshot:
        """Look, once; returns the items that were there."""
        self.before = self.before or read(MOST, self.filtered)
        return self.before

    @property
    def step(self) -> Step:
        """The first step of a change: its undo comes last, and puts back items that were lost on the way."""
        return Step("the network", self.begin, self._undo)

    def _undo(self) -> typing.List[str]:
        return put_back(self.before, lambda item: False)[1] if self.before else []

    def finish(self) -> typing.List[str]:
        """The sentences after a change that was done: items that were put back, that are gone, or that could not be looked at."""
        if self.before is None:
            return []
        back, sentences = put_back(self.before, self.planned)
        texts = ", ".join(f"{item.kind} {quote(item.text, LINE)}" for item in back[:_MOST_SAID])
        more = f" and {len(back) - _MOST_SAID} more" if len(back) > _MOST_SAID else ""
        return (
            [f"Foreign routes, rules or addresses were gone after this change, and were put back: {texts}{more}."]
            if back
            else []
        ) + sentences
