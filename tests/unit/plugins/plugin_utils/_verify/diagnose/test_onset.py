# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Since when something is broken: only what decides the fault is told."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.check_context import FleetState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.onset import describe_onset
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    BootDeviation,
    FilterChain,
    FilterChains,
    FilterRule,
    ForwardingInterface,
    ForwardingSettings,
    RecentChange,
    ServiceState,
)
from fleets import diagnosed, fig12, no_answer, observed, of, update
from mentioned import mentions

GATE, INNER, OTHER = "tibi-visio", "tibi-nav", "car-visio"
WHEN, SERVICE_WHEN = "2026-11-22 09:12:44 UTC", "Sun 2026-11-22 09:12:44 UTC"
SYSCTL = "/etc/sysctl.d/9.conf line 3"
COMMON = "the common network"


def onset(component, change=None):
    """The words about a part, after a change of the probe at its place."""
    fleet = fig12()
    seen = observed(fleet)
    if change:
        change(seen[component.place].probe)
    state = FleetState(fleet, seen)
    return describe_onset(component, state.run.get(component.place), state)


def with_services(probe):
    update(
        probe,
        services=(
            ServiceState("discovery", "multimaster-discovery.service", since=SERVICE_WHEN),
            ServiceState("address", "multimaster-address.service", since=SERVICE_WHEN),
            ServiceState("sync", "multimaster-sync.service", differing=("ROS_IP",), since=SERVICE_WHEN),
        ),
    )


@pytest.mark.parametrize(
    ("component", "expected"),
    [
        (("discovery", GATE, "dead"), f"it ended {SERVICE_WHEN}"),
        (("discovery", GATE, "group"), f"it was started {SERVICE_WHEN}"),
        (("discovery", GATE, "hung"), ""),  # some time after its start
        (("service", GATE, "full", "multimaster-address.service"), ""),
        (("service", GATE, "down", "multimaster-address.service"), f"it ended {SERVICE_WHEN}"),
        (("service", GATE, "restarting", "multimaster-address.service"), f"it was started {SERVICE_WHEN}"),
        (("environment", GATE, "service", "ROS_IP"), f"it was started {SERVICE_WHEN}"),
        (("roscore", GATE, "dead"), ""),  # not among the services
        (("computer", GATE, "off"), ""),
    ],
)
def test_a_service_has_a_time_of_its_own(component, expected):
    assert onset(Component(*component), with_services) == expected


def test_nobody_knows_where_nobody_looked():
    assert onset(Component("network", COMMON, "dead")) == ""
    assert onset(Component("discovery", GATE, "dead")) == ""


def test_a_link_has_the_journal_and_its_changes():
    def change(probe):
        down = ForwardingInterface("eth0", state="down", last="2026-11-22T09:12:44+0000 a kernel: eth0: Link is Down")
        flaps = ForwardingInterface("wlan0", state="up", carrier_changes=77)
        update(probe, forwarding=ForwardingSettings(1, (down, flaps)))

    assert mentions(
        onset(Component("link", GATE, "flapping"), change), "eth0", "2026-11-22T09:12:44+0000", "wlan0", "77"
    )


# Settings, routes and the next boot: by the file that decides


@pytest.mark.parametrize(
    ("component", "name", "found", "told"),
    [
        (("forwarding", GATE, "off"), "net.ipv4.ip_forward", f"{SYSCTL} sets 0", True),
        (("forwarding", GATE, "off"), '"net.ipv4.ip_forward"', f'"{SYSCTL} sets 0"', True),
        (("forwarding", GATE, "off"), "net.ipv4.conf.all.rp_filter", f"{SYSCTL} sets 0", False),
        (("reverse_path", GATE, "strict"), "net.ipv4.conf.all.rp_filter", f"{SYSCTL} sets 1", True),
        (("reverse_path", GATE, "strict"), "net.ipv4.conf.all.rp_filter", f"{SYSCTL} sets 0", False),
        (("reverse_path", GATE, "strict"), "net.ipv4.conf.all.rp_filter", f"{SYSCTL} sets 10", False),
        (("forwarding", GATE, "off"), "net.ipv4.ip_forward", "no file sets it", False),
        (("boot", GATE, "sysctl", "net.ipv4.ip_forward"), "net.ipv4.ip_forward", f"{SYSCTL} sets 0", True),
        (("boot", GATE, "sysctl", "net.ipv4.ip_forward"), "net.ipv4.conf.all.rp_filter", f"{SYSCTL} sets 0", False),
        (("boot", GATE, "route"), "net.ipv4.ip_forward", f"{SYSCTL} sets 0", False),
        (("setting", GATE, "icmp_all"), "net.ipv4.ip_forward", f"{SYSCTL} sets 0", False),
    ],
)
def test_a_file_counts_that_sets_the_wrong_value(component, name, found, told):
    def change(probe):
        update(probe, next_boot=(BootDeviation("sysctl", name, "?", found, SYSCTL, WHEN),))

    assert onset(Component(*component), change) == (f"{SYSCTL} was changed {WHEN}" if told else "")


