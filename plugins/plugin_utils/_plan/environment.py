# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The environment of ROS for each kind of program: variables in, the contents of files out.

To reach one more kind of program, add it to `render_files`.
"""

from __future__ import annotations

import hashlib
import re
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from .._base.plain_text import quote
from .units import CONFIGURATION, LIBRARY

# Lists of folders. Ours come first, those of a person stay.
LISTS = (
    "PATH",
    "PYTHONPATH",
    "LD_LIBRARY_PATH",
    "CMAKE_PREFIX_PATH",
    "PKG_CONFIG_PATH",
    "ROS_PACKAGE_PATH",
    "ROSLISP_PACKAGE_DIRECTORIES",
    "GAZEBO_MODEL_PATH",
    "GAZEBO_PLUGIN_PATH",
    "GAZEBO_RESOURCE_PATH",
)
# The nodes, and the messages for rosmsg and rosservice. Debian's ROS searches its own /usr/share anyway.
LIBRARIES = {"PYTHONPATH": f"{LIBRARY}/python", "ROS_PACKAGE_PATH": f"{LIBRARY}/share"}
# The name of a computer. rospy takes ROS_HOSTNAME before ROS_IP, so an old one of the two must not stay.
NAMES = ("ROS_HOSTNAME", "ROS_IP")
MASTER = "ROS_MASTER_URI"

# Variables that move nodes, their logs or their sockets: a person may have them, and services of the collection have places of their own.
OF_PERSONS = (
    "ROS_NAMESPACE",
    "ROS_HOME",
    "ROS_LOG_DIR",
    "ROS_IPV6",
    "ROS_PYTHON_LOG_CONFIG_FILE",
    "ROSCONSOLE_CONFIG_FILE",
    "ROSCONSOLE_FORMAT",
)

UNIT_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
# Without SetEnv, sshd gives root a PATH of its own. This one has the folders of both, as in Ubuntu.
SSH_PATH = f"{UNIT_PATH}:/usr/local/games:/usr/games"

_HEADER = "# From the collection rosfleet.multimaster: written again by its next run.\n"
_PLAIN = re.compile(r"[A-Za-z0-9_./:@%+,=-]+")


@dataclass(frozen=True)
class Environment:
    """The variables of one computer: texts, lists of folders, and names without a value."""

    texts: Mapping[str, str] = field(default_factory=dict)
    lists: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    unset: tuple[str, ...] = ()
    # For root, and for all users but `person`. None: all get the same. Services get the whole.
    others: Environment | None = None
    person: str = ""  # the user with the whole, "*" for every user but root, empty for no user


def merge(ros: Mapping[str, str], ours: Mapping[str, str]) -> Environment:
    """Merge the variables of the ROS installation with ours. Ours win. A list has our folders first, and each folder once."""
    texts: dict[str, str] = {}
    lists: dict[str, tuple[str, ...]] = {}
    stale = tuple(name for name in NAMES if name not in ours)
    for source in (LIBRARIES, ours, ros):
        for name, value in source.items():
            if name in LISTS:
                entries = [*lists.get(name, ()), *(entry for entry in value.split(":") if entry)]
                lists[name] = tuple(dict.fromkeys(entries))
            elif name not in stale:
                texts.setdefault(name, value)
    # The other of the two names is stale only if one of them is ours.
    unset = stale if len(stale) < len(NAMES) else ()
    return Environment(dict(sorted(texts.items())), dict(sorted(lists.items())), unset)


def merge_for_users(
    ros: Mapping[str, str], for_root: Mapping[str, str], person: str, ours: Mapping[str, str]
) -> Environment:
    """Merge as `merge` does, with less for root and others: root must not use a path that other users can change."""
    whole, others = merge(ros, ours), merge(for_root, ours)
    return whole if whole == others else replace(whole, others=others, person=person)


def narrow(environment: Environment, shells: str) -> Environment | None:
    """Return the variables that shells get: `all` of it, only the `names` of the master and of the computer, or nothing (`none`)."""
    if shells == "names":
        names = {name: value for name, value in environment.texts.items() if name in (MASTER, *NAMES)}
        return Environment(names, {}, environment.unset)
    return environment if shells == "all" else None


def render_files(environment: Environment, info: Mapping[str, Any], shells: str = "all") -> list[dict[str, Any]]:
    """Return the files of an environment that a machine can use, as managed_files takes them. `info` is the return of multimaster_info."""
    contents = {f"{CONFIGURATION}/environment": render_units(environment)}
    seen = narrow(environment, shells)
    if seen:
        hooks = (info["ros"].get("chosen") or {}).get("hooks") or ""
        contents |= {
            PROFILE: _render_profile(seen),
            DESKTOP: _render_desktop(seen),
            GENERATOR: _render_generator(seen),
            SSHD: _render_ssh(seen, info["sshd"]),
            # Hooks run in the order of names: after 1.ros_package_path.sh of ros_environment, before 10.roslaunch.sh (localhost).
            f"{hooks}/1.rosfleet-multimaster.sh": _render_hook(seen) if hooks else "",
        }
    more: dict[str, dict[str, Any]] = {GENERATOR: {"mode": "0755"}, SSHD: {"validate": SSHD_TEST}}
    return [
        {"path": path, "content": content, "mode": "0644", **more.get(path, {})}
        for path, content in contents.items()
        if content
    ]


def compute_digest(environment: Environment) -> str:
    """Return the SHA-256 of the file that units read. Changes of the other files do not restart a roscore."""
    return hashlib.sha256(render_units(environment).encode()).hexdigest()


def find_gaps(info: Mapping[str, Any], environment: Environment | None) -> list[str]:
    """Return a sentence for each consumer without the environment on this machine; no sentence if shells are to get nothing."""
    sshd = info["sshd"]
    if not sshd["installed"] or environment is None:
        return []
    host = quote(info["hostname"])
    whole = f"Commands by ssh do not get the environment of ROS on {host}"
    part = f"Commands by ssh do not get the variables of the set-up file of ROS on {host}"
    if not sshd["includes_drop_ins"]:
        folder = SSHD.rpartition("/")[0]
        return [
            f"{whole}: its sshd reads no drop-ins (no Include of {folder}/*.conf outside a Match in /etc/ssh/sshd_config)."
        ]
    gaps = [
        f"{whole}: {quote(other['file'])} line {other['line']} has a SetEnv already, and sshd uses only the first; "
        "move its variables elsewhere, or add ours to it."
        for other in _list_setenv(sshd, match=False)
    ]
    if gaps or not environment.others or not environment.person:
        return gaps
    if not sshd.get("match_setenv", True):
        return [f"{part}: its OpenSSH knows no SetEnv below a Match; login shells get them (bash -lc COMMAND)."]
    return [
        f"{part}: {quote(other['file'])} line {other['line']} has a SetEnv below a Match, and sshd uses only the first of those; "
        "move its variables elsewhere."
        for other in _list_setenv(sshd, match=True)
    ]


def find_differences(
    ours: Mapping[str, str],
    seen: Mapping[str, Mapping[str, str] | None],
    rendered: Collection[str],
    known: Collection[str] = (),
    shells: str = "all",
) -> list[str]:
    """Return a sentence for each of our variables that does not arrive, out of `environment` of multimaster_info.

    `rendered` are the paths of our files. A consumer without one is passed over. `known` are the variables that older
    files of the machine set. Login shells may have another value of them. `shells` says how much they are to get.
    """
    planned = narrow(merge({}, ours), shells) or Environment()
    wanted = {**planned.texts, **planned.lists, **dict.fromkeys(planned.unset)}
    differences = []
    for what, paths in SEEN.items():
        variables = seen.get(what)
        path = next((path for path in paths if path in rendered), "")
        if not path or variables is None:
            continue
        for name, value in wanted.items():
            actual, expected = variables.get(name), value
            if isinstance(value, tuple):
                expected, arrives = ":".join(value), set(value) <= set((actual or "").split(":"))
            else:
                arrives = actual == value or (what == "login" and name in known)
            if not arrives:
                differences.append(
                    f"{name} is {'not set' if actual is None else quote(actual)} in {TITLES[what]}, expected "
                    f"{'it not to be set' if expected is None else quote(expected)}: a file that is read after {path} sets it: "
                    f"grep -rn {name} /etc/profile.d /etc/bash.bashrc /etc/environment ~/.bashrc ~/.profile."
                )
    return differences


def _list_setenv(sshd: Mapping[str, Any], match: bool) -> list[Mapping[str, Any]]:
    """Return the foreign lines, outside or below a Match. A line below a Match counts only for its users."""
    return [other for other in sshd["other_setenv"] if bool(other["match"]) == match]


def render_units(environment: Environment) -> str:
    """Render the file for systemd (systemd.exec(5), EnvironmentFile=): whole values, without expansion."""
    return _HEADER + "".join(f"{name}={_quote(value)}\n" for name, value in list_for_services(environment).items())


def list_for_services(environment: Environment) -> dict[str, str]:
    """Return the variables that services get: a namespace of a person would move discovery, which others look for by its name."""
    return {name: value for name, value in values(environment).items() if name not in OF_PERSONS}


def values(environment: Environment, path: str = UNIT_PATH) -> dict[str, str]:
    """Return the variables for readers that cannot extend a list. PATH keeps the folders of the system, which are those of `path`."""
    lists = {
        name: ":".join(dict.fromkeys([*entries, *(path.split(":") if name == "PATH" else ())]))
        for name, entries in environment.lists.items()
    }
    return dict(sorted({**environment.texts, **lists}.items()))


def _render_profile(environment: Environment) -> str:
    """Render POSIX sh for /etc/profile and display managers. It works under any options (set -eu) and prints nothing."""
    return _HEADER + "\n".join(_render_by_user(environment, _render_exports)) + "\n"


def _render_exports(environment: Environment) -> list[str]:
    lines = [f"unset {name}" for name in environment.unset]
    lines += [f"export {name}={shlex.quote(value)}" for name, value in environment.texts.items()]
    return [*lines, *_prepend_folders(environment.lists)]


def _render_by_user(environment: Environment, render: Callable[[Environment], list[str]]) -> list[str]:
    """Render lines of sh. If others get less than the person, each has lines of its own."""
    others = environment.others
    if not others:
        return render(environment)
    if not environment.person:
        return render(others)
    if environment.person == "*":
        start, first, second = 'case "$(/usr/bin/id -u)" in "" | 0)', others, environment
    else:
        start, first, second = f'case "$(/usr/bin/id -un)" in {environment.person})', environment, others
    return [start, *render(first), ";; *)", *render(second), ";; esac"]


def _render_hook(environment: Environment) -> str:
    """Render a hook of catkin. A set-up file makes ROS_PACKAGE_PATH anew, then it sources the hooks.

    Our folders are put in front again, if shells get folders. A value of the person stays. Shells that read no profile
    (zsh, cron) get the fleet's master instead of localhost.
    """
    names = "".join(f"${{{name}-}}" for name in NAMES)
    tests = [
        (name, names if name in NAMES else f"${{{name}-}}") for name in environment.texts if name in (MASTER, *NAMES)
    ]
    lines = [f'[ -n "{test}" ] || export {name}={shlex.quote(environment.texts[name])}' for name, test in tests]
    return _HEADER + "\n".join([*lines, *(_prepend_folders(merge({}, {}).lists) if environment.lists else ())]) + "\n"


def _prepend_folders(lists: Mapping[str, Sequence[str]]) -> Iterator[str]:
    for name, entries in lists.items():
        for entry in map(shlex.quote, reversed(entries)):  # the first one is put in front last
            yield f'case ":${{{name}-}}:" in *:{entry}:*) ;; *) {name}={entry}"${{{name}:+:${name}}}" ;; esac'
        yield f"export {name}"


def _render_desktop(environment: Environment) -> str:
    """Render a file for desktops (environment.d(5)). `$` is doubled, since systemd expands values without their quotes."""
    if environment.others and environment.person:
        return ""  # every user's systemd reads this file, root's too
    environment = environment.others or environment
    lines = [f"{name}={_quote(value.replace('$', '$$'))}\n" for name, value in environment.texts.items()]
    for name, entries in environment.lists.items():
        joined = _quote(":".join(entries).replace("$", "$$"))
        lines.append(f"{name}={joined}${{{name}:+:${name}}}\n")
    return _HEADER + "".join(lines)


def _render_generator(environment: Environment) -> str:
    """Render a generator for desktops (systemd.environment-generator(7)). It can ask which user's systemd runs it."""
    if not (environment.others and environment.person):
        return ""

    def render(environment: Environment) -> list[str]:
        return [*_render_exports(environment), f"say {' '.join([*environment.texts, *environment.lists])}"]

    return _GENERATOR_START + "\n".join(_render_by_user(environment, render)) + "\n"


