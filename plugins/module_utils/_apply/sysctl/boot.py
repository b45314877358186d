# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The file that decides a kernel setting at boot, from all programs that set it, in the order in which they run.

This file only reads. A key is its path below /proc/sys (net/ipv4/ip_forward). Users and drop-ins see its name
(net.ipv4.ip_forward).
"""

import errno
import fnmatch
import json
import os
import re
import shlex
import typing

from ..._base.plain_text import quote
from ..._base.problem import Problem, remedy
from ..transaction.atomic import read_bytes

# In order of precedence: a file hides the files with the same name in later folders (sysctl.d(5)).
SYSCTL_FOLDERS = ("/etc/sysctl.d", "/run/sysctl.d", "/usr/local/lib/sysctl.d", "/usr/lib/sysctl.d", "/lib/sysctl.d")
_SYSTEMD_FOLDERS = ("/etc/systemd", "/run/systemd", "/usr/local/lib/systemd", "/usr/lib/systemd", "/lib/systemd")
_NETWORK_FOLDERS = tuple(folder + "/network" for folder in _SYSTEMD_FOLDERS)
_NETWORKD_FOLDERS = tuple(folder + "/networkd.conf.d" for folder in _SYSTEMD_FOLDERS)
_UNIT_FOLDERS = tuple(folder + "/system" for folder in _SYSTEMD_FOLDERS)
_GENERATED_FOLDERS = ("/run/systemd/generator", "/run/systemd/generator.late")

# Two names of one variable of the kernel (net/ipv4/devinet.c: ip_forward is the `forwarding` of `all`;
# net/netfilter/nf_conntrack_standalone.c).
_OTHER_NAME = {
    "net/ipv4/conf/all/forwarding": "net/ipv4/ip_forward",
    "net/nf_conntrack_max": "net/netfilter/nf_conntrack_max",
}

# systemd as the first process of a container writes its name there; the names are those of systemd-detect-virt(1).
_CONTAINER = "/run/systemd/container"
_CONTAINERS = (
    "container",
    "openvz",
    "lxc",
    "lxc-libvirt",
    "systemd-nspawn",
    "docker",
    "podman",
    "rkt",
    "wsl",
    "proot",
    "pouch",
)

_YES = ("1", "yes", "y", "true", "t", "on")
_NO = ("0", "no", "n", "false", "f", "off")


class Assignment(typing.NamedTuple):
    """A line of a file that sets a key."""

    key: str
    value: typing.Optional[str]  # None for a line that keeps patterns from setting the key
    file: str
    line: int  # 0 if the whole file decides


# Names and values


def key_of(name: str) -> str:
    """The key of a setting.

    The first separator decides the meaning of `/` and `.` (sysctl.d(5)): `net.ipv4.conf.eth0/100.rp_filter` and
    `net/ipv4/conf/eth0.100/rp_filter` are one key.
    """
    separator = re.search(r"[/.]", name)
    if separator and separator.group() == ".":
        name = name.translate({ord("."): "/", ord("/"): "."})
    return "/".join(part for part in name.split("/") if part)


def name_of(key: str) -> str:
    """The name of a key as users write it: `net.ipv4.ip_forward`."""
    return key.translate({ord("."): "/", ord("/"): "."})


def variable_of(key: str) -> str:
    """The key of the kernel's variable: one key for a variable that has two names."""
    return _OTHER_NAME.get(key, key)


def normal(value: str) -> str:
    """A value in normal form: the kernel separates several numbers by tabs, users by spaces."""
    return " ".join(value.split())


_WHOLE = re.compile(r"-?[0-9]+")
_BASES = (("0x", 16), ("0", 8))
_NUMBER = re.compile(r"-?(0[xX][0-9a-fA-F]{1,16}|0[0-7]{0,22}|[1-9][0-9]{0,19})")  # 64 bits at most


def read_value(text: str, like: str) -> str:
    """A value as the kernel reads it into a key that holds values such as `like`; normal form if it would refuse it.

    Of whole numbers it takes as many as the key has, each up to a blank, in base 8, 10 or 16 (proc_dointvec() in
    kernel/sysctl.c). So `1 # a remark` and `0x1` are 1, for sysctl(8) and systemd-sysctl alike: both write all of the line.
    """
    places, words = like.split(), text.split()
    numbers = words[: len(places)]
    if not places or len(words) < len(places) or not all(map(_WHOLE.fullmatch, places)):
        return normal(text)
    if not all(map(_NUMBER.fullmatch, numbers)):
        return normal(text)
    return " ".join(str(_read_number(word)) for word in numbers)


