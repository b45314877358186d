# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Computers that boot with the network files of people, and get routes of ours: runs inside a computer of the lab.

Reads a line of JSON for each computer, and answers one. Each is a process in a network and mount namespace of its own.
"""

import base64
import ctypes
import fnmatch
import glob
import itertools
import json
import os
import re
import subprocess
import sys
import time
import traceback

from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.run import RoutesRun
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem

NAMESPACES = 0x40000000 | 0x00020000  # CLONE_NEWNET, CLONE_NEWNS (unshare(2))
LINKS = ("lan0", "eth0", "eth1", "eth2", "eth0.20", "wlan0", "enp3s0", "br0", "eno1")
#: What each computer has for itself, as it is after an installation.
FOLDERS = (
    "/etc/network",
    "/etc/netplan",
    "/etc/NetworkManager/system-connections",
    "/run",
    "/var/lib/rosfleet-multimaster",
)
GIVEN = FOLDERS[:3]


def run(*words, check=True):
    done = subprocess.run(words, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    if check and done.returncode:
        raise RuntimeError(f"{' '.join(words)}: {done.stdout}{done.stderr}")
    return done


def make_links():
    """Make the links of a computer, each with its other end at a switch."""
    lines = ["link set lo up"]
    for number, name in enumerate(LINKS):
        lines.append(f"link add {name} address 52:54:00:aa:bb:{number:02x} type veth peer name port{number}")
        lines.append(f"link set port{number} up")
    subprocess.run(["ip", "-batch", "-"], input="\n".join(lines), text=True, check=True)


def make_links_anew():
    for name, _index, _mac in list_links():
        if name.startswith("port"):
            run("ip", "link", "delete", name)
    make_links()


def read_tree(*folders):
    """Read the files below folders: path -> content and mode."""
    found = {}
    for folder in folders:
        for top, _folders, names in os.walk(folder):
            for path in (os.path.join(top, name) for name in names):
                with open(path, "rb") as stream:
                    found[path] = [base64.b64encode(stream.read()).decode(), os.stat(path).st_mode & 0o777]
    return found


def write_tree(files):
    for path, (content, mode) in files.items():
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as stream:
            stream.write(base64.b64decode(content))
        os.chmod(path, mode)


def read_routes():
    """Read the kernel's routes of both versions, without what another boot counts anew."""
    lines = []
    for version in ("-4", "-6"):
        for line in run("ip", version, "route", "show", "table", "all").stdout.splitlines():
            # An address of IPv6 is there a second after its link: the kernel asks first if another has it.
            if version == "-4" or ("table local" not in line and "fe80" not in line and "ff00" not in line):
                lines.append(line)
    return sorted(re.sub(r" +(linkdown|dead|expires \S+|pref medium)", "", line).strip() for line in lines)


def read_addresses():
    """Read the addresses of links: link -> [address/prefix] of IPv4."""
    found = {}
    for line in run("ip", "-4", "-oneline", "address").stdout.splitlines():
        words = line.split()
        found.setdefault(words[1], []).append(words[3])
    return found


#: What `netplan generate` runs, without the time in which Python starts.
GENERATE = next(iter(glob.glob("/usr/lib*/netplan/generate") + glob.glob("/lib/netplan/generate")), "netplan-generate")


class Manager:
    """A program that configures links at boot."""

    def boot(self):
        """Boot the computer with its files; returns what was said."""
        raise NotImplementedError

    def generated(self):
        """The files that the program makes of its own for another one."""
        return {}

    def end(self):
        """End the programs of the computer."""


class Ifupdown(Manager):
    def boot(self):
        make_links_anew()
        os.makedirs("/run/network", exist_ok=True)
        for name in os.listdir("/run/network"):
            os.remove(f"/run/network/{name}")
        words = [["ifup", "--all"], ["ifup", "--all", "--allow=hotplug"]]
        return "".join(run(*command, check=False).stderr for command in words)


