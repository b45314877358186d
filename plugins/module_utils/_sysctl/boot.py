# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Which file decides a kernel setting at boot: every place that sets it, in the order in which they run.

Reads only. A key is written here as its path below /proc/sys (net/ipv4/ip_forward), which is its identity;
people and drop-ins see its name (net.ipv4.ip_forward).
"""

import collections
import errno
import fnmatch
import json
import os
import re
import shlex
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.atomic import read_bytes
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem

# In the order of precedence: a file hides those of the same name in later folders (sysctl.d(5)).
SYSCTL_FOLDERS = ("/etc/sysctl.d", "/run/sysctl.d", "/usr/local/lib/sysctl.d", "/usr/lib/sysctl.d", "/lib/sysctl.d")
_SYSTEMD_FOLDERS = ("/etc/systemd", "/run/systemd", "/usr/local/lib/systemd", "/usr/lib/systemd", "/lib/systemd")
_NETWORK_FOLDERS = tuple(folder + "/network" for folder in _SYSTEMD_FOLDERS)
_NETWORKD_FOLDERS = tuple(folder + "/networkd.conf.d" for folder in _SYSTEMD_FOLDERS)
_UNIT_FOLDERS = (
    "/etc/systemd/system",
    "/run/systemd/system",
    "/run/systemd/generator",
    "/run/systemd/generator.late",
    "/usr/lib/systemd/system",
    "/lib/systemd/system",
)

# Two names of one variable of the kernel (net/ipv4/devinet.c: ip_forward is the `forwarding` of `all`).
_OTHER_NAME = {"net/ipv4/conf/all/forwarding": "net/ipv4/ip_forward"}

_YES = ("1", "yes", "y", "true", "t", "on")
_NO = ("0", "no", "n", "false", "f", "off")


class Assignment(typing.NamedTuple):
    """A place that sets a key, or (value None) that keeps patterns from setting it."""

    key: str
    value: typing.Optional[str]
    file: str
    line: int


# Names and values


def key_of(name: str) -> str:
    """The identity of a setting. The first separator decides what `/` and `.` mean (sysctl.d(5)):
    `net.ipv4.conf.eth0/100.rp_filter` and `net/ipv4/conf/eth0.100/rp_filter` are one key."""
    separator = re.search(r"[/.]", name)
    if separator and separator.group() == ".":
        name = name.translate({ord("."): "/", ord("/"): "."})
    return "/".join(part for part in name.split("/") if part)


def name_of(key: str) -> str:
    """The name of a key as people write it: `net.ipv4.ip_forward`."""
    return key.translate({ord("."): "/", ord("/"): "."})


def variable_of(key: str) -> str:
    """The key under which the kernel's variable is known here, where it has two names."""
    return _OTHER_NAME.get(key, key)


def normal(value: str) -> str:
    """A value as it is compared: the kernel separates several numbers by tabs, people by spaces."""
    return " ".join(value.split())


def matches(pattern: str, key: str) -> bool:
    """Whether a pattern of a file means a key; `*` stays within one level (glob(7))."""
    patterns, parts = pattern.split("/"), key.split("/")
    return len(patterns) == len(parts) and all(map(fnmatch.fnmatchcase, parts, patterns))


def parse(text: str, file: str) -> typing.List[Assignment]:
    """The assignments of a file in the format of sysctl.d(5); lines that are none are left out, as at boot."""
    found = []
    for number, line in enumerate(text.split("\n"), 1):
        line = line.strip()
        if not line or line[0] in "#;":
            continue
        name, equals, value = line.partition("=")
        optional = name.startswith("-")
        if equals or optional:
            key = key_of(name[optional:].strip())
            found.append(Assignment(key, value.strip() if equals else None, file, number))
    return found


def last_write(assignments: typing.Iterable[Assignment], names: typing.Collection[str]) -> typing.Optional[Assignment]:
    """Which of the assignments that are read together decides a variable with these names. Where nothing sets it, but
    a line keeps patterns (and earlier lines) from doing so, it is that line.

    As systemd-sysctl does it: a later assignment replaces an earlier one of the same key and is then applied later,
    unless it says the same; patterns leave out every key that is named itself.
    """
    options: typing.Dict[str, Assignment] = collections.OrderedDict()
    for assignment in assignments:
        earlier = options.get(assignment.key)
        if earlier is None or earlier.value != assignment.value:
            options.pop(assignment.key, None)
            options[assignment.key] = assignment

    def sets(option: Assignment, key: str) -> bool:
        return option.key == key or (key not in options and matches(option.key, key))

    deciding = [option for option in options.values() if any(sets(option, key) for key in names)]
    deciding.sort(key=lambda option: option.value is not None)
    return deciding[-1] if deciding else None