def _read_number(word: str) -> int:
    digits = word.lstrip("-").lower()
    base = next((base for start, base in _BASES if digits.startswith(start)), 10)
    return int(digits, base) * (-1 if word.startswith("-") else 1)


def matches(pattern: str, key: str) -> bool:
    """True if a pattern of a file matches a key; `*` stays within one level (glob(7))."""
    patterns, parts = pattern.split("/"), key.split("/")
    return len(patterns) == len(parts) and all(map(fnmatch.fnmatchcase, parts, patterns))


def parse(text: str, file: str) -> typing.List[Assignment]:
    """The assignments of a file in the format of sysctl.d(5). Other lines are left out, as at boot."""
    assignments = []
    for number, line in enumerate(text.split("\n"), 1):
        line = line.strip()
        if not line or line[0] in "#;":
            continue
        name, equals, value = line.partition("=")
        optional = name.startswith("-")
        if equals or optional:
            key = key_of(name[optional:].strip())
            assignments.append(Assignment(key, value.strip() if equals else None, file, number))
    return assignments


def last_write(assignments: typing.Iterable[Assignment], names: typing.Collection[str]) -> typing.Optional[Assignment]:
    """The assignment that decides a variable with these names, of all that are read together.

    If nothing sets the variable, it is the line that keeps patterns (and earlier lines) from setting it. The rules
    are those of systemd-sysctl: a later assignment replaces an earlier one of the same key and is then applied later,
    unless both have the same value. A pattern does not apply to a key that is listed itself.
    """
    options: typing.Dict[str, Assignment] = {}
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


class Tree(typing.NamedTuple):
    """The configuration files below a root folder, with the planned files in place."""

    root: str = "/"
    overlay: typing.Mapping[str, typing.Optional[str]] = {}  # the texts of planned files, None for no file

    def real(self, path: str) -> str:
        """The path on this machine. Links lead to where they will lead when the root is `/`."""
        here, parts, links = self.root, path.split("/"), 0
        while parts:
            part = parts.pop(0)
            path = os.path.join(here, part)
            if part in ("", "."):
                continue
            if part == "..":
                here = here if here == self.root else os.path.dirname(here)
            elif os.path.islink(path) and links < 40:
                links += 1
                target = os.readlink(path)
                here = self.root if target.startswith("/") else here
                parts = target.split("/") + parts
            else:
                here = path
        return here

    def read(self, path: str) -> str:
        """The text of a file; "" if the file is missing or empty, as a link to /dev/null is. Raises Problem."""
        if path in self.overlay:
            return self.overlay[path] or ""
        real = self.real(path)
        if real == os.path.join(self.root, "dev/null"):
            return ""
        try:
            return (read_bytes(real) or b"").decode("utf-8", "surrogateescape")
        except OSError as problem:
            if problem.errno in (errno.EISDIR, errno.ELOOP):
                return ""
            raise Problem(
                f"The file {quote(path)} cannot be read ({problem.strerror}); expected to see everything that sets kernel settings at "
                f"boot: {remedy(problem)}."
            ) from problem

    def names(self, folder: str) -> typing.Set[str]:
        """The names in a folder."""
        try:
            names = set(os.listdir(self.real(folder)))
        except OSError:
            names = set()
        for path, content in self.overlay.items():
            if os.path.dirname(path) == folder:
                (names.discard if content is None else names.add)(os.path.basename(path))
        return names

    def exists(self, path: str) -> bool:
        """True if there is a file or folder."""
        return os.path.exists(self.real(path))

    def is_masked(self, unit: str) -> bool:
        """True if systemd never starts a unit: an empty file or a link to /dev/null takes its place."""
        return any(unit in self.names(folder) and not self.read(f"{folder}/{unit}") for folder in _UNIT_FOLDERS[:2])

    def find_enabling_link(self, unit: str) -> typing.Optional[str]:
        """The link by which a unit starts at boot, or None."""
        for folder in _UNIT_FOLDERS + _GENERATED_FOLDERS:
            for wants in sorted(name for name in self.names(folder) if name.endswith((".wants", ".requires"))):
                if unit in self.names(f"{folder}/{wants}") and not self.is_masked(unit):
                    return f"{folder}/{wants}/{unit}"
        return None


