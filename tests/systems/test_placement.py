# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The master on any computer of a robot: ana's is on its gateway, bob's on an inner computer (inventory: placement/).

First by unicast, since no router passes 224.0.0.1 on; then by a routable group, which the gateways pass on. The order of
the tests is that of a day.
"""

import itertools
import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from proofs.proof import NODES, wait_for

NAME = "systems-placement"
INVENTORY = Path(__file__).with_name("placement")
COMPUTERS = {"ana": ("ana-gate", "ana-arm"), "bob": ("bob-nav", "bob-gate", "bob-arm")}
MASTERS = {"ana": "ana-gate", "bob": "bob-nav"}
GATEWAYS = ("ana-gate", "bob-gate")
GROUP = "239.255.11.11"
ROUTED = {
    "multimaster_multicast_routing": "smcroute",
    "multimaster_multicast_group": GROUP,
    "multimaster_transport": "multicast",
}
UNIT = "multimaster-multicast-routing.service"
AT_ONCE = 4  # most of it is waiting for command-line tools to start


@pytest.fixture(scope="module")
def lab(new_lab):
    """The lab after site.yml, with an ordinary publisher and an ordinary service on every computer."""
    with new_lab(NAME, INVENTORY) as found:
        apply(found)
        for host in itertools.chain(*COMPUTERS.values()):
            start_nodes(found, host)
        yield found


def apply(lab, **variables):
    status, output = lab.play("site.yml", variables=variables)
    assert status == 0, output


def label(host):
    """A computer's name as ROS allows it in a graph name."""
    return host.replace("-", "_")


def start_nodes(lab, host):
    """An ordinary publisher and an ordinary service, as units that are not there any more after a restart."""
    commands = {
        "talker": f"rostopic pub -r 5 /{label(host)}/test std_msgs/Int32 1 __name:={label(host)}_talker",
        "server": f"python3 /tmp/server.py {label(host)}_server",
    }
    runs = [f"systemd-run --quiet --collect --unit {unit} bash -lc 'exec {line}'" for unit, line in commands.items()]
    script = " && ".join(["cat > /tmp/server.py", *runs])
    lab.run(
        host,
        f"systemctl stop talker server 2>/dev/null; {script}",
        stdin=(NODES / "programs/service_server.py").read_text(),
    )


def online(lab):
    """The names that each master lists as online: robot -> names."""
    found = {}
    for robot, master in MASTERS.items():
        listed = lab.run(master, "rosservice call /master_discovery/list_masters", check=False)
        found[robot] = sorted(re.findall(r"name: \"?([\w-]+)\"?(?:(?!name:).)*?\n    online: True", listed, re.DOTALL))
    return found


def expect_online(lab):
    """Each master lists both."""
    both = {robot: sorted(MASTERS.values()) for robot in MASTERS}
    ok, seen = wait_for(lambda: json.dumps(online(lab)), lambda text: json.loads(text) == both, 60)
    assert ok, seen


def expect_exchange(lab, of=None):
    """Every computer (or this one and every other) hears the topic, and calls the service, of those of the other robot."""
    topics = {f"/{label(host)}/test" for hosts in COMPUTERS.values() for host in hosts}
    services = {f"/{label(host)}_server/where" for hosts in COMPUTERS.values() for host in hosts}
    for master in MASTERS.values():
        ok, seen = wait_for(
            lambda master=master: lab.run(master, "rostopic list; rosservice list"),
            lambda text: topics | services <= set(text.split()),
        )
        assert ok, f"{master} knows only {seen.split()}"

    def look(pair):
        here, there = pair
        command = f"timeout -k 5 20 rostopic echo -n 1 /{label(there)}/test; timeout -k 5 20 rosservice call /{label(there)}_server/where"
        seen = lab.run(here, command, check=False)
        return None if "data: 1" in seen and f'message: "{there}"' in seen else f"{there} -> {here}: {seen!r}"

    pairs = [
        pair
        for one, other in itertools.permutations(COMPUTERS.values())
        for pair in itertools.product(one, other)
        if of is None or of in pair
    ]
    with ThreadPoolExecutor(max_workers=AT_ONCE) as pool:
        assert [problem for problem in pool.map(look, pairs) if problem] == []


def state_of(lab, robot):
    """The document that a robot's discovery serves (masterInfo)."""
    address = "192.168.20.21" if robot == "ana" else "192.168.22.100"
    call = f"xmlrpc.client.ServerProxy('http://{address}:11611').masterInfo()"
    return json.loads(lab.run("ana-arm", f'python3 -c "import json, xmlrpc.client; print(json.dumps({call}))"'))


def send(lab, host, source, group):
    """Send a datagram that no discovery takes, and every discovery that hears it logs with its sender."""
    lab.run(
        host,
        "python3 -",
        stdin=f"""
import socket
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("{source}"))
sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 20)
sender.sendto(b"R" + bytes(23), ("{group}", 11511))
""",
    )


def test_the_master_may_be_on_gateway_or_inner_computer(lab):
    expect_online(lab)
    expect_exchange(lab)