# Files


class Tree:
    """The configuration files below a root folder, as they will be: with the planned files in place."""

    def __init__(
        self, root: str = "/", planned: typing.Optional[typing.Mapping[str, typing.Optional[str]]] = None
    ) -> None:
        self.root = root
        self.planned = planned or {}

    def real(self, path: str) -> str:
        """Where a path lies on this machine; links lead to where they will lead when the root is `/`."""
        here, parts, links = self.root, path.split("/"), 0
        while parts:
            part = parts.pop(0)
            there = os.path.join(here, part)
            if part in ("", "."):
                continue
            if part == "..":
                here = here if here == self.root else os.path.dirname(here)
            elif os.path.islink(there) and links < 40:
                links += 1
                target = os.readlink(there)
                here = self.root if target.startswith("/") else here
                parts = target.split("/") + parts
            else:
                here = there
        return here

    def read(self, path: str) -> str:
        """The text of a file; nothing where there is none, as for a link to /dev/null. Raises Problem."""
        if path in self.planned:
            return self.planned[path] or ""
        try:
            return (read_bytes(self.real(path)) or b"").decode("utf-8", "surrogateescape")
        except OSError as problem:
            if problem.errno in (errno.EISDIR, errno.ELOOP):
                return ""
            raise Problem(
                "The file %s cannot be read (%s); expected to see everything that sets kernel settings at boot: "
                "run as root (become: true)." % (path, problem.strerror)
            ) from problem

    def names(self, folder: str) -> typing.Set[str]:
        """The names in a folder."""
        try:
            found = set(os.listdir(self.real(folder)))
        except OSError:
            found = set()
        for path, content in self.planned.items():
            if os.path.dirname(path) == folder:
                (found.discard if content is None else found.add)(os.path.basename(path))
        return found

    def exists(self, path: str) -> bool:
        """Whether there is a file or folder."""
        return os.path.exists(self.real(path))

    def is_masked(self, unit: str) -> bool:
        """Whether systemd never starts a unit: an empty file or a link to /dev/null takes its place."""
        return any(
            unit in self.names(folder) and not self.read("%s/%s" % (folder, unit)) for folder in _UNIT_FOLDERS[:2]
        )

    def enabled_by(self, unit: str) -> typing.Optional[str]:
        """The link by which a unit starts at boot, or None."""
        for folder in _UNIT_FOLDERS:
            for wants in sorted(name for name in self.names(folder) if name.endswith((".wants", ".requires"))):
                if unit in self.names("%s/%s" % (folder, wants)) and not self.is_masked(unit):
                    return "%s/%s/%s" % (folder, wants, unit)
        return None


def configuration_files(tree: Tree, folders: typing.Iterable[str], suffix: str = ".conf") -> typing.List[str]:
    """The files that are read from a list of folders: per name the one of the first folder, sorted by name."""
    chosen: typing.Dict[str, str] = {}
    for folder in folders:
        for name in tree.names(folder):
            if name.endswith(suffix) and not name.startswith("."):
                chosen.setdefault(name, "%s/%s" % (folder, name))
    return [chosen[name] for name in sorted(chosen, key=os.fsencode)]


def hidden_by(tree: Tree, drop_in: str) -> typing.Optional[str]:
    """What keeps the drop-in from being read at all: a file of its name in an earlier folder, or the masked service."""
    if boots_with_systemd(tree) and tree.is_masked("systemd-sysctl.service"):
        return "/etc/systemd/system/systemd-sysctl.service"
    name = os.path.basename(drop_in)
    for path in configuration_files(tree, SYSCTL_FOLDERS):
        if os.path.basename(path) == name and tree.real(path) != tree.real(drop_in):
            return path
    return None


# Who sets kernel settings at boot


def boots_with_systemd(tree: Tree) -> bool:
    """Whether systemd-sysctl applies the settings: systemd runs (sd_booted(3)), or it is what the image will start."""
    if tree.exists("/run/systemd/system"):
        return True
    return os.path.basename(tree.real("/sbin/init")) == "systemd"


def sysctl_d(tree: Tree) -> typing.List[Assignment]:
    """systemd-sysctl.service(8), or `sysctl --system` of procps, which alone reads /etc/sysctl.conf by itself."""
    files = configuration_files(tree, SYSCTL_FOLDERS)
    if not boots_with_systemd(tree):
        files.append("/etc/sysctl.conf")
    elif tree.is_masked("systemd-sysctl.service"):
        files = []
    return [assignment for path in files for assignment in parse(tree.read(path), path)]