_GENERATOR_START = f"""\
#!/bin/sh
{_HEADER}say() {{
    for name do
        eval "value=\\${{$name-}}"
        printf '%s="%s"\\n' "$name" "$(printf %s "$value" | PATH=/usr/bin:/bin sed 's/[\\"$`]/\\\\&/g')"
    done
}}
"""


def _render_ssh(environment: Environment, sshd: Mapping[str, Any]) -> str:
    """Render SetEnv (sshd_config(5)). sshd uses only the first such line, so all variables are in one.

    A line below a Match that is true counts before a line outside. A Match ends with this file.
    """
    if not (sshd["installed"] and sshd["includes_drop_ins"]) or _list_setenv(sshd, match=False):
        return ""
    path = sshd["path"] or SSH_PATH
    if not environment.others:
        return _HEADER + _render_setenv(environment, path)
    takes_match = sshd.get("match_setenv", True) and not _list_setenv(sshd, match=True)
    users = {"": "", "*": "!root,*"}.get(environment.person, environment.person)
    more = f"Match User {users}\n{_render_setenv(environment, path)}" if users and takes_match else ""
    return f"{_HEADER}{_render_setenv(environment.others, path)}{more}"


def _render_setenv(environment: Environment, path: str) -> str:
    # The quotes are around the whole word. OpenSSH before 8.7 knows them only at its start.
    words = map(_quote, map("=".join, values(environment, path).items()))
    return f"SetEnv {' '.join(words)}\n"


def _quote(text: str) -> str:
    """Return a text for systemd or sshd, in double quotes unless it is plain."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return text if _PLAIN.fullmatch(text) else f'"{escaped}"'


SSHD = "/etc/ssh/sshd_config.d/rosfleet-multimaster.conf"
# An sshd that refuses its files would not start at the next boot. It names the refused file. Its status is no proof, since
# it counts missing host keys too.
SSHD_TEST = ["/bin/sh", "-c", "! /usr/sbin/sshd -t -f /dev/stdin 2>&1 | grep /dev/stdin"]
PROFILE = "/etc/profile.d/rosfleet-multimaster.sh"
DESKTOP = "/etc/environment.d/90-rosfleet-multimaster.conf"
GENERATOR = "/etc/systemd/user-environment-generators/90-rosfleet-multimaster"
# The environments that multimaster_info reads back, and the files that each may come from.
SEEN = {"login": (PROFILE,), "ssh": (SSHD,), "desktop": (DESKTOP, GENERATOR)}
TITLES = {"login": "a new login shell", "ssh": "a command by ssh", "desktop": "a terminal of the desktop"}