def configuration_files(tree: Tree, folders: typing.Iterable[str], suffix: str = ".conf") -> typing.List[str]:
    """The files that are read from a list of folders: for each name the first file, sorted by name."""
    chosen: typing.Dict[str, str] = {}
    for folder in folders:
        for name in tree.names(folder):
            if name.endswith(suffix) and not name.startswith("."):
                chosen.setdefault(name, f"{folder}/{name}")
    return [chosen[name] for name in sorted(chosen, key=os.fsencode)]


def find_hiding_file(tree: Tree, drop_in: str) -> typing.Optional[str]:
    """The file that keeps the drop-in from being read: one of its name in an earlier folder, or the masked service."""
    if boots_with_systemd(tree) and tree.is_masked("systemd-sysctl.service"):
        return "/etc/systemd/system/systemd-sysctl.service"
    name = os.path.basename(drop_in)
    for path in configuration_files(tree, SYSCTL_FOLDERS):
        if os.path.basename(path) == name and tree.real(path) != tree.real(drop_in):
            return path
    return None


# The programs that set kernel settings at boot


def boots_with_systemd(tree: Tree) -> bool:
    """True if systemd-sysctl applies the settings: systemd runs (sd_booted(3)), or the image will start it."""
    if tree.exists("/run/systemd/system"):
        return True
    return os.path.basename(tree.real("/sbin/init")) == "systemd"


def sysctl_d(tree: Tree) -> typing.List[Assignment]:
    """systemd-sysctl.service(8), or `sysctl --system` of procps. Only procps reads /etc/sysctl.conf itself."""
    systemd = boots_with_systemd(tree)
    if systemd and tree.is_masked("systemd-sysctl.service"):
        return []
    files = configuration_files(tree, SYSCTL_FOLDERS) + ([] if systemd else ["/etc/sysctl.conf"])
    assignments = [assignment for path in files for assignment in parse(tree.read(path), path)]
    if systemd:
        return assignments
    # procps knows excluded keys only for patterns; a line that sets the key itself counts.
    keys = {assignment.key for assignment in assignments if assignment.value is not None}
    return [assignment for assignment in assignments if assignment.value is not None or assignment.key not in keys]


def ufw(tree: Tree) -> typing.List[Assignment]:
    """The file of ufw: ufw-init runs `sysctl -e -q -p $IPT_SYSCTL` when it starts (ufw-init-functions)."""
    if _shell_variable(tree.read("/etc/ufw/ufw.conf"), "ENABLED").lower() != "yes":
        return []
    path = _shell_variable(tree.read("/etc/default/ufw"), "IPT_SYSCTL")
    return parse(tree.read(path), path) if path else []


def networkd(tree: Tree) -> typing.List[Assignment]:
    """systemd-networkd.

    Up to systemd 255, IPForward= of a .network file turns forwarding on and never off (systemd.network(5)). From 256,
    IPv4Forwarding= and IPv6Forwarding= of networkd.conf turn it on or off (networkd.conf(5)). IPMasquerade= of a .network
    file implies the variable that turns it on, in all versions.
    """
    if not tree.find_enabling_link("systemd-networkd.service"):
        return []
    return _read_network_files(tree) + _read_networkd_conf(tree)


def _read_network_files(tree: Tree) -> typing.List[Assignment]:
    assignments = []
    for file in configuration_files(tree, _NETWORK_FOLDERS, ".network"):
        folders = [f"{folder}/{os.path.basename(file)}.d" for folder in _NETWORK_FOLDERS]
        files = [file, *configuration_files(tree, folders)]  # its drop-ins are read after it
        if not _is_for_this_machine(tree, files):
            continue
        # A plain yes means both families to the first, and only IPv4 to the second.
        for option, yes in (("IPForward", ("ipv4", "ipv6")), ("IPMasquerade", ("ipv4",))):
            value, path, line = _ini(tree, files, option)
            families = yes if value in _YES else ("ipv4", "ipv6") if value == "both" else (value,)
            for family, key in (("ipv4", "net/ipv4/ip_forward"), ("ipv6", "net/ipv6/conf/all/forwarding")):
                if family in families:
                    assignments.append(Assignment(key, "1", path, line))
    return assignments