class Netplan(Manager):
    """Its files for networkd; the links have addresses of their own, since no networkd runs."""

    def __init__(self):
        make_links()

    def boot(self):
        for folder in ("network", "system", "netif/links"):
            run("rm", "-rf", f"/run/systemd/{folder}")
        said = run(GENERATE, check=False)
        if said.returncode:
            return said.stderr
        os.makedirs("/run/systemd/netif/links")
        for name, index, mac in list_links():
            file = find_network(name, mac)
            if file:
                with open(f"/run/systemd/netif/links/{index}", "w") as stream:
                    stream.write(f"ADMIN_STATE=configured\nNETWORK_FILE={file}\n")
                run("ip", "link", "set", name, "up")
                run("ip", "address", "replace", f"10.{index}.0.1/24", "dev", name)
        return ""

    def generated(self):
        return read_tree("/run/systemd/network", "/run/systemd/system", "/run/netplan", "/run/NetworkManager")


def list_links():
    for link in json.loads(run("ip", "-json", "link").stdout):
        yield link["ifname"], link["ifindex"], link["address"]


def find_network(name, mac):
    """Find the file with which networkd would configure a link (systemd.network(5)), "" without one."""
    for path in sorted(glob.glob("/run/systemd/network/*.network")):
        with open(path) as stream:
            match = stream.read().partition("[Match]")[2].partition("\n[")[0]
        wanted = dict(line.partition("=")[::2] for line in match.splitlines() if "=" in line)
        names = wanted.pop("Name", "*").split() if "Name" in wanted or "OriginalName" not in wanted else []
        macs = (wanted.pop("PermanentMACAddress", "") or wanted.pop("MACAddress", mac)).lower().split()
        if any(fnmatch.fnmatchcase(name, pattern) for pattern in names) and mac in macs and not wanted:
            return path
    return ""


class NetworkManager(Manager):
    """The daemon, with a bus of its own, on links that it may manage."""

    def __init__(self):
        os.makedirs("/run/dbus")
        os.makedirs("/run/systemd/system")  # as with systemd: commands reach the daemon
        os.makedirs("/run/NetworkManager/conf.d")
        with open("/run/NetworkManager/conf.d/links.conf", "w") as stream:
            stream.write("[main]\nno-auto-default=*\n[keyfile]\nunmanaged-devices=interface-name:port*\n")
        bus = ["dbus-daemon", "--system", "--nofork", "--nopidfile"]
        self.programs = [subprocess.Popen(bus, stderr=subprocess.DEVNULL)]
        self.daemon = None

    def boot(self):
        if self.daemon:
            self.daemon.terminate()
            self.daemon.wait()
        make_links_anew()
        with open("/run/nm.log", "ab") as log:
            self.daemon = subprocess.Popen(["NetworkManager", "--no-daemon"], stdout=log, stderr=log)
        run("nm-online", "--quiet", "--wait-for-startup", "--timeout=20", check=False)
        return self._wait_until_quiet()

    @staticmethod
    def _wait_until_quiet():
        """Wait until the links have their addresses, half a minute at most; returns the state of each."""
        seen = []
        for _look in range(60):
            state = run("nmcli", "--terse", "--fields", "DEVICE,STATE,CONNECTION", "device", check=False).stdout
            seen.append((state, read_routes()))
            if "eth0:" in state and ":connecting" not in state and seen[-3:] == seen[-1:] * 3:
                break
            time.sleep(0.2)
        return state

    def generated(self):
        """The settings of each profile, as the daemon knows them."""
        names = run("nmcli", "--terse", "--fields", "UUID", "connection", "show").stdout.split()
        words = ("nmcli", "--terse", "--fields", "connection,ipv4,ipv6", "connection", "show", "uuid")
        return {name: re.sub(r"connection.timestamp:.*", "", run(*words, name).stdout) for name in names}

    def end(self):
        for program in (self.daemon, *self.programs):
            if program:
                program.kill()


