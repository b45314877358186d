# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The kernel's settings in /proc/sys: reading, writing, refusals, and the keys that the kernel changes with a key."""

import errno
import os
import re
import typing

from ..._base import rights
from ..._base.plain_text import quote
from .boot import matches, name_of, normal

Values = typing.Dict[str, typing.Optional[str]]  # key -> value in normal form, None if there is no such key


class WantedValue(typing.NamedTuple):
    """A key and its wanted value, in normal form."""

    key: str
    value: str


class KeyState(typing.NamedTuple):
    """The value of a key, and the errno that prevents writing it (0 if the key can be written)."""

    value: typing.Optional[str]
    refusal: int


# The keys that the kernel changes with a key


def _opposite(value: str) -> str:
    return "1" if value == "0" else "0"


def _zero(value: str) -> str:
    return "0"


class KeyRule(typing.NamedTuple):
    """A rule of the kernel: a write to one key changes other keys too."""

    key: str  # a pattern of keys
    others: str  # a pattern of those that change; `{}` is the last level of the key
    value: typing.Callable[[str], str] = str  # their value, from that of the key
    spares: bool = False  # keys with another value than this key keep it
    but: typing.Tuple[str, ...] = ()  # interfaces that do not change
    unless: typing.Tuple[str, ...] = ()  # last levels of keys that change nothing

    def changes(self, other: str) -> bool:
        """True if the kernel changes this key, in a rule for one key."""
        return matches(self.others, other) and not any(level in self.but for level in other.split("/"))


# Entries whose default is not copied (DEVINET_SYSCTL_FLUSHING_ENTRY and forwarding in net/ipv4/devinet.c).
_NOT_COPIED = (
    ("forwarding", "mc_forwarding", "disable_policy", "disable_xfrm", "promote_secondaries", "route_localnet")
    + ("drop_unicast_in_l2_multicast",)
)  # fmt: skip
_IPV4_FORWARDING = ("net/ipv4/ip_forward", "net/ipv4/conf/all/forwarding")
RULES: typing.Tuple[KeyRule, ...] = (
    # inet_forward_change() in net/ipv4/devinet.c
    *(
        KeyRule(key, other)
        for key in _IPV4_FORWARDING
        for other in ("net/ipv4/ip_forward", "net/ipv4/conf/*/forwarding")
    ),
    *(KeyRule(key, "net/ipv4/conf/all/accept_redirects", _opposite) for key in _IPV4_FORWARDING),
    # devinet_copy_dflt_conf() there, neigh_copy_dflt_parms() in net/core/neighbour.c
    KeyRule("net/ipv4/conf/default/*", "net/ipv4/conf/*/{}", spares=True, but=("all",), unless=_NOT_COPIED),
    KeyRule("net/ipv4/neigh/default/*", "net/ipv4/neigh/*/{}", spares=True),
    KeyRule("net/ipv6/neigh/default/*", "net/ipv6/neigh/*/{}", spares=True),
    # net/ipv6/addrconf.c; nothing else of `all` is copied, and no default
    KeyRule("net/ipv6/conf/all/forwarding", "net/ipv6/conf/*/forwarding"),
    KeyRule("net/ipv6/conf/all/disable_ipv6", "net/ipv6/conf/*/disable_ipv6"),
    KeyRule("net/ipv6/conf/all/addr_gen_mode", "net/ipv6/conf/*/addr_gen_mode"),
    KeyRule("net/ipv6/conf/all/ignore_routes_with_linkdown", "net/ipv6/conf/*/ignore_routes_with_linkdown"),
    KeyRule("net/ipv6/conf/all/force_forwarding", "net/ipv6/conf/*/force_forwarding", but=("default",)),
    # mm/page-writeback.c, mm/util.c: of two ways to say one limit, the one that is not used is 0
    KeyRule("vm/dirty_bytes", "vm/dirty_ratio", _zero),
    KeyRule("vm/dirty_ratio", "vm/dirty_bytes", _zero),
    KeyRule("vm/dirty_background_bytes", "vm/dirty_background_ratio", _zero),
    KeyRule("vm/dirty_background_ratio", "vm/dirty_background_bytes", _zero),
    KeyRule("vm/overcommit_kbytes", "vm/overcommit_ratio", _zero),
    KeyRule("vm/overcommit_ratio", "vm/overcommit_kbytes", _zero),
)