def test_a_node_belongs_to_the_robot_that_it_was_started_on(lab):
    """Local are the nodes of all computers of a robot, and what came from the other robot is not given back."""
    for robot in COMPUTERS:
        _stamp, _local, _uri, name, publishers, _subscribers, services, _types, nodes, _providers = state_of(lab, robot)
        assert name == MASTERS[robot]
        of = {node: (origin, locality) for node, _uri, origin, _pid, locality in nodes}
        for owner, hosts in COMPUTERS.items():
            expected = (f"http://{MASTERS[owner]}:11311/", "local" if owner == robot else "remote")
            for host in hosts:
                talker, server = f"/{label(host)}_talker", f"/{label(host)}_server"
                assert of[talker] == of[server] == expected
                assert dict(publishers)[f"/{label(host)}/test"] == [talker]
                assert dict(services)[f"{server}/where"] == [server]
        log = lab.run(MASTERS[robot], "journalctl --unit multimaster-sync --output cat")
        own = [line for line in log.splitlines() if re.search(rf"of /{robot}_\w+", line)]
        assert own == [], "the own nodes were taken from the other robot"
        errors = f"xmlrpc.client.ServerProxy('http://{MASTERS[robot]}:11611').masterErrors()[1]"
        assert lab.run("ana-arm", f'python3 -c "import xmlrpc.client; print({errors})"').strip() == "[]"


def test_discovery_is_pinned_to_the_common_interface(lab):
    """A gateway hears the group on the common network alone, and 224.0.0.1 stays in the network where it was sent."""
    sockets = lab.run("ana-gate", "ss -ulnH 'sport = :11511'")
    assert set(re.findall(r"(\S+):11511", sockets)) == {"192.168.20.21", "224.0.0.1"}
    since = lab.run("ana-gate", "date +%s").strip()
    send(lab, "ana-arm", "192.168.21.102", "224.0.0.1")
    send(lab, "bob-nav", "192.168.22.100", "224.0.0.1")
    send(lab, "bob-gate", "192.168.20.22", "224.0.0.1")
    ok, seen = wait_for(
        lambda: lab.run("ana-gate", f"journalctl --unit multimaster-discovery --output cat --since @{since}"),
        lambda text: "a datagram from" in text,
        30,
    )
    assert re.findall(r"a datagram from ([\d.]+):", seen) == ["192.168.20.22"], seen


def test_an_inner_masters_computer_is_found_after_a_restart(lab):
    lab.reboot("bob-nav")
    lab.wait_until_up("bob-nav")
    expect_online(lab)
    for host in COMPUTERS["bob"]:  # their roscore is another one, and ROS's nodes do not register again
        start_nodes(lab, host)
    expect_exchange(lab, of="bob-nav")


def test_the_gateways_pass_the_group_on(lab):
    apply(lab, **ROUTED)
    for master in MASTERS.values():
        parameters = json.loads(lab.run(master, "cat /etc/rosfleet-multimaster/master_discovery.json"))
        assert parameters["robot_hosts"] == [] and parameters["mcast_group"] == GROUP
    expect_online(lab)
    for gateway in GATEWAYS:
        routes = lab.run(gateway, "ip mroute")
        assert f"(192.168.22.100,{GROUP})" in routes and f"(192.168.20.21,{GROUP})" in routes, routes
    expect_exchange(lab)


def test_the_multicast_router_is_in_its_sandbox(lab):
    for gateway in GATEWAYS:
        said = lab.run(gateway, f"systemd-analyze security --no-pager {UNIT} | tail -n 1")
        rating = float(said.partition(": ")[2].split()[0])
        print(f"\n{gateway}, {UNIT}: {rating}")
        assert rating <= 3.0
        status = lab.run(gateway, f"cat /proc/$(systemctl show --value -p MainPID {UNIT})/status")
        assert int(re.search(r"CapEff:\t(\w+)", status)[1], 16) == 1 << 12 | 1 << 13  # CAP_NET_ADMIN, CAP_NET_RAW


def test_a_restarted_gateway_passes_the_group_on_again(lab):
    lab.halt("bob-gate")
    ok, seen = wait_for(lambda: " ".join(online(lab)["ana"]), lambda text: text == "ana-gate", 60)
    assert ok, seen
    lab.podman("start", "bob-gate")
    lab.wait_until_up("bob-gate")
    start_nodes(lab, "bob-gate")
    expect_online(lab)
    expect_exchange(lab, of="bob-gate")


def test_another_router_on_a_gateway_is_named_before_any_change(lab):
    lab.run("bob-gate", "systemctl start smcroute")
    status, output = lab.play("site.yml", variables=ROUTED)
    lab.run("bob-gate", "systemctl stop smcroute")
    assert status != 0
    assert "bob-gate: smcroute.service passes multicast on already" in output


def test_without_the_routing_nothing_of_it_is_left(lab):
    apply(lab)
    for gateway in GATEWAYS:
        left = f"systemctl cat {UNIT}; ls /etc/rosfleet-multimaster/smcroute.conf /var/lib/rosfleet-multimaster/*multicast*; tail -n +2 /proc/net/ip_mr_vif"
        assert lab.run(gateway, f"({left}) 2>/dev/null", check=False) == ""
    expect_online(lab)