def _is_for_this_machine(tree: Tree, files: typing.List[str]) -> bool:
    """False if [Match] of a .network file surely matches no interface of this machine: networkd sets nothing by it then.

    80-container-ve.network of systemd itself is such a file while no container runs (Name=ve-*), and 80-container-host0.network is one
    outside of containers (Virtualization=container). A condition that files do not answer, as Driver=, may match.
    """
    wanted = _list_words(tree, files, "Virtualization")[-1:]  # one value; the last one counts
    container = normal(tree.read(_CONTAINER)) if tree.exists(_CONTAINER) else ""
    for word in wanted:
        negated, word = word.startswith("!"), word.lstrip("!").lower()
        if word in _CONTAINERS and (bool(container) if word == "container" else container == word) == negated:
            return False
        if container and word in _NO and not negated:
            return False
    names, present = _list_words(tree, files, "Name"), tree.names("/sys/class/net")
    if not names or not present:
        return True
    negated = names[0].startswith("!")
    patterns = [names[0].lstrip("!"), *names[1:]]
    return any(any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns) != negated for name in present)


def _list_words(tree: Tree, files: typing.Iterable[str], option: str) -> typing.List[str]:
    """The words of an option of [Match]: lines add to each other, and an empty one takes back those before it."""
    words: typing.List[str] = []
    for value, _path, _line in _ini_values(tree, files, "[Match]", option):
        words = words + value.split() if value else []
    return words


def _read_networkd_conf(tree: Tree) -> typing.List[Assignment]:
    assignments = []
    mains = [path for path in (f"{folder}/networkd.conf" for folder in _SYSTEMD_FOLDERS) if tree.exists(path)]
    for option, family in (("IPv4Forwarding", "ipv4"), ("IPv6Forwarding", "ipv6")):
        value, path, line = _ini(tree, mains[:1] + configuration_files(tree, _NETWORKD_FOLDERS), option)
        if value in _YES + _NO:
            for which in ("default", "all"):
                key = f"net/{family}/conf/{which}/forwarding"
                assignments.append(Assignment(key, "1" if value in _YES else "0", path, line))
    return assignments


def docker(tree: Tree) -> typing.List[Assignment]:
    """dockerd turns forwarding on unless its `ip-forward` is false (dockerd(8))."""
    unit = tree.find_enabling_link("docker.service") or tree.find_enabling_link("docker.socket")
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


# In the order in which they run. Each reads all its files together.
READERS = (sysctl_d, ufw, networkd, docker)


def find_boot_assignments(tree: Tree, keys: typing.Iterable[str]) -> typing.Dict[str, typing.Optional[Assignment]]:
    """The assignment that decides each key at boot, or None. (Its value is None if a line excludes the key.)"""
    keys = list(keys)
    deciding: typing.Dict[str, typing.Optional[Assignment]] = dict.fromkeys(keys)
    for reader in READERS:
        assignments = reader(tree)
        for key in keys:
            names = {key, variable_of(key)} | {other for other, one in _OTHER_NAME.items() if one == variable_of(key)}
            last = last_write(assignments, names)
            if last and (last.value is not None or deciding[key] is None):
                deciding[key] = last
    return deciding


def _shell_variable(text: str, name: str) -> str:
    """The value of a variable in a file for a shell, "" if it is not set."""
    value = ""
    for match in re.finditer(rf"(?m)^[ \t]*(?:export[ \t]+)?{re.escape(name)}=(.*)$", text):
        try:
            value = (shlex.split(match.group(1), comments=True) or [""])[0]
        except ValueError:
            value = ""
    return value


def _ini(tree: Tree, files: typing.Iterable[str], option: str) -> typing.Tuple[str, str, int]:
    """The last value of an option of the section [Network], in lower case, with its file and its line."""
    value, path, number = ("", "", 0)
    for value, path, number in _ini_values(tree, files, "[Network]", option):
        pass
    return value.lower(), path, number


def _ini_values(
    tree: Tree, files: typing.Iterable[str], section: str, option: str
) -> typing.Iterator[typing.Tuple[str, str, int]]:
    """Each value of an option in a section, with its file and its line."""
    for path in files:
        here = ""
        for number, line in enumerate(tree.read(path).split("\n"), 1):
            line = line.strip()
            if line.startswith("["):
                here = line
            name, equals, value = line.partition("=")
            if here == section and equals and name.strip() == option:
                yield value.strip(), path, number