def rules_of(key: str) -> typing.List[KeyRule]:
    """The rules only for this key."""
    last = key.rpartition("/")[2]
    return [
        rule._replace(key=key, others=rule.others.format(last))
        for rule in RULES
        if matches(rule.key, key) and last not in rule.unless
    ]


def followers(key: str, value: str, keys: typing.Iterable[str]) -> typing.Dict[str, str]:
    """The keys, among `keys`, that the kernel can set with this key, with their values if they follow this value."""
    rules, values = rules_of(key), {}
    for other in keys if rules else ():
        for rule in rules:
            if other != key and rule.changes(other):
                values[other] = rule.value(value)
    return values


def keeps_deviations(key: str) -> bool:
    """True if other keys that have a value of their own keep it when this key changes."""
    return any(rule.spares for rule in rules_of(key))


def find_side_effects(key: str, value: str, values: typing.Mapping[str, str]) -> typing.Dict[str, str]:
    """The other keys that the kernel sets when this key gets this value, with their new values.

    A key with the same value counts as a follower, even if a person has set it.
    """
    changes = followers(key, value, values)
    if keeps_deviations(key):
        before = followers(key, values[key], changes)
        changes = {other: new for other, new in changes.items() if values[other] == before[other]}
    return changes


def changes_others_first(keys: typing.Iterable[str]) -> typing.List[str]:
    """The keys in the order in which they are written: those that change others come first, else as given."""
    return sorted(keys, key=lambda key: not rules_of(key))


# Values that the kernel is known to refuse

_WHOLE = re.compile(r"0|-?[1-9][0-9]{0,9}")
_WHOLE_NUMBERS = ("net/ipv4/ip_forward", "net/ipv[46]/conf/*/*", "net/ipv[46]/neigh/*/*", "net/ipv4/icmp_echo_*")


def is_unfit(setting: WantedValue) -> bool:
    """True for a value that no kernel takes and reads back: a key that holds a whole number gets something else."""
    if setting.key.endswith("/stable_secret") or not any(matches(one, setting.key) for one in _WHOLE_NUMBERS):
        return False
    return not _WHOLE.fullmatch(setting.value)


# Refusals

_STATES = {
    errno.ENOENT: "missing",
    errno.ENOTDIR: "missing",
    errno.EISDIR: "missing",
    errno.EROFS: "read_only",
    errno.EACCES: "denied",
    errno.EPERM: "denied",
}
_SENTENCES = {
    "missing": "{name}: this kernel has no {path}, expected to set {wanted} there: load the kernel module or bring up the "
    "interface that brings it, or take it off the settings.",
    "read_only": "{name}: {path} is on a read-only mount, as in a container without the right, and holds {found}, "
    "expected {wanted}: set it at the start of the container, or give the container a writable /proc/sys.",
    "denied": "{name}: user {user} may not change {path} ({reason}), which holds {found}, expected {wanted}: "
    "run as root (become: true), in a container with the capability for it.",
    "denied without a capability": "{name}: root may not change {path} here ({reason}), since this process is without {capability}, as in "
    "a container; it holds {found}, expected {wanted}: give it that, or set the value at the start of the container.",
    "denied to root": "{name}: not even root may change {path} ({reason}), which holds {found}, expected {wanted}: "
    "take it off the settings, or give the container the capability for it.",
    "invalid": "{name}: the kernel refuses the value {wanted} ({reason}) and keeps {found}: "
    "give a value that it accepts.",
    "changed": "{name}: the kernel was given {wanted} and holds {found}, expected the same: write the value as the kernel says it.",
}


# The kernel


PROC = "/proc/sys"
# Root can open them for writing, and the write needs CAP_NET_ADMIN (net/ipv4/devinet.c).
_FOR_NET_ADMIN = ("net/ipv4/ip_forward", "net/ipv4/conf/*/forwarding")