@pytest.mark.parametrize(
    ("what", "name", "told"),
    [
        ("", "192.168.12.0/24 by 192.168.1.203", True),
        ("the network of car", "192.168.12.0/24 by 192.168.1.203", True),
        ("the network of car", "default by 192.168.1.254", True),
        ("the network of dabo", "192.168.12.0/24 by 192.168.1.203", False),
        ("the network of nobody", "default by 192.168.1.254", False),
        ("the network of car", "$(reboot) by 192.168.1.203", False),
        ("the network of car", "192.168.12.0/99", False),
    ],
)
def test_a_file_counts_that_names_the_destination(what, name, told):
    def change(probe):
        update(probe, next_boot=(BootDeviation("route", name, "?", "?", "/etc/netplan/9.yaml", WHEN),))

    expected = f"/etc/netplan/9.yaml was changed {WHEN}" if told else ""
    assert onset(Component("route", GATE, "missing", what), change) == expected
    assert (
        onset(Component("route", GATE, "other", what), change) == ""
    )  # another route comes first, and no file of ours makes it


# Names: by the line that decides


@pytest.mark.parametrize(
    ("addresses", "in_file", "told"),
    [
        (("127.0.1.1",), ("127.0.1.1",), True),
        (("192.168.12.100", "10.0.0.9"), ("192.168.12.100", "10.0.0.9"), True),
        (("10.0.0.9",), (), False),  # a name server says so
        (("10.0.0.9",), ("192.168.12.100",), False),
    ],
)
def test_the_file_of_names_counts_by_its_line(addresses, in_file, told):
    def change(probe):
        update(of(probe.members, "car-nav"), addresses=addresses, file_addresses=in_file)
        update(
            probe,
            changes=(
                RecentChange("names", "/etc/hosts", when=WHEN),
                RecentChange("order", "/etc/nsswitch.conf", when=WHEN),
            ),
        )

    for mode in ("loopback", "old", "several"):
        assert onset(Component("names", GATE, mode, "car-nav"), change) == (
            f"/etc/hosts was changed {WHEN}" if told else ""
        )
    assert onset(Component("names", GATE, "order"), change) == f"/etc/nsswitch.conf was changed {WHEN}"
    assert onset(Component("names", GATE, "rights"), change) == ""  # rights have no date


# Packet filters: by the table of the rule that drops

CHANGES = (
    RecentChange("ufw", "/etc/ufw/user.rules", when=WHEN),
    RecentChange("docker", "docker.service", "was started", SERVICE_WHEN),
    RecentChange("table inet filter", "/etc/nftables.conf", when=WHEN),
)
UFW, DOCKER = f"/etc/ufw/user.rules was changed {WHEN}", f"docker.service was started {SERVICE_WHEN}"
NFTABLES = f"/etc/nftables.conf was changed {WHEN}"
DROP = {"verdict": "drop", "protocol": "icmp", "state": "new"}
ACCEPT = {"verdict": "accept", "protocol": "igmp"}


@pytest.mark.parametrize(
    ("table", "policy", "chains", "expected"),
    [
        ("ip filter", "accept", ["ufw-user-input"], UFW),
        ("ip filter", "accept", ["DOCKER-USER"], DOCKER),
        ("inet filter", "accept", ["input"], NFTABLES),
        ("inet fault", "accept", ["one"], ""),  # a table of its own: no file says so
        ("ip filter", "accept", ["INPUT"], ""),
        ("ip filter", "drop", ["ufw-before-input", "ufw-user-input"], UFW),  # the policy of a chain that is ufw's
        ("ip filter", "drop", ["ufw-user-input", "DOCKER-USER"], ""),  # nobody knows whose
        ("inet fault", "drop", [], ""),
    ],
)
def test_a_filter_counts_by_its_table(table, policy, chains, expected):
    rules = tuple(FilterRule(**(ACCEPT if policy == "drop" else DROP), chain=chain) for chain in chains)

    def change(seen):
        update(seen[OTHER], filters=FilterChains(True, (FilterChain("input", table, policy, rules),)))
        update(seen[OTHER].probe, changes=CHANGES)
        for name, one in seen.items():
            for member in one.probe.members:
                if name != OTHER and member.name == OTHER and member.ping_address is not None:
                    lost = no_answer()
                    update(member, ping_address=lost, ping_name=lost, ping_large=None, loss=1.0)

    (finding,) = diagnosed(change, fig12()).findings
    assert (finding.component.kind, finding.component.place) == ("filter", OTHER)
    assert finding.since == expected


def test_a_filter_that_no_rule_shows_has_no_date():
    assert onset(Component("filter", OTHER, "icmp in"), lambda probe: update(probe, changes=CHANGES)) == ""
