# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
# Private to this collection: may change at any time.

"""What a machine is: its system and interfaces, and how to ask it without ever waiting for long."""

import json
import os
import platform
import pwd
import re
import shlex
import signal
import subprocess
import tempfile
import threading
import typing

BASE_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
CLEAN = {"PATH": BASE_PATH, "HOME": "/", "LC_ALL": "C.UTF-8"}
_LIMIT = 5.0  # seconds; every command asked here answers in a few hundredths
_NOBODY = 65534
_FLAGS = {"up": 0x1, "loopback": 0x8, "multicast": 0x1000}  # net_device(7), linux/if.h

Answer = typing.NamedTuple("Answer", [("status", int), ("output", bytes), ("error", str)])


def run(argv, environment=None, limit=_LIMIT, unprivileged=False):
    # type: (typing.Sequence[str], typing.Optional[typing.Dict[str, str]], float, bool) -> Answer
    """Run a command in a clean environment for at most `limit` seconds, with everything that it leaves behind.

    With `unprivileged` root becomes the user nobody first. A command that is not there, or too slow,
    is an Answer with status -1 and a sentence, never an exception.
    """
    # Files instead of pipes: a process that the command leaves in the background holds no pipe that we wait for.
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as error:
        try:
            process = subprocess.Popen(
                argv,
                env=CLEAN if environment is None else environment,
                cwd="/",
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=error,
                preexec_fn=_become(_nobody()) if unprivileged and os.geteuid() == 0 else os.setsid,
            )
        except (OSError, subprocess.SubprocessError) as problem:
            return Answer(-1, b"", "%s could not be started: %s" % (argv[0], problem))
        try:
            status = process.wait(timeout=limit)
        except subprocess.TimeoutExpired:
            status = -1
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()
        if status == -1:
            return Answer(-1, b"", "%s gave no answer within %g s" % (argv[0], limit))
        output.seek(0)
        error.seek(0)
        return Answer(status, output.read(), error.read().decode("utf-8", "replace").strip())


def _nobody():
    # type: () -> typing.Tuple[int, int]
    try:
        entry = pwd.getpwnam("nobody")
        return entry.pw_uid, entry.pw_gid
    except KeyError:
        return _NOBODY, _NOBODY


def _become(who):
    # type: (typing.Tuple[int, int]) -> typing.Callable[[], None]
    """What a child does between fork(2) and exec(2): system calls only, since other threads may hold any lock."""

    def become():
        # type: () -> None
        os.setsid()
        os.setgroups([])
        os.setgid(who[1])
        os.setuid(who[0])

    return become


def within(limit, function, *arguments):
    # type: (float, typing.Callable[..., typing.Any], *typing.Any) -> typing.Any
    """The result of a function, or TimeoutError after `limit` seconds: a file on a dead network disk blocks."""
    results = []  # type: typing.List[typing.Tuple[bool, typing.Any]]

    def work():
        # type: () -> None
        try:
            results.append((True, function(*arguments)))
        except Exception as problem:  # handed to the caller, who is another thread
            results.append((False, problem))

    thread = threading.Thread(target=work)
    thread.daemon = True  # a blocked one does not keep the process
    thread.start()
    thread.join(limit)
    if not results:
        raise TimeoutError("no answer within %g s" % limit)
    good, value = results[0]
    if good:
        return value
    raise value


def text(path, most=1 << 20):
    # type: (str, int) -> str
    """The text of a regular file, at most `most` bytes of it; empty where there is none to read."""
    try:
        if not os.path.isfile(path):  # never a FIFO: opening one waits for its writer
            return ""
        with open(path, "rb") as stream:
            return stream.read(most).decode("utf-8", "replace")
    except OSError:
        return ""


def system(root="/"):
    # type: (str) -> typing.Dict[str, typing.Any]
    """Host name, Python, operating system (os-release(5)) and systemd."""
    release = {}
    for word in _words(text(os.path.join(root, "etc/os-release"))):
        name, _equals, value = word.partition("=")
        release[name] = value
    version = re.match(r"systemd (\d+)", run(["systemctl", "--version"]).output.decode("utf-8", "replace"))
    return {
        "hostname": os.uname().nodename,
        "python": platform.python_version(),
        "os": {
            "id": release.get("ID", ""),
            "version": release.get("VERSION_ID", ""),
            "name": release.get("PRETTY_NAME", ""),
        },
        "systemd": {
            # sd_booted(3)
            "running": os.path.isdir(os.path.join(root, "run/systemd/system")),
            "version": int(version.group(1)) if version else 0,
        },
    }