class Kernel:
    """The kernel's settings, read and written through the folder /proc/sys."""

    def __init__(self, proc: str = PROC) -> None:
        self.proc = proc

    def path(self, key: str) -> str:
        """The file of a key."""
        return os.path.join(self.proc, key)

    def read(self, key: str) -> str:
        """The current value in normal form. Raises OSError."""
        with open(self.path(key), "rb") as stream:
            return normal(stream.read().decode("utf-8", "surrogateescape"))

    def write(self, key: str, value: str) -> None:
        """Set a value. Raises OSError with the errno of the kernel."""
        descriptor = os.open(self.path(key), os.O_WRONLY | os.O_TRUNC)
        try:
            os.write(descriptor, value.encode("utf-8", "surrogateescape") + b"\n")
        finally:
            os.close(descriptor)

    def look(self, key: str) -> KeyState:
        """The value, and whether it can be written: the file is opened for writing, which changes nothing."""
        value = None
        try:
            value = self.read(key)
            os.close(os.open(self.path(key), os.O_WRONLY))
        except OSError as problem:
            return KeyState(value, problem.errno or errno.EIO)
        guarded = self.proc == PROC and any(matches(one, key) for one in _FOR_NET_ADMIN)
        return KeyState(value, errno.EPERM if guarded and not rights.may_change_network() else 0)

    def refusal(self, setting: WantedValue, value: typing.Optional[str], number: int) -> typing.Tuple[str, str]:
        """The state and the sentence for a setting that the kernel refuses with this errno, or (0) turns into another value.

        `value`: the present one, None for no key.
        """
        state = _STATES.get(number, "invalid")
        if state == "missing" and value is not None:
            state = "invalid"  # the key is there, and the kernel knows nothing of the name that the value is
        capability = "the capability NET_ADMIN" if setting.key.startswith("net/") else "some capabilities of root"
        kind = state if number else "changed"
        if state == "denied" and os.geteuid() == 0:
            all_there = rights.may_change_network() if setting.key.startswith("net/") else rights.has_all_rights()
            kind = "denied to root" if all_there else "denied without a capability"
        return state, _SENTENCES[kind].format(
            name=name_of(setting.key),
            path=self.path(setting.key),
            wanted=setting.value,
            found="nothing that can be read" if value is None else quote(value),
            reason=os.strerror(number),
            user=os.geteuid(),
            capability=capability,
        )

    def keys(self, pattern: str) -> typing.List[str]:
        """The keys of this kernel that a pattern matches; `*` matches one whole level."""
        folder, star, rest = pattern.partition("/*/")
        if not star:
            return [pattern]
        try:
            return [f"{folder}/{name}/{rest}" for name in sorted(os.listdir(self.path(folder)))]
        except OSError:
            return []

    def read_with_others(self, keys: typing.Iterable[str]) -> typing.Dict[str, KeyState]:
        """The values of these keys, and of the keys that the kernel changes with them."""
        rules = [rule for key in keys for rule in rules_of(key)]
        others = [other for rule in rules for other in self.keys(rule.others) if rule.changes(other)]
        return {key: self.look(key) for key in dict.fromkeys([*keys, *others])}

    def settle(self, goals: typing.Mapping[str, str]) -> typing.Dict[str, int]:
        """Bring these keys to these values, and write only those that differ; returns the errno for each key that stays otherwise.

        The kernel refuses some values as long as another key has its old one, and some writes change other keys too. So the
        writes are repeated as long as fewer keys are wrong each time.
        """
        wrong, problems = self._wrong(goals), dict.fromkeys(goals, 0)
        while wrong:
            for key in wrong:
                try:
                    if self.read(key) != goals[key]:
                        self.write(key, goals[key])
                except OSError as problem:
                    problems[key] = problem.errno or errno.EIO
            rest = self._wrong(goals)
            if len(rest) >= len(wrong):
                return {key: problems[key] for key in rest}
            wrong = rest
        return {}

    def _wrong(self, goals: typing.Mapping[str, str]) -> typing.List[str]:
        return [key for key in goals if self.look(key).value != goals[key]]

    def restore(self, values: Values) -> typing.List[str]:
        """Restore these values; returns a text for each that could not be restored."""
        goals = {key: value for key in changes_others_first(values) for value in [values[key]] if value is not None}
        return [
            f"{self.path(key)} ({os.strerror(number) if number else 'it holds another value than ' + quote(goals[key])})"
            for key, number in self.settle(goals).items()
        ]
