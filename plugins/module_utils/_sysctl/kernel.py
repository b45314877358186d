# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The kernel's settings in /proc/sys: reading, writing, refusals, and the keys that the kernel changes beside a key."""

import errno
import os
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._sysctl.boot import matches, name_of, normal

Values = typing.Dict[str, typing.Optional[str]]  # key -> value in normal form, None where there is no such key


class Setting(typing.NamedTuple):
    """A key and its wanted value, in normal form."""

    key: str
    value: str


class Found(typing.NamedTuple):
    """The value of a key, and the errno that prevents writing it (0 for none)."""

    value: typing.Optional[str]
    refusal: int


# The keys that the kernel changes beside a key


def _same(value: str) -> str:
    return value


def _opposite(value: str) -> str:
    return "1" if value == "0" else "0"


Rule = typing.Tuple[str, typing.Callable[[str], str]]  # pattern of keys, their value from the value of the key

# inet_forward_change() in net/ipv4/devinet.c, addrconf_fixup_forwarding() in net/ipv6/addrconf.c
_IPV4_FORWARDING: typing.Tuple[Rule, ...] = (
    ("net/ipv4/ip_forward", _same),
    ("net/ipv4/conf/*/forwarding", _same),
    ("net/ipv4/conf/all/accept_redirects", _opposite),
)
BESIDE: typing.Dict[str, typing.Tuple[Rule, ...]] = {
    "net/ipv4/ip_forward": _IPV4_FORWARDING,
    "net/ipv4/conf/all/forwarding": _IPV4_FORWARDING,
    "net/ipv6/conf/all/forwarding": (("net/ipv6/conf/*/forwarding", _same),),
}


def beside(key: str, value: str, keys: typing.Iterable[str]) -> typing.Dict[str, str]:
    """The other keys, among `keys`, that the kernel sets when this key gets this value, with their new values."""
    return {
        other: rule(value)
        for pattern, rule in BESIDE.get(key, ())
        for other in keys
        if other != key and matches(pattern, other)
    }


def changes_others_first(keys: typing.Iterable[str]) -> typing.List[str]:
    """The keys in the order in which they are written: those that change others come first."""
    return sorted(keys, key=lambda key: (key not in BESIDE, key))


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
    "expected {wanted}: set it where the container is started, or give the container a writable /proc/sys.",
    "denied": "{name}: user {user} may not change {path} ({reason}), which holds {found}, expected {wanted}: "
    "run as root (become: true), in a container with the capability for it.",
    "invalid": "{name}: the kernel refuses the value {wanted} ({reason}) and keeps {found}: "
    "give a value that it accepts.",
}


def refusal(path: str, setting: Setting, found: typing.Optional[str], number: int) -> typing.Tuple[str, str]:
    """The state and the sentence for a setting that the kernel refuses with this errno."""
    state = _STATES.get(number, "invalid")
    return state, _SENTENCES[state].format(
        name=name_of(setting.key),
        path=path,
        wanted=setting.value,
        found="nothing that can be read" if found is None else found,
        reason=os.strerror(number),
        user=os.geteuid(),
    )


# The kernel


class Kernel:
    """The kernel's settings, read and written through the folder /proc/sys."""

    def __init__(self, proc: str = "/proc/sys") -> None:
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

    def look(self, key: str) -> Found:
        """The value, and whether it can be written: the file is opened for writing, which changes nothing."""
        value = None
        try:
            value = self.read(key)
            os.close(os.open(self.path(key), os.O_WRONLY))
        except OSError as problem:
            return Found(value, problem.errno or errno.EIO)
        return Found(value, 0)

    def keys(self, pattern: str) -> typing.List[str]:
        """The keys of this kernel that a pattern matches; `*` stands for one whole level."""
        folder, star, rest = pattern.partition("/*/")
        if not star:
            return [pattern]
        try:
            return [f"{folder}/{name}/{rest}" for name in sorted(os.listdir(self.path(folder)))]
        except OSError:
            return []

    def current(self, keys: typing.Iterable[str]) -> typing.Dict[str, Found]:
        """The values of these keys, and of the keys that the kernel changes beside them."""
        patterns = [pattern for key in keys for pattern, rule in BESIDE.get(key, ())]
        others = [other for pattern in patterns for other in self.keys(pattern)]
        found = {key: self.look(key) for key in keys}
        found.update((key, self.look(key)) for key in others if key not in found)
        return found

    def restore(self, values: Values) -> None:
        """Restore these values. Raises OSError."""
        for key in changes_others_first(values):
            value = values[key]
            if value is not None and self.read(key) != value:
                self.write(key, value)