def _words(content):
    # type: (str) -> typing.List[str]
    try:
        return shlex.split(content, comments=True)
    except ValueError:  # an unfinished quotation
        return content.split()


def interfaces():
    # type: () -> typing.List[typing.Dict[str, typing.Any]]
    """The network interfaces with their addresses. Raises OSError where the machine cannot be asked."""
    answer = run(["ip", "-json", "address"])
    if answer.status == 0:
        try:
            return from_json(answer.output.decode("utf-8"))
        except ValueError:
            pass  # iproute2 before 4.14 takes the option and prints text
    answer = run(["ip", "-oneline", "address"])
    if answer.status != 0:
        raise OSError("the interfaces' addresses cannot be read: %s" % (answer.error or "ip failed"))
    return from_text(answer.output.decode("utf-8", "replace"), links())


def from_json(output):
    # type: (str) -> typing.List[typing.Dict[str, typing.Any]]
    """Interfaces out of the text of `ip -json address`. Raises ValueError for anything else."""
    data = json.loads(output)
    if not isinstance(data, list):
        raise ValueError("expected a list of interfaces")
    return [
        {
            "name": link["ifname"],
            "up": "UP" in link.get("flags", ()),
            "multicast": "MULTICAST" in link.get("flags", ()),
            "loopback": "LOOPBACK" in link.get("flags", ()),
            "mtu": link.get("mtu", 0),
            "addresses": [
                {"address": entry["local"], "prefix": entry["prefixlen"], "family": entry["family"]}
                for entry in link.get("addr_info", ())
                if "local" in entry
            ],
        }
        for link in data
        if "ifname" in link  # old versions leave empty objects
    ]


def links(folder="/sys/class/net"):
    # type: (str) -> typing.List[typing.Dict[str, typing.Any]]
    """Interfaces without their addresses, as the kernel shows them in files."""
    found = []
    for name in sorted(os.listdir(folder)):
        flags = text(os.path.join(folder, name, "flags")).strip()
        if not flags:
            continue  # a file such as bonding_masters
        link = {"name": name, "mtu": int(text(os.path.join(folder, name, "mtu")).strip() or 0), "addresses": []}
        link.update((key, bool(int(flags, 16) & bit)) for key, bit in _FLAGS.items())
        found.append(link)
    return found


def from_text(output, found):
    # type: (str, typing.List[typing.Dict[str, typing.Any]]) -> typing.List[typing.Dict[str, typing.Any]]
    """Interfaces with the addresses out of the text of `ip -oneline address`."""
    by_name = {link["name"]: link for link in found}
    lines = re.findall(r"^\d+:\s+(\S+)\s+(inet6?)\s+([^\s/]+)(?: peer [^\s/]+)?(?:/(\d+))?", output, re.MULTILINE)
    for name, family, address, prefix in lines:
        if name in by_name:
            length = int(prefix) if prefix else {"inet": 32, "inet6": 128}[family]
            by_name[name]["addresses"].append({"address": address, "prefix": length, "family": family})
    return found


def ways(destinations):
    # type: (typing.List[str]) -> typing.List[typing.Dict[str, typing.Any]]
    """The routes that the kernel would take to IPv4 addresses (ip-route(8), get)."""
    found = []
    for destination in destinations:
        answer = run(["ip", "-json", "-4", "route", "get", destination])
        way = {"destination": destination, "gateway": None, "device": None, "source": None, "error": ""}
        if answer.status == 0:
            route = json.loads(answer.output.decode("utf-8"))[0]
            way.update(gateway=route.get("gateway"), device=route.get("dev"), source=route.get("prefsrc"))
        else:
            way["error"] = answer.error.replace("RTNETLINK answers: ", "") or "no route"
        found.append(way)
    return found


# Programs that pass multicast on between interfaces, by their units in Debian; the kernel takes one at a time.
_MULTICAST_ROUTERS = ("smcroute.service", "mrouted.service", "pimd.service", "igmpproxy.service")


def multicast_routing():
    # type: () -> typing.Dict[str, typing.Any]
    """Where smcrouted is, and which units of others pass multicast on."""
    places = (os.path.join(folder, "smcrouted") for folder in ("/usr/sbin", "/usr/local/sbin", "/sbin"))
    states = run(["systemctl", "is-active"] + list(_MULTICAST_ROUTERS)).output.decode("utf-8", "replace").split()
    return {
        "smcrouted": next((path for path in places if os.access(path, os.X_OK)), ""),
        "others": [unit for unit, state in zip(_MULTICAST_ROUTERS, states) if state == "active"],
    }
