# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The command to paste is made of what was read on the computer, and holds nothing that a machine could put into it."""

from dataclasses import replace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import HANDS, INVENTORY, write_advices
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.facts import read_rules
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import Rule
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import (
    FAULTS,
    RULED,
    Component,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.commands import (
    COMMANDS,
    CONNTRACK,
    STEPWISE,
    UNTIL,
    make_commands,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    BootDeviation,
    Claim,
    DefaultRoute,
    FilterChain,
    FilterChains,
    FilterRule,
    FullProcess,
    ServiceState,
    SilentNode,
)
from fleets import diagnosed, fig12, observed, update
from mentioned import mentions

NAME = "car-nav"
NETWORK = "the network of car"
MAC = "02:00:00:00:be:ef"
OWN, PLANNED, DHCP = "192.168.12.100", DefaultRoute("eth0", gateway="192.168.12.101"), "192.168.12.1"


def told(change, kind, mode, *whats):
    """The command for a part of car-nav after a change of its probe."""
    fleet = fig12()
    seen = observed(fleet)
    change(seen[NAME].probe)
    run = Verification(CHECKS, fleet, seen)
    return write_advices(
        make_commands([Component(kind, NAME, mode, what) for what in whats or ("",)], run.run[NAME], run.state)
    )


def routes(*found):
    return lambda probe: update(probe, default_routes=found)


def boots(file):
    return lambda probe: update(probe, next_boot=(BootDeviation("sysctl", "net.ipv4.ip_forward", "1", "0", file),))


def dropped(*files):
    units = [ServiceState(name, f"multimaster-{name}.service") for name in ("address", "discovery", "sync")]
    units[-1] = replace(units[-1], differing=("ROS_IP",), drop_ins=files)
    return lambda probe: update(probe, services=tuple(units))


def commanded(*files):
    """A drop-in with another command, on a computer where no variable differs."""
    unit = ServiceState("sync", "multimaster-sync.service", command_drop_ins=files)
    return lambda probe: update(probe, services=(unit,))


def dropped_of_routing(probe):
    """A drop-in of a unit that is no node of ROS, on a computer without such nodes."""
    file = "/etc/systemd/system/multimaster-multicast-routing.service.d/a.conf"
    name = "multicast-routing"
    update(probe, services=(ServiceState(name, f"multimaster-{name}.service", differing=("LANG",), drop_ins=(file,)),))


def interface(**values):
    return lambda probe: update(probe.forwarding.interfaces[0], **values)


@pytest.mark.parametrize(
    ("change", "component", "expected"),
    [
        (interface(mtu=600), ("interface", "mtu", NETWORK), "ip link set dev eth0 mtu 1500"),
        (interface(), ("interface", "mtu", NETWORK), ""),
        (interface(mtu=600, interface="eth0;reboot"), ("interface", "mtu", NETWORK), ""),
        (interface(mtu=600), ("interface", "mtu", "another network"), ""),
        (
            interface(state="down"),
            ("link", "down", NETWORK),
            "ip link set dev eth0 up",
        ),
        (interface(addresses=(), prefixes=()), ("link", "down", NETWORK), ""),
        (
            interface(prefixes=(16,)),
            ("interface", "prefix", ""),
            f"ip address add {OWN}/24 dev eth0; ip address del {OWN}/16 dev eth0",
        ),
        (
            routes(PLANNED, DefaultRoute("eth0", gateway=DHCP, metric="50")),
            ("route", "defaults", ""),
            f"ip route del default via {DHCP} dev eth0 metric 50 (until its link comes up again; a login that comes in by that gateway ends)",
        ),
        (routes(DefaultRoute("eth0", gateway=DHCP), DefaultRoute("eth1", gateway=DHCP)), ("route", "defaults", ""), ""),
        (routes(PLANNED, DefaultRoute("eth0", gateway="1.2.3.4; reboot")), ("route", "defaults", ""), ""),
        (routes(PLANNED, DefaultRoute("eth0", gateway=DHCP, metric="5 x")), ("route", "defaults", ""), ""),
        (
            interface(),
            ("route", "closed", "blackhole 1.2.3.4", "prohibit 1.2.3.5"),
            "ip route del blackhole 1.2.3.4; ip route del prohibit 1.2.3.5",
        ),
        (interface(), ("route", "rule", "priority 5 table 7"), "ip rule del priority 5 table 7"),
        (
            interface(),
            ("names", "several", "dabo-nav", "dabo.nav"),
            r"sed -i -E '/rosfleet.multimaster/! s/^[^#].*[[:space:]](dabo-nav|dabo\.nav)([[:space:]]|$)/# &/' /etc/hosts",
        ),
        (
            boots("/etc/sysctl.d/99-z.conf line 3"),  # as the machine tells it
            ("boot", "sysctl", "net.ipv4.ip_forward"),
            "sed -i -E 's,^[[:space:]]*-?net[./]ipv4[./]ip_forward[[:space:]]*=,# &,' /etc/sysctl.d/99-z.conf",
        ),
        (boots("/etc/sysctl.d/99-z.conf"), ("boot", "sysctl", "net.ipv4.conf.all.rp_filter"), ""),
        (boots("/usr/lib/sysctl.d/50-z.conf"), ("boot", "sysctl", "net.ipv4.ip_forward"), ""),
        (boots("/etc/../bin/z"), ("boot", "sysctl", "net.ipv4.ip_forward"), ""),
        (boots("/etc/a; reboot"), ("boot", "sysctl", "net.ipv4.ip_forward"), ""),
        (
            dropped("/run/systemd/system/multimaster-sync.service.d/a.conf"),
            ("environment", "service", ""),
            "mv /run/systemd/system/multimaster-sync.service.d/a.conf /run/systemd/system/multimaster-sync.service.d/a.conf.off; "
            "systemctl daemon-reload; systemctl restart multimaster-discovery.service multimaster-sync.service",
        ),
        (
            commanded("/run/systemd/system/multimaster-sync.service.d/a.conf"),
            ("sync", "configuration", ""),
            "mv /run/systemd/system/multimaster-sync.service.d/a.conf /run/systemd/system/multimaster-sync.service.d/a.conf.off; "
            "systemctl daemon-reload; systemctl restart multimaster-sync.service",
        ),
        (commanded("/run/systemd/system/multimaster-sync.service.d/a.conf"), ("relay", "configuration", ""), ""),
        (commanded("/run/systemd/system/multimaster-sync.service.d/a.conf"), ("environment", "service", ""), ""),
        (dropped("/run/systemd/system/multimaster-sync.service.d/a.conf"), ("sync", "configuration", ""), ""),
        (
            dropped_of_routing,
            ("environment", "service", ""),
            "mv /etc/systemd/system/multimaster-multicast-routing.service.d/a.conf "
            "/etc/systemd/system/multimaster-multicast-routing.service.d/a.conf.off; "
            "systemctl daemon-reload; systemctl restart multimaster-multicast-routing.service",
        ),
        (dropped("/etc/passwd.conf"), ("environment", "service", ""), ""),
        (dropped("/etc/systemd/system/a.conf;reboot.conf"), ("environment", "service", ""), ""),
        (interface(), ("clock", "off", ""), ""),
    ],
)
def test_what_is_to_be_pasted(change, component, expected):
    assert told(change, *component) == (f"on {NAME}: {expected}" if expected else "")


NETS = "192.168.1.0/24 192.168.10.0/24 192.168.11.0/24 192.168.12.0/24"


def let_in(rule):
    """The command for a rule of each network."""
    return f"for net in {NETS}; do nft insert rule {rule}; done"


@pytest.mark.parametrize(
    ("mode", "what", "origin", "words"),
    [
        (
            "roscore in",
            "11311",
            "inet own input",
            let_in("inet own input ip saddr $net tcp dport 11311 accept"),
        ),
        ("rpc in", "", "inet own input", let_in("inet own input ip saddr $net tcp dport 11611 accept")),
        ("nodes out", "", "ip own out", let_in("ip own out ip daddr $net tcp dport 1024-65535 accept")),
        ("all in", "", "inet own input", let_in("inet own input ip saddr $net accept")),
        # the answers of a roscore come from its port
        (
            "roscore",
            "11311",
            "inet own out",
            "; ".join(let_in(f"inet own out ip saddr $net tcp {port} 11311 accept") for port in ("dport", "sport")),
        ),
        # what goes to the group has the fleet at its source alone
        ("group out", "", "ip own out", let_in("ip own out ip saddr $net ip daddr 224.0.0.0/4 accept")),
        ("group out", "", "ip filter ufw-user-output", "ufw allow out to 224.0.0.0/4"),
        ("forward", "TCP", "inet own forward", let_in("inet own forward ip saddr $net accept")),
        ("all in", "", "ip filter ufw-user-input", "ufw allow from 192.168.1.0/24; "),
        ("forward", "", "ip filter DOCKER-USER", "iptables -I DOCKER-USER -s 192.168.1.0/24 -j ACCEPT; "),
        (
            "all in",
            "",
            "inet firewalld filter_INPUT",
            "firewall-cmd --zone=trusted --add-source=192.168.1.0/24; "
            "firewall-cmd --permanent --zone=trusted --add-source=192.168.1.0/24; ",
        ),
        ("roscore in", "11311; reboot", "inet own input", ""),
        ("all in", "", "inet own in;reboot", ""),
        ("all in", "", "arp own input", ""),
    ],
)
def test_the_fleet_is_let_in_before_the_rule_that_drops(mode, what, origin, words):
    fleet = fig12()
    run = Verification(CHECKS, fleet, observed(fleet))
    component = Component("filter", NAME, mode, what)
    run.state.filters.rules[component] = Rule("in", "drop", origins=(origin,))
    commands = make_commands([component], run.run[NAME], run.state)
    assert (commands[0].text if commands else "").startswith(words) and bool(commands) == bool(words)


@pytest.mark.parametrize("mode", sorted(mode for _kind, mode in RULED))
def test_no_told_rule_has_a_set(mode):
    """In a chain of iptables a set is lost when iptables-save writes the rule down: it accepts the packets of everybody then."""
    fleet = fig12()
    run = Verification(CHECKS, fleet, observed(fleet))
    component = Component("filter", NAME, mode, "11311")
    run.state.filters.rules[component] = Rule("in", "drop", origins=("ip filter INPUT",))
    (advice,) = make_commands([component], run.run[NAME], run.state)
    assert "nft insert rule ip filter INPUT ip " in advice.text and "{" not in advice.text
    assert advice.effect == UNTIL


def test_a_policy_that_drops_has_its_chain():
    (rule,), unclear = read_rules(
        [{"hook": "input", "table": "inet own", "policy": "drop", "rules": [], "unread": 0, "chain": "door"}]
    )
    assert (rule.verdict, rule.origins, unclear) == ("drop", ("inet own door",), frozenset())


@pytest.mark.parametrize(
    ("mode", "what", "words"),
    [
        ("rpc in", "", "iptables -I INPUT -s {} -p tcp --dport 11611 -j ACCEPT"),
        ("nodes out", "", "iptables -I OUTPUT -d {} -p tcp --dport 1024:65535 -j ACCEPT"),
        ("group out", "", "iptables -I OUTPUT -s {} -d 224.0.0.0/4 -j ACCEPT"),
        ("forward", "", "iptables -I FORWARD -s {} -j ACCEPT"),
        ("icmp", "", "iptables -I INPUT -s {0} -p icmp -j ACCEPT; iptables -I OUTPUT -d {0} -p icmp -j ACCEPT"),
        (
            "rpc",
            "",
            "; ".join(
                f"iptables -I {end} {{0}} -p tcp --{port} 11611 -j ACCEPT"
                for end in ("INPUT -s", "OUTPUT -d")
                for port in ("dport", "sport")
            ),
        ),
        ("rpc in", "1; reboot", ""),
    ],
)
def test_without_nft_the_fleet_is_let_in_by_iptables(mode, what, words):
    fleet = fig12()
    seen = observed(fleet)
    update(seen[NAME], filters=FilterChains(False, ()))
    run = Verification(CHECKS, fleet, seen)
    commands = make_commands([Component("filter", NAME, mode, what)], run.run[NAME], run.state)
    networks = NETS.replace(" ", ",")
    assert [one.text for one in commands] == ([words.format(networks)] if words else [])


@pytest.mark.parametrize(
    ("mode", "chains", "words"),
    [
        (
            "roscore in",
            (("input", "inet own", 1, "one"),),
            let_in("inet own one ip saddr $net tcp dport 11311 accept"),
        ),
        ("roscore in", (("input", "inet own", 0, "one"), ("output", "inet own", 1, "two")), ""),
        (
            "rpc",  # packets or their answers: there is one chain that may do it
            (("input", "inet own", 1, "one"), ("output", "inet own", 0, "two")),
            "; ".join(let_in(f"inet own one ip saddr $net tcp {port} 11611 accept") for port in ("dport", "sport")),
        ),
        ("rpc", (("input", "inet own", 1, "one"), ("output", "inet own", 1, "two")), ""),
        (
            "roscore in",
            (("input", "inet own", 1, "one"), ("input", "inet other", 1, "one")),
            "",
        ),  # which of them is not known
        ("forward", (("forward", "ip own", 2, "one"),), let_in("ip own one ip saddr $net accept")),
        ("roscore in", (("input", "inet own", 1, "one; reboot"),), ""),
    ],
)
def test_before_a_rule_that_is_not_understood_the_fleet_is_let_in(mode, chains, words):
    fleet = fig12()
    seen = observed(fleet)
    read = tuple(FilterChain(hook, table, "accept", (), unread, chain) for hook, table, unread, chain in chains)
    update(seen[NAME], filters=FilterChains(True, read))
    run = Verification(CHECKS, fleet, seen)
    commands = make_commands([Component("filter", NAME, mode)], run.run[NAME], run.state)
    assert [one.text for one in commands] == ([words] if words else [])


FAIL2BAN = FilterChain("input", "inet f2b-table", "accept", (), 1, "f2b-chain")
DOCKER_NAT = FilterChain("output", "ip nat", "accept", (), 1, "OUTPUT")


@pytest.mark.parametrize(
    ("mode", "unread", "other"),
    [
        ("roscore in", FAIL2BAN, FilterChain("input", "inet own", "drop", (), 0, "inp")),
        ("roscore out", DOCKER_NAT, FilterChain("output", "inet own", "accept", (FilterRule("drop"),), 0, "out")),
        ("roscore in", FAIL2BAN, FilterChain("input", "inet own", "accept", (FilterRule("reject"),), 0, "inp")),
    ],
)
def test_beside_a_chain_that_may_drop_one_that_is_not_understood_gets_no_rule(mode, unread, other):
    fleet = fig12()
    seen = observed(fleet)
    run = Verification(CHECKS, fleet, seen)
    for chains, count in (((unread, other), 0), ((replace(other, policy="accept", rules=()), unread), 1)):
        update(seen[NAME], filters=FilterChains(True, chains))
        assert len(make_commands([Component("filter", NAME, mode)], run.run[NAME], run.state)) == count


def test_a_node_that_is_fenced_by_a_rule_that_is_not_understood_is_let_in():
    fleet = fig12()
    seen = observed(fleet)
    update(seen[NAME], filters=FilterChains(True, (FilterChain("input", "inet own", "accept", (), 1, "one"),)))
    run = Verification(CHECKS, fleet, seen)
    (advice,) = make_commands([Component("node", NAME, "fenced", "/talker")], run.run[NAME], run.state)
    assert advice == (NAME, let_in("inet own one ip saddr $net tcp dport 1024-65535 accept"), UNTIL)
    update(seen[NAME], filters=FilterChains(True, ()))
    assert not make_commands([Component("node", NAME, "fenced", "/talker")], run.run[NAME], run.state)


def test_a_stale_sync_node_starts_again_and_passes_a_rule_that_is_not_understood():
    fleet = fig12()
    seen = observed(fleet)
    run = Verification(CHECKS, fleet, seen)
    restart = "systemctl restart multimaster-sync"
    own = FilterChain("output", "inet own", "accept", (), 1, "one")
    rule = let_in("inet own one ip daddr $net tcp dport 1024-65535 accept")
    for filters, words in (
        (None, [restart]),
        (FilterChains(False, ()), [restart]),
        (FilterChains(True, (replace(own, unread=0),)), [restart]),
        (FilterChains(True, (own,)), [restart, f"{rule}; {restart}"]),
    ):
        update(seen[NAME], filters=filters)
        found = make_commands([Component("sync", NAME, "stale", "dabo")], run.run[NAME], run.state)
        assert [one.text for one in found] == words
    assert found[1].effect.endswith(UNTIL)


def masquerading(**values):
    rule = FilterRule("masquerade", leaving="eth0", chain=values.pop("chain", "post"))
    return FilterChain("postrouting", values.pop("table", "inet own"), "accept", (rule,), **values)


@pytest.mark.parametrize(
    ("chains", "words"),
    [
        (
            (masquerading(),),
            f"for from in {NETS}; do for to in {NETS}; do "
            f"nft insert rule inet own post ip saddr $from ip daddr $to accept; done; done; {CONNTRACK}",
        ),
        ((FilterChain("forward", "inet own"),), CONNTRACK),  # no rule is left
        ((masquerading(unread=1),), ""),
        ((masquerading(chain="a; reboot"),), ""),
    ],
)
def test_what_masquerades_leaves_out_the_robots(chains, words):
    fleet = fig12()
    seen = observed(fleet)
    update(seen[NAME], filters=FilterChains(True, chains))
    run = Verification(CHECKS, fleet, seen)
    commands = make_commands([Component("translation", NAME, "on")], run.run[NAME], run.state)
    assert [one.text for one in commands] == ([words] if words else [])


FULL = FullProcess("rosbridge", 4711, "robot.service", 1024, 1024)


@pytest.mark.parametrize(
    ("entry", "where", "words"),
    [
        (FULL, NAME, "mkdir -p /etc/systemd/system/robot.service.d; printf '[Service]\\nLimitNOFILE=65536\\n' > "),
        (
            replace(FULL, person="ann"),
            NAME,
            "mkdir -p /etc/systemd/user/robot.service.d; printf '[Service]\\nLimitNOFILE=65536\\n' > "
            "/etc/systemd/user/robot.service.d/more-files.conf; runuser -u ann -- ",
        ),
        (replace(FULL, unit="session-4.scope"), HANDS, "end the process 4711 on car-nav"),
        (replace(FULL, unit="a b.service; reboot"), HANDS, "end the process 4711 on car-nav"),
    ],
)
def test_a_program_without_files_to_open_gets_more(entry, where, words):
    def change(seen):
        update(seen[NAME].probe, full_processes=(entry,))

    (found,) = diagnosed(change, fig12()).findings
    assert found.component.fault.id == "RF-125"
    assert [(one.where, one.text.startswith(words)) for one in found.do] == [(where, True)]


def test_the_second_holder_of_an_address_is_named_with_its_hardware_address():
    def change(seen):
        update(
            seen["car-visio"].probe, claims=(Claim(OWN, "eth0", (seen[NAME].probe.forwarding.interfaces[0].mac, MAC)),)
        )

    (found,) = diagnosed(change, fig12()).findings
    assert found.component.fault.id == "RF-215"
    assert [one.where for one in found.do] == [HANDS]
    assert mentions(found.do[0].text, MAC, OWN)
    assert [(one.where, one.text) for one in found.look] == [("car-visio", f"arping -b -c 3 -I eth0 {OWN}")]


def test_a_computer_of_the_fleet_that_answers_for_an_address_of_another_one_is_named():
    fleet = fig12()
    seen = observed(fleet)
    other = seen["dabo-nav"].probe.forwarding.interfaces[0].mac
    update(seen["car-visio"].probe, claims=(Claim(OWN, "eth0", (other,)),))
    run = Verification(CHECKS, fleet, seen)
    (told_of,) = make_commands([Component("interface", NAME, "duplicate")], run.run[NAME], run.state)
    assert told_of.where == HANDS and mentions(told_of.text, "dabo-nav", OWN, "proxy_arp")


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        (', "robot.service"', ["systemctl disable --now robot.service"]),
        (", robot.service", ["systemctl disable --now robot.service"]),
        (
            ", robot.service of ann",
            [
                "runuser -u ann -- env XDG_RUNTIME_DIR=/run/user/$(id -u ann) systemctl --user disable --now robot.service"
            ],
        ),
        (', "robot.service" of "ann;reboot"', []),
        (', "ssh.service"', []),
        (', "user@1000.service"', []),
        (', "session-3.scope"', []),
        ("", []),
    ],
)
def test_the_unit_of_another_roscore_is_stopped(unit, words):
    run = Verification(CHECKS, fig12(), observed(fig12()))
    process = f'TCP port 11311: "roscore" (pid 5, user "ubuntu"{unit}), but the plan has multimaster-roscore.service'
    commands = make_commands([Component("set_up", NAME, "others", process)], run.run[NAME], run.state)
    assert [one.text for one in commands] == words


