# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Registered results are read as observations."""

import re

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.filters import UNKNOWN_TYPES
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.facts import read_rules
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import ANSWER, IN, MASQUERADE, NAT
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import computer, programs
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.actual_world import DOWN
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe import observations, task_results
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    Multicast,
    Observation,
    Probe,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import fig12


def _read(variables, multicast, probe, earlier, packet_filter=""):
    tasks = {"multicast": multicast, "probe": probe, "earlier": earlier, "packet_filter": packet_filter}
    return task_results.read_observation("kobuki1computer", variables, tasks)


def test_registered_results_become_an_observation():
    good = {"verify_multicast": {"udp": []}, "verify_probe": {"members": []}, "multimaster_info": {"changed": False}}
    seen = _read(good, "verify_multicast", "verify_probe", ["multimaster_info"])
    assert seen == Observation(Multicast(), Probe())
    together = {"verify_probe": {"members": [], "multicast": {"udp": []}}, "multimaster_info": {"changed": False}}
    assert _read(together, "verify_probe.multicast", "verify_probe", ["multimaster_info"]) == seen
    half = {"verify_probe": {"members": [], "multicast": {"failed": True, "msg": "No helper."}}}
    assert _read(half, "verify_probe.multicast", "verify_probe", []) == Observation(
        probe=Probe(), problem='"No helper."'
    )
    filtered = {**good, "verify_filter": {"members": [], "changed": True, "msg": "would be changed"}}
    seen = _read(filtered, "verify_multicast", "verify_probe", [], "verify_filter")
    assert (seen.packet_filter.changed, seen.packet_filter.msg) == (True, '"would be changed"')
    skipped = {**good, "verify_filter": {"changed": False, "skipped": True}}
    assert _read(skipped, "verify_multicast", "verify_probe", [], "verify_filter").packet_filter is None
    down = {"multimaster_info": {"unreachable": True, "msg": "no route\n to host"}}
    assert _read(down, "verify_multicast", "verify_probe", ["multimaster_info"]) == Observation(
        unreachable=True, problem='"no route to host"'
    )
    broken = {
        **good,
        "verify_talker": {"failed": True, "msg": "Cannot start."},
        "verify_probe": {"failed": True, "msg": "x"},
    }
    assert _read(broken, "verify_multicast", "verify_probe", ["verify_talker"]) == Observation(
        Multicast(), problem='"Cannot start."'
    )


def test_outcomes_are_words_that_need_no_sentence():
    """A sentence of a robot stands in quotes, so nothing is decided by it."""
    ping = {
        "ok": False,
        "error": "192.168.1.201 reports: host unreachable",
        "outcome": "host_unreachable",
        "reporter": "192.168.1.201",
    }
    entry = {
        "name": "kobuki2computer",
        "ping_address": ping,
        "tcp": "No route to host",
        "tcp_outcome": "host_unreachable",
    }
    seen = _read({"verify_probe": {"members": [entry]}}, "", "verify_probe", [])
    (member,) = seen.probe.members
    assert (member.ping_address.outcome, member.ping_address.reporter) == (Outcome.HOST_UNREACHABLE, "192.168.1.201")
    assert member.tcp_outcome == Outcome.HOST_UNREACHABLE and member.ping_address.error.startswith('"')
    entry["tcp_outcome"] = "refused by a stranger"
    assert "tcp_outcome" in _read({"verify_probe": {"members": [entry]}}, "", "verify_probe", []).problem


def test_each_outcome_of_the_contract_stands_without_quotes():
    crossing = {"topic": "/a", "nodes": [], "outcome": "no_answer", "message": False, "there": "answered", "error": ""}
    relay = {"robot": "kobuki2", "outcome": "answered", "data_outcome": "open", "crossing": [crossing]}
    probe = {"members": [], "relays": [relay], "exchange": {"types_outcome": "no_answer"}}
    seen = _read({"verify_probe": probe}, "", "verify_probe", [])
    assert not seen.problem and seen.probe.exchange.types_outcome == Outcome.NO_ANSWER
    assert seen.probe.relays[0].data_outcome == Outcome.OPEN
    assert seen.probe.relays[0].crossing[0].there == Outcome.ANSWERED


