# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The observations of a simulated verification: what fleet_report gets of the computers of a run."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.facts import HOOKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import ACCEPT
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_rules
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.preflight import MachineState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe import observations as seen
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome

from tests.simulator import people
from tests.simulator.network import CONNECTED, Network
from tests.simulator.ros import Ros
from tests.simulator.state import RUNS

WITHOUT_NFT = 0.5  # of all computers
NO_ROS = "there is no command rostopic in the PATH of /etc/rosfleet-multimaster/environment; install it"


def observe(state, run=None, seed=0):
    """The observations of the computers of a run (default: all), by name."""
    run = [name for name in state.fleet.computers if run is None or name in run]
    there = [name for name in run if state.world.machines[name].on and name not in state.shut]
    network = Network(state, seed, there)
    ros = Ros(network, there)
    started = [name for name in there if _talks(state, ros, name)]
    listeners = {name for name in there if state.fleet.computers[name].listens}
    return {name: _of(state, network, ros, name, name in there, started, listeners) for name in run}


def _talks(state, ros, name):
    """The report of the talker's start: systemd has started it."""
    return bool(state.fleet.computers[name].robot) and name not in state.without_ros | state.bare


def _of(state, network, ros, name, there, started, listeners):
    if not there:
        problem = "Failed to connect to the host via ssh: Connection timed out"
        return seen.Observation(unreachable=True, problem=problem)
    plan = state.fleet.computers[name]
    measured = network.multicast(name, listeners) if name in listeners else None
    return seen.Observation(
        multicast=measured,
        probe=_router(network, name) if plan.is_router else _probe(state, network, ros, name, started),
        packet_filter=_filter(state, name) if plan.firewall else None,
        filters=_filters(state, network, name),
        found=MachineState(set_up=name not in state.bare),
    )


def _filter(state, name):
    """The comparison of the collection's rules with the plan. Rules of others are not looked at."""
    return seen.FilterState(msg="The rules of nftables were right.")


def _filters(state, network, name):
    """The rules of others, where nft is there to tell them: on every second computer."""
    if network.chance("nft", name) < WITHOUT_NFT:
        return seen.FilterChains()
    own = make_rules(state.fleet, state.fleet.computers[name])
    chains = {}
    for rule in state.world.machines[name].rules:
        if rule not in own:
            chains.setdefault(rule.chain, []).append(_rule(rule))
    hooks = {chain: hook for hook, chain in HOOKS.items()}
    found = (seen.FilterChain(hooks[chain], "inet others", ACCEPT, tuple(listed)) for chain, listed in chains.items())
    return seen.FilterChains(True, tuple(found))


def _rule(rule):
    return seen.FilterRule(
        verdict=rule.verdict,
        protocol=rule.protocol,
        ports=rule.ports,
        sources=tuple(map(str, rule.sources)),
        destinations=tuple(map(str, rule.destinations)),
        incoming=rule.incoming,
        leaving=rule.leaving,
        state=rule.state,
        above=rule.above,
    )


def _network(network, name, by_name):
    return {
        "members": network.members_seen(name, by_name),
        "claims": network.claims(name),
        "default_routes": network.default_routes(name),
        "forwarding": network.forwarding(name),
    }


def _router(network, name):
    return seen.Probe(
        **_network(network, name, by_name=False),
        roscore=seen.RoscoreAnswer(error="not looked at"),
        ros_missing="not looked at",
        exchange=seen.Exchange(error="not looked at"),
    )


def _probe(state, network, ros, name, started):
    plan = state.fleet.computers[name]
    missing = NO_ROS if name in state.without_ros | state.bare else ""
    error, robot, _large = ros.asks(name)
    uri = ros.environment(name).get("ROS_MASTER_URI", "")
    # rostopic ends at once where it is refused, and waits where nothing comes back.
    talks = not missing and (not error or error.endswith(("timed out", "within 2 s")))
    outcome = next((found for text, found in CONNECTED.items() if text and error.endswith(text)), Outcome.FAILED)
    return seen.Probe(
        **_network(network, name, by_name=True),
        masters=ros.masters_seen(name),
        roscore=seen.RoscoreAnswer(uri, "" if error else ros.uri(robot), error, outcome),
        list_masters=seen.MasterList(error=missing) if missing else ros.list_masters(name),
        topics=ros.topics(name, started),
        outsiders=ros.outsiders(name),
        sources=ros.sources(name) if plan.is_master else (),
        exchange=ros.exchange(name) if plan.is_master else seen.Exchange(error="not looked at"),
        parameters=ros.parameters(name) if plan.is_master else seen.NodeParameters(),
        clock=seen.ClockState(name not in state.undisciplined),
        disks=(seen.Disk("/var/log", 0 if name in state.full else 10**9, 10**6),),
        services=tuple(_service(state, name, service) for service in _services(plan)),
        talker=seen.Talker(talks, "" if talks else missing or "ERROR: Unable to communicate with master!"),
        ros_missing=missing,
        node_hosts=people.processes(state, name),
        unregistered=people.unregistered(ros, name),
    )


def _services(plan):
    return plan.all_services


def _service(state, name, service):
    """A service as systemd says it: a hung one is active."""
    its = state.robots[state.fleet.computers[name].robot]
    runs = {"roscore": its.roscore, "discovery": its.discovery, "sync": its.sync}.get(service, RUNS)
    dead = runs == "dead" or service in state.down.get(name, ())
    differing = () if service not in ("roscore", "discovery", "sync") else state.differing.get(name, ())
    active, sub = ("failed", "failed") if dead else ("active", "running")
    if name in state.bare:
        return seen.ServiceState(service, f"multimaster-{service}.service", "not-found", "inactive", "dead", 0)
    return seen.ServiceState(
        service, f"multimaster-{service}.service", "loaded", active, sub, 0, () if dead else differing
    )
