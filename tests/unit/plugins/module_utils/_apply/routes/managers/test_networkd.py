# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The commands for networkd in their order, over files as networkd keeps them; the real one is in tests/machines."""

import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import (
    contract,
    netplan,
    networkd,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import NetworkInterface

HOME = "/etc/systemd/network/10-eth0.network"
WIFI = "/run/systemd/network/10-netplan-wlan0.network"
LINKS = {"eth0": HOME, "wlan0": WIFI, "docker0": ""}
KEPT = {
    "run/systemd/networkd.conf.d/90-rosfleet-multimaster.conf": [
        "[Network]",
        "ManageForeignRoutes=no",
        "ManageForeignRoutingPolicyRules=no",
    ],
    "run/systemd/network/10-eth0.network.d/90-rosfleet-multimaster-keep.conf": [
        "[Network]",
        "KeepConfiguration=static",
    ],
    "run/systemd/network/10-netplan-wlan0.network.d/90-rosfleet-multimaster-keep.conf": [
        "[Network]",
        "KeepConfiguration=static",
    ],
}


class Manager:
    """A machine whose networkd writes its state files as the real one does, some moments after its restart."""

    def __init__(self, root, monkeypatch):
        self.root, self.asked = root, []
        self.version, self.dynamic, self.active, self.seconds, self.late = (
            "252",
            "",
            True,
            0.0,
            ["configuring", "configured"],
        )
        self.files, self.states = [], []
        for number in range(2, 2 + len(LINKS)):
            self.write_state(number, "configured")
        self.put(HOME, "[Match]\nName=eth0\n\n[Network]\nAddress=192.168.1.11/24\n")
        self.put(WIFI, "[Match]\nName=wlan0\n\n[Network]\nDHCP=no\n")
        interfaces = {name: NetworkInterface(name, number) for number, name in enumerate(LINKS, 2)}
        self.machine = contract.MachineContext(interfaces, booted=True, root=str(root))
        monkeypatch.setattr(commands, "run", self.run)
        monkeypatch.setattr(networkd.time, "sleep", self.sleep)
        monkeypatch.setattr(networkd.time, "monotonic", lambda: self.seconds)
        monkeypatch.setattr(netplan.networkmanager, "NETPLANS", str(root / "none"))
        self.end = networkd.BackEnd(self.machine, {})

    def put(self, path, text):
        place = self.root / path.lstrip("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)

    def write_state(self, number, state):
        file = list(LINKS.values())[number - 2]
        path = "/run/systemd/netif/links/%d" % number
        self.put(path, "ADMIN_STATE=%s\nNETWORK_FILE=%s\n" % (state if file else "unmanaged", file))
        self.states.append(state)
        os.utime(str(self.root / path.lstrip("/")), (len(self.states), len(self.states)))

    def run(self, argv, **_more):
        self.asked.append(" ".join(argv))
        if argv[:2] == ["systemctl", "is-active"]:
            return commands.Answer(0 if self.active else 3, b"", "")
        if argv[:2] == ["systemctl", "restart"]:
            self.files = sorted(str(path.relative_to(self.root)) for path in self.root.rglob("*rosfleet*"))
        if argv[0] == "ip":
            return commands.Answer(0, self.dynamic.encode() if argv[5] == "wlan0" else b"", "")
        version = b"systemd %s (252.39)\n" % self.version.encode()
        return commands.Answer(0, version if argv[0] == "networkctl" else b"", "")

    def sleep(self, seconds):
        """While somebody waits, networkd goes on: one more state."""
        self.seconds += seconds
        if self.late:
            state = self.late.pop(0)
            for number in (2, 3):
                self.write_state(number, state)


@pytest.fixture
def manager(tmp_path, monkeypatch):
    return Manager(tmp_path, monkeypatch)


def restarts(manager):
    return [line for line in manager.asked if "restart" in line]


def test_all_links_are_kept_before_the_restart(manager):
    manager.end.activate(["place"])
    assert restarts(manager) == ["systemctl restart systemd-networkd.service"]
    assert manager.files == sorted(KEPT)  # as they were at that moment
    for path, lines in KEPT.items():
        assert [line for line in (manager.root / path).read_text().splitlines() if not line.startswith("#")] == lines


def test_the_kernel_is_read_after_all_links_are_configured(manager):
    """The states from before the restart are those that stand there at first."""
    manager.late = ["pending", "configuring", "configuring", "configured"]
    manager.end.activate(["place"])
    assert manager.late == [] and manager.seconds == pytest.approx(0.4)


def test_a_link_that_stays_away_is_told(manager):
    manager.late = ["configuring"]
    with pytest.raises(
        Problem, match='60 s after its restart.*eth0 is "configuring", wlan0 is .*networkctl status eth0'
    ):
        manager.end.activate(["place"])


def test_a_link_without_a_cable_is_not_waited_for(manager):
    manager.write_state(3, "configuring")
    manager.late = ["configured"]
    manager.end.activate(["place"])
    assert restarts(manager)


@pytest.mark.parametrize(
    "change, reason",
    [
        ({"version": "247"}, "systemd 247 has no settings by which it keeps foreign rules and routes"),
        ({"dynamic": "3: wlan0    inet 192.168.1.7/24 dynamic wlan0\n"}, "wlan0 may have a lease"),
        ({"active": False}, ""),
    ],
)
def test_where_networkd_is_not_told(manager, change, reason):
    for name, value in change.items():
        setattr(manager, name, value)
    manager.end.activate(["place"])
    assert restarts(manager) == [] and not list(manager.root.rglob("*rosfleet*"))
    assert reason in manager.end.explain_delay() and bool(reason) == bool(manager.end.explain_delay())


@pytest.mark.parametrize(
    "value, waits", [("yes", True), (" ipv4", True), ("true", True), ("no", False), ("false", False), ("", False)]
)
def test_a_lease_that_may_come(manager, value, waits):
    manager.put("/etc/systemd/network/10-eth0.network.d/50-more.conf", "[Network]\nDHCP = %s\n" % value)
    assert bool(manager.end.explain_delay()) == waits


@pytest.mark.parametrize("version, told", [("252", True), ("247", False)])
def test_netplan_leaves_nothing_for_a_reload_of_somebody_else(manager, version, told):
    """The next reload reads the files of `netplan generate`, so they come with the restart, or wait for the boot with it."""
    manager.version = version
    netplan.BackEnd(manager.machine, {}).activate([netplan.FILE])
    known = ("netplan generate", "systemctl restart systemd-networkd.service")
    assert [line for line in manager.asked if line in known] == (list(known) if told else [])