MANAGERS = {"ifupdown": Ifupdown, "netplan": Netplan, "networkmanager": NetworkManager}


def options(*routes):
    usual = {
        "device": None,
        "metric": None,
        "table": "254",
        "source": None,
        "on_link": False,
        "type": "unicast",
        "scope": None,
    }
    usual.update(mtu=None, advmss=None, initcwnd=None, backend="auto")
    return {
        "routes": [{**usual, **route} for route in routes],
        "backends": {},
        "on_conflict": "fail",
        "root": "/",
        "records": "/var/lib/rosfleet-multimaster",
    }


def apply(*routes):
    """Run the module as it runs on a robot: (whether it changed something, its refusal)."""
    try:
        found = RoutesRun(options(*routes))
        if found.refusals:
            return False, " ".join(found.refusals)
        if found.changed:
            found.apply()
        return found.changed, ""
    except Problem as problem:
        return False, str(problem)


def list_wanted(addresses):
    """One route of ours for each network of the computer: the last host of it is the gateway."""
    number = itertools.count(1)
    for link, cidrs in sorted(addresses.items()):
        for cidr in cidrs:
            network, _slash, prefix = cidr.partition("/")
            if link != "lo" and int(prefix) <= 24:
                gateway = network.rpartition(".")[0] + ".254"
                if gateway != network:
                    yield {"destination": f"10.{200 + next(number)}.0.0/16", "gateway": gateway, "device": link}


def take_all(routes):
    """Take routes into the computer: those that were taken, and the refusal of each other one by its link."""
    _changed, refusal = apply(*routes)
    if not refusal:
        return routes, {}
    taken, refused = [], {}
    for route in routes:
        _changed, refusal = apply(*taken, route)
        if refusal:
            refused[route["device"]] = refusal
        else:
            taken.append(route)
    return taken, refused


def try_files(manager, files):
    """The course of a computer with these files, from its boot without us to its boot after our removal."""
    write_tree(files)
    answer = {"said": [manager.boot()]}
    before, kernel, made = read_tree(*GIVEN), read_routes(), manager.generated()
    answer["addresses"] = read_addresses()
    taken, answer["refused"] = take_all(list(list_wanted(answer["addresses"])))
    answer["ours"] = [f"{route['destination']} via {route['gateway']} dev {route['device']}" for route in taken]
    answer["again"] = apply(*taken)
    answer["kernel"] = [kernel, read_routes()]
    answer["files"] = [before, read_tree(*GIVEN)]
    if taken:
        answer["said"].append(manager.boot())
        answer["booted"] = read_routes()
        answer["generated"] = [made, manager.generated()]
    answer["removed"] = apply()
    answer["files"].append(read_tree(*GIVEN))
    answer["kernel"].append(read_routes())
    if taken:
        answer["generated"].append(manager.generated())
    return answer


def be_alone():
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(NAMESPACES):
        raise OSError(ctypes.get_errno(), "unshare")
    run("mount", "--make-rprivate", "/")
    for folder in FOLDERS:
        os.makedirs(folder, exist_ok=True)
        run("mount", "-t", "tmpfs", "tmpfs", folder)
    run("mount", "--bind", "/bin/false", "/sbin/dhclient")  # no server answers, and nobody waits for one
    for folder in ("interfaces.d", "if-pre-up.d", "if-up.d", "if-down.d", "if-post-down.d"):
        os.mkdir(f"/etc/network/{folder}")


def answer_one(question):
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            be_alone()
            manager = MANAGERS[question["manager"]]()
            try:
                found = try_files(manager, question["files"])
            finally:
                manager.end()
        except BaseException:
            found = {"crash": traceback.format_exc()}
        with os.fdopen(writing, "w") as stream:
            json.dump(found, stream)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as stream:
        text = stream.read()
    os.waitpid(child, 0)
    return text


if __name__ == "__main__":
    for line in sys.stdin:
        print(answer_one(json.loads(line)), flush=True)
