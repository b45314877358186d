# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The state of a machine, as far as a configuration run may change it: printed as JSON, or two of them compared.

python3 snapshot.py > before.json
python3 snapshot.py --compare before.json after.json
"""

import glob
import grp
import hashlib
import json
import os
import pwd
import stat
import subprocess
import sys

TREES = (
    "/etc",  # and so the files of ifupdown, networkd, NetworkManager and netplan
    "/usr/local",
    "/home",
    "/root",
    "/var/lib/rosfleet*",
    "/var/lib/private/*",
    "/run/rosfleet*",
    "/run/systemd/network",
    "/run/NetworkManager/system-connections",
    "/run/netplan",
)
# Files that tools of Ansible and ROS leave behind wherever they run.
PASSING = {".ansible", ".bash_history", ".cache", ".ros", "__pycache__"}
# Kernel values that count up, that no user may read, or that are made anew at each boot.
VARYING = ("/proc/sys/net/netfilter/nf_conntrack_count", "/proc/sys/net/ipv4/tcp_fastopen_key")


def _entry(path):
    """Kind, mode, owner and content of one file, as a text."""
    status = os.lstat(path)
    owner = "%d:%d" % (status.st_uid, status.st_gid)
    if stat.S_ISLNK(status.st_mode):
        return "%s link to %s" % (owner, os.readlink(path))
    text = "%s %s" % (stat.filemode(status.st_mode), owner)
    if stat.S_ISREG(status.st_mode):
        with open(path, "rb") as file:
            text += " " + hashlib.sha256(file.read()).hexdigest()[:16]
    return text


def files():
    """Everything in the trees: path -> entry."""
    found = {}
    for top in (path for tree in TREES for path in glob.glob(tree)):
        found[top] = _entry(top)
        for folder, folders, names in os.walk(top):
            folders[:] = [name for name in folders if name not in PASSING]
            for name in folders + [name for name in names if name not in PASSING]:
                path = os.path.join(folder, name)
                found[path] = _entry(path)
    return found


def kernel_values():
    """The network's kernel settings: path -> value."""
    found = {}
    for folder, _folders, names in os.walk("/proc/sys/net"):
        for name in names:
            path = os.path.join(folder, name)
            try:
                with open(path) as file:
                    value = file.read().strip()
            except OSError:
                continue
            if path not in VARYING:
                found[path] = value
    return found


def _run(*words):
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
    return done.stdout


def unit_files():
    """The units on disk, with whether they are enabled: name -> state."""
    lines = _run("systemctl", "list-unit-files", "--no-legend", "--plain", "--no-pager").splitlines()
    states = dict(line.split()[:2] for line in lines)
    return {name: state for name, state in states.items() if state not in ("generated", "transient")}


def units():
    """The services that run: name -> state. Sessions, ways in and short-lived ones are left out."""
    lines = _run("systemctl", "list-units", "--type=service", "--no-legend", "--plain", "--no-pager").splitlines()
    states = {line.split()[0]: " ".join(line.split()[1:4]) for line in lines}
    passing = ("user@", "user-runtime-dir@", "run-", "lab-ssh@")
    return {name: state for name, state in states.items() if not name.startswith(passing)}


def addresses():
    """The addresses of the interfaces: interface -> addresses."""
    links = json.loads(_run("ip", "-json", "address"))
    return {
        link["ifname"]: ", ".join(
            "%s/%s" % (address["local"], address["prefixlen"])
            for address in link["addr_info"]
            if address["scope"] != "link"
        )
        for link in links
    }


def routes():
    """The routes of all tables, IPv4 and IPv6: kind, destination, interface and table -> the rest."""
    keys = ("gateway", "protocol", "scope", "metric", "prefsrc", "flags")
    found = {}
    for family in ("-4", "-6"):
        for route in json.loads(_run("ip", "-json", family, "route", "show", "table", "all") or "[]"):
            if route["dst"].startswith("fe80:"):  # of a hardware address, which changes at a reboot
                continue
            name = "%s %s dev %s table %s" % (
                route.get("type", "unicast"),
                route["dst"],
                route.get("dev", "-"),
                route.get("table", "main"),
            )
            rest = " ".join("%s %s" % (key, route[key]) for key in keys if route.get(key))
            found[name] = "; ".join(filter(None, (found.get(name), rest)))
    return found


def rules():
    """The routing rules, which order the tables, and the routes of multicast."""
    return {
        "%s of family %s" % (what, family): _run("ip", family, what)
        for what in ("rule", "mroute")
        for family in ("-4", "-6")
    }


def snapshot():
    """Everything, by part."""
    return {
        "file": files(),
        "user": {user.pw_name: ":".join(map(str, user[2:])) for user in pwd.getpwall()},
        "group": {group.gr_name: "%d:%s" % (group.gr_gid, ",".join(group.gr_mem)) for group in grp.getgrall()},
        "unit file": unit_files(),
        "service": units(),
        "address": addresses(),
        "route": routes(),
        "routing": rules(),
        "kernel value": kernel_values(),
        "packet filter": {"rules": _run("nft", "list", "ruleset")},
    }


def compare(before, after):
    """The differences, a line each."""
    for part in sorted(set(before) | set(after)):
        old, new = before.get(part, {}), after.get(part, {})
        for name in sorted(set(old) | set(new)):
            if old.get(name) != new.get(name):
                yield "%s %s: %s -> %s" % (part, name, old.get(name, "absent"), new.get(name, "absent"))


def main():
    """Return 1 when a comparison found differences."""
    if sys.argv[1:2] != ["--compare"]:
        json.dump(snapshot(), sys.stdout, indent=1, sort_keys=True)
        return 0
    snapshots = []
    for path in sys.argv[2:4]:
        with open(path) as file:
            snapshots.append(json.load(file))
    differences = list(compare(*snapshots))
    print("\n".join(differences) or "no difference")
    return int(bool(differences))


if __name__ == "__main__":
    sys.exit(main())