def ufw(tree: Tree) -> typing.List[Assignment]:
    """ufw's own file: ufw-init runs `sysctl -e -q -p $IPT_SYSCTL` when it starts (ufw-init-functions)."""
    if _shell_variable(tree.read("/etc/ufw/ufw.conf"), "ENABLED").lower() != "yes":
        return []
    path = _shell_variable(tree.read("/etc/default/ufw"), "IPT_SYSCTL")
    return parse(tree.read(path), path) if path else []


def networkd(tree: Tree) -> typing.List[Assignment]:
    """systemd-networkd: IPForward= of a *.network file turns forwarding on and never off (systemd.network(5), up to
    systemd 255); IPv4Forwarding= and IPv6Forwarding= of networkd.conf set it both ways (networkd.conf(5), from 256)."""
    if not tree.enabled_by("systemd-networkd.service"):
        return []
    found = []
    for file in configuration_files(tree, _NETWORK_FOLDERS, ".network"):
        value, path, line = _ini(tree, _with_drop_ins(tree, file), "IPForward")
        for family, key in (("ipv4", "net/ipv4/ip_forward"), ("ipv6", "net/ipv6/conf/all/forwarding")):
            if value in _YES or value == family:
                found.append(Assignment(key, "1", path, line))
    mains = [path for path in (folder + "/networkd.conf" for folder in _SYSTEMD_FOLDERS) if tree.exists(path)]
    for option, family in (("IPv4Forwarding", "ipv4"), ("IPv6Forwarding", "ipv6")):
        value, path, line = _ini(tree, mains[:1] + configuration_files(tree, _NETWORKD_FOLDERS), option)
        if value in _YES + _NO:
            for which in ("default", "all"):
                key = "net/%s/conf/%s/forwarding" % (family, which)
                found.append(Assignment(key, "1" if value in _YES else "0", path, line))
    return found


def docker(tree: Tree) -> typing.List[Assignment]:
    """dockerd turns forwarding on unless its `ip-forward` is false (dockerd(8))."""
    unit = tree.enabled_by("docker.service") or tree.enabled_by("docker.socket")
    if not unit:
        return []
    text = tree.read("/etc/docker/daemon.json")
    try:
        options = json.loads(text or "{}")
    except ValueError:
        return []  # dockerd does not start with such a file
    if isinstance(options, dict) and options.get("ip-forward") is False:
        return []
    return [Assignment("net/ipv4/ip_forward", "1", "/etc/docker/daemon.json" if text else unit, 0)]


# In the order in which they run; each reads its files together.
READERS = (sysctl_d, ufw, networkd, docker)


def at_boot(tree: Tree, keys: typing.Iterable[str]) -> typing.Dict[str, typing.Optional[Assignment]]:
    """Per key the assignment that decides it at boot (its value is None where it excludes the key), or None."""
    keys = list(keys)
    decides: typing.Dict[str, typing.Optional[Assignment]] = dict.fromkeys(keys)
    for reader in READERS:
        assignments = reader(tree)
        for key in keys:
            names = {key, variable_of(key)} | {other for other, one in _OTHER_NAME.items() if one == variable_of(key)}
            found = last_write(assignments, names)
            if found and (found.value is not None or decides[key] is None):
                decides[key] = found
    return decides


def _shell_variable(text: str, name: str) -> str:
    """The value of a variable in a file that a shell reads, empty where it is not set."""
    value = ""
    for found in re.finditer(r"(?m)^[ \t]*(?:export[ \t]+)?%s=(.*)$" % re.escape(name), text):
        try:
            value = (shlex.split(found.group(1), comments=True) or [""])[0]
        except ValueError:
            value = ""
    return value


def _with_drop_ins(tree: Tree, file: str) -> typing.List[str]:
    """A file of networkd and the drop-ins in its NAME.network.d folders, which are read after it."""
    folders = ["%s/%s.d" % (folder, os.path.basename(file)) for folder in _NETWORK_FOLDERS]
    return [file] + configuration_files(tree, folders)


def _ini(tree: Tree, files: typing.Iterable[str], option: str) -> typing.Tuple[str, str, int]:
    """The last value of an option of the section [Network] (in small letters), its file and its line."""
    decides = ("", "", 0)
    for path in files:
        section = ""
        for number, line in enumerate(tree.read(path).split("\n"), 1):
            line = line.strip()
            if line.startswith("["):
                section = line
            name, equals, value = line.partition("=")
            if section == "[Network]" and equals and name.strip() == option:
                decides = (value.strip().lower(), path, number)
    return decides