def test_each_word_of_the_contract_stands_without_quotes():
    """The checks compare these words. In quotes they are no such words, and a hook in quotes costs all rules of its computer."""
    kinds = [getattr(observations, name) for name in observations.__all__]
    described = [(name, field.text) for kind in kinds for name, field in getattr(kind, "FIELDS", {}).items()]
    words = [(name, word) for name, text in described for word in re.findall(r"V\(([a-z][a-z_-]*)\)", text)]
    assert {("hook", "postrouting"), ("verdict", "masquerade"), ("state", "answer"), ("service", "chrony")} <= {*words}
    assert [one for one in words if task_results.quote_texts({one[0]: one[1]}) != {one[0]: one[1]}] == []


COMPARED = [
    *(("type", word) for word in UNKNOWN_TYPES),
    *(("name", parameter) for _node, parameter in programs.DECIDES),
    *(("name_sources", word) for word in (*computer.ASK_OTHERS, "files", "resolve")),
    *(("state", word) for word in DOWN),
]


def test_each_word_that_a_check_compares_stands_without_quotes():
    assert [one for one in COMPARED if task_results.quote_texts({one[0]: one[1]}) != {one[0]: one[1]}] == []


def test_the_rules_of_a_computer_that_masquerades_and_follows_connections_are_read():
    passing = {"verdict": "accept", "state": "answer", "chain": "INPUT"}
    chains = [
        {"hook": "input", "table": "ip filter", "policy": "drop", "rules": [passing], "unread": 0, "chain": "INPUT"},
        {
            "hook": "postrouting",
            "table": "ip nat",
            "policy": "accept",
            "rules": [{"verdict": "masquerade", "leaving": "eth0", "chain": "POSTROUTING"}],
            "unread": 0,
            "chain": "POSTROUTING",
        },
    ]
    variables = {"verify_machine": {"filters": {"readable": True, "chains": chains, "arp": []}}}
    tasks = {"multicast": "", "probe": "", "earlier": [], "machine": "verify_machine"}
    seen = task_results.read_observation("kobuki1computer", variables, tasks)
    rules, unclear = read_rules(map(to_plain, seen.filters.chains))
    assert [(rule.chain, rule.verdict, rule.state) for rule in rules] == [
        (IN, "accept", ANSWER),
        (IN, "drop", ""),
        (NAT, MASQUERADE, ""),
    ]
    assert not unclear


def test_an_answer_of_strangers_costs_one_computer_its_result():
    odd = {"verify_probe": {"members": 3}}
    seen = _read(odd, "verify_multicast", "verify_probe", [])
    assert seen.probe is None and seen.problem.startswith('its results cannot be read: "members is 3')


def test_a_service_of_multicast_routing_has_a_planned_name():
    """A name in quotes is that of no service of the plan, so the service would count as one that nobody saw."""
    seen = {"name": "multicast-routing"}
    names = task_results.list_plan_names(fig12(multimaster_multicast_routing="smcroute"))
    assert task_results.quote_texts(seen, names=names) == seen
    assert task_results.quote_texts(seen, names=task_results.list_plan_names(fig12())) != seen


class HostVars(dict):
    """The variables of hosts as Ansible has them: who asks for one gets it computed, and counted here."""

    def __init__(self, raw):
        super().__init__()
        self.raw, self.computed = raw, []

    def raw_get(self, host):
        return self.raw[host]

    def __getitem__(self, host):
        self.computed.append(host)
        return {name: value if isinstance(value, dict) else {"udp": [value]} for name, value in self.raw[host].items()}


def test_a_registered_result_is_read_as_it_is():
    """A large fleet has hundreds of megabytes of results, which Ansible would go through each time."""
    hostvars = HostVars({"kobuki1computer": {"verify_probe": {"multicast": {"udp": []}}}})
    registered = task_results.Registered(hostvars, "kobuki1computer")
    assert [*registered] == ["verify_probe"] and len(registered) == 1
    assert task_results.find_result(registered, "verify_probe.multicast") == {"udp": []}
    assert task_results.find_result(registered, "verify_filter") == {} and not hostvars.computed


def test_a_variable_with_a_template_is_computed():
    hostvars = HostVars({"kobuki1computer": {"seen": "{{ verify_probe }}"}})
    registered = task_results.Registered(hostvars, "kobuki1computer")
    assert task_results.find_result(registered, "seen") == {"udp": ["{{ verify_probe }}"]}