@pytest.mark.parametrize(
    ("service", "words"),
    [("chrony", ["chronyc makestep"]), ("systemd-timesyncd", ["systemctl restart systemd-timesyncd"]), ("ntpd", [])],
)
def test_a_clock_is_set_by_its_own_time_service(service, words):
    fleet = fig12()
    seen = observed(fleet)
    update(seen[NAME].probe.clock, service=service)
    run = Verification(CHECKS, fleet, seen)
    commands = make_commands([Component("clock", NAME, "off")], run.run[NAME], run.state)
    assert [one.text for one in commands] == words


@pytest.mark.parametrize(("port", "is_known"), [(41233, True), (0, False)])
def test_a_stopped_node_is_found_by_its_port(port, is_known):
    fleet = fig12()
    seen = observed(fleet)
    update(seen[NAME].probe.exchange, silences=(SilentNode("/camera", NAME, port=port),))
    run = Verification(CHECKS, fleet, seen)
    commands = make_commands([Component("node", NAME, "hung", "/camera")], run.run[NAME], run.state)
    assert [f"'sport = :{port}'" in one.text for one in commands] == [True] * is_known


def test_nothing_is_known_of_whom_nobody_looked_at():
    fleet = fig12()
    run = Verification(CHECKS, fleet, {})
    assert make_commands([Component("link", NAME, "down", NETWORK)], None, run.state) == ()


def test_a_finding_has_its_command_first():
    def change(seen):
        update(seen[NAME].probe, default_routes=(PLANNED, DefaultRoute("eth0", gateway=DHCP)))

    [found] = diagnosed(change, fig12()).findings
    command, lasting, _site = found.do
    assert (command.where, command.text) == (NAME, f"ip route del default via {DHCP} dev eth0 metric 0")
    assert lasting.where == INVENTORY


def test_each_row_is_of_a_fault():
    assert {*COMMANDS, *STEPWISE} <= set(FAULTS)
