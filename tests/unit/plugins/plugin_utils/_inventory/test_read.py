# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The fleet model and the plan: from the inventory's variables to what every computer needs."""

import copy

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import exports
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read as fleet_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from hypothesis import given
from hypothesis import strategies as st
from mentioned import mentions

KOBUKIS = {
    "robots": {"kobuki1": ["kobuki1computer"], "kobuki2": ["kobuki2computer"]},
    "variables": {
        f"kobuki{number}computer": {
            "multimaster_address": address,
            "multimaster_common_network": "192.168.1.0/24",
            "multimaster_multicast_group": "224.0.0.1",
        }
        for number, address in ((1, "192.168.1.229"), (2, "192.168.1.239"))
    },
}


def fleet(change=None):
    """The fleet of Fig. 5, after a change of its inventory."""
    data = copy.deepcopy(KOBUKIS)
    if change:
        change(data["robots"], data["variables"])
    return fleet_module.read_fleet(fleet_module.Inventory(**data))


def problems(change):
    with pytest.raises(fleet_module.InventoryProblems) as caught:
        fleet(change)
    return caught.value.problems


def setting(host, **values):
    return lambda robots, variables: variables[host].update(values)


def everywhere(**values):
    return lambda robots, variables: [of_host.update(values) for of_host in variables.values()]


def test_plan_of_figure_5():
    plan = to_plain(plan_module.fleet_plan(fleet()))
    assert plan["hosts_entries"] == [
        {"address": "192.168.1.229", "names": ["kobuki1computer"]},
        {"address": "192.168.1.239", "names": ["kobuki2computer"]},
    ]
    assert plan["masters"][1] == {
        "robot": "kobuki2",
        "computer": "kobuki2computer",
        "address": "192.168.1.239",
        "name": "kobuki2computer",
        "uri": "http://kobuki2computer:11311/",
        "monitor_uri": "http://192.168.1.239:11611",
        "rpc_port": 11611,
        "declared": False,
    }
    first = plan["computers"]["kobuki1computer"]
    assert first["environment"] == {"ROS_MASTER_URI": "http://kobuki1computer:11311", "ROS_HOSTNAME": "kobuki1computer"}
    assert first["sysctl"] == [
        {"name": "net.ipv4.icmp_echo_ignore_broadcasts", "value": "0"},
        {"name": "net.ipv4.conf.all.arp_ignore", "value": "3", "enough": ["1", "2", "8"]},
    ]
    assert first["services"] == ["address", "watchdog", "roscore", "discovery", "connections", "sync"]
    assert first["discovery"] == {
        "name": "kobuki1computer",
        "mcast_group": "224.0.0.1",
        "mcast_port": 11511,
        "interface": "192.168.1.229",
        "rpc_port": 11611,
        "heartbeat_hz": 1.0,
        "offline_after": 5.0,
        "send_mcast": True,
        "listen_mcast": True,
        "robot_hosts": ["192.168.1.239"],
        "hide_subscribers": [],
        "strangers": "ignore",
        "allow": [],
    }
    assert plan["belonging"]["robots"][1] == {
        "robot": "kobuki2",
        "name": "kobuki2computer",
        "uris": ["http://kobuki2computer:11311/", "http://192.168.1.239:11311/"],
        "rpc_port": 11611,
        "addresses": ["192.168.1.239"],
        "hosts": ["kobuki2computer", "192.168.1.239"],
    }
    assert plan["belonging"]["computers"] == ["192.168.1.229", "192.168.1.239"]


@pytest.mark.parametrize(
    ("transport", "multicast", "peers"),
    [("both", True, ["192.168.1.239"]), ("multicast", True, []), ("unicast", False, ["192.168.1.239"])],
)
def test_transport(transport, multicast, peers):
    discovery = to_plain(plan_module.fleet_plan(fleet(everywhere(multimaster_transport=transport))))["computers"][
        "kobuki1computer"
    ]["discovery"]
    assert (discovery["send_mcast"], discovery["listen_mcast"], discovery["robot_hosts"]) == (
        multicast,
        multicast,
        peers,
    )


def test_advertise_address():
    computer = to_plain(plan_module.fleet_plan(fleet(everywhere(multimaster_advertise="address"))))["computers"][
        "kobuki1computer"
    ]
    assert computer["environment"] == {"ROS_MASTER_URI": "http://192.168.1.229:11311", "ROS_IP": "192.168.1.229"}


def test_existing_roscore_on_another_port():
    plan = to_plain(
        plan_module.fleet_plan(
            fleet(setting("kobuki2computer", multimaster_roscore="existing", multimaster_roscore_port=11411))
        )
    )
    second = plan["computers"]["kobuki2computer"]
    assert second["services"] == ["address", "watchdog", "discovery", "connections", "sync"]
    assert second["environment"]["ROS_MASTER_URI"] == "http://kobuki2computer:11411"
    assert plan["masters"][1]["name"] == "kobuki2computer_11411"
    assert plan["masters"][1]["monitor_uri"] == "http://192.168.1.239:11711"


def test_a_second_computer_has_environment_and_address():
    def change(robots, variables):
        robots["kobuki1"].append("kobuki1arm")
        variables["kobuki1arm"] = dict(variables["kobuki1computer"], multimaster_address="192.168.1.230")
        for host in robots["kobuki1"]:
            variables[host]["multimaster_master"] = "kobuki1computer"

    arm = to_plain(plan_module.fleet_plan(fleet(change)))["computers"]["kobuki1arm"]
    assert arm["environment"]["ROS_MASTER_URI"] == "http://kobuki1computer:11311"
    assert arm["environment"]["ROS_HOSTNAME"] == "kobuki1arm"
    assert (arm["is_master"], arm["services"], arm["discovery"], arm["ports"]) == (False, ["address"], {}, [])


def test_an_action_in_a_filter_is_its_five_topics():
    filters = {"ignore_actions": ["/dock"], "ignore_topics": ["/tf"], "ignore_types": ["sensor_msgs/Image"]}
    sync = to_plain(plan_module.fleet_plan(fleet(setting("kobuki1computer", multimaster_filters=filters))))[
        "computers"
    ]["kobuki1computer"]["sync"]
    assert sync == {
        "ignore_topics": [
            "/dock/goal",
            "/dock/cancel",
            "/dock/status",
            "/dock/feedback",
            "/dock/result",
            "/tf",
            "/diagnostics",
        ],
        "ignore_type": ["sensor_msgs/Image"],
        "ignore_subscribers": ["*"],
        "strangers": "ignore",
        "allow": [],
    }


def test_alternatives_of_an_action_hold_for_each_of_its_topics():
    assert exports.topics_of([" /dock|/undock/ ", "/go"], ["goal"]) == ("(?:/dock|/undock)/goal", "/go/goal")


@pytest.mark.parametrize("name", ["sync_nodes", "sync_services", "sync_topics"])
def test_a_white_list_lets_the_verification_pass(name):
    filters = {name: ["/pose"]}
    sync = to_plain(plan_module.fleet_plan(fleet(setting("kobuki1computer", multimaster_filters=filters))))[
        "computers"
    ]["kobuki1computer"]["sync"]
    topics = [*filters.get("sync_topics", []), "/multimaster_verify/*"]
    belonging = {"strangers": "ignore", "allow": []}
    assert sync == {
        **filters,
        "sync_topics": topics,
        "ignore_subscribers": ["*"],
        "ignore_topics": ["/diagnostics"],
        **belonging,
    }


def shown(**values):
    """The plan of the first computer with these variables everywhere."""
    return to_plain(plan_module.fleet_plan(fleet(everywhere(**values))))["computers"]["kobuki1computer"]


@pytest.mark.parametrize(
    ("value", "kept", "published"), [("local", 1, None), ("exchanged", 0, None), ("none", 0, False)]
)
def test_diagnostics_stay_on_their_robot_by_default(value, kept, published):
    plan = shown(multimaster_diagnostics=value)
    assert plan["sync"].get("ignore_topics", []) == ["/diagnostics"] * kept
    assert plan["sync"].get("diagnostics") is plan["discovery"].get("diagnostics") is published


def test_metrics_are_a_service_more_and_a_file_of_each_node():
    plan, without = shown(multimaster_metrics="textfile", multimaster_metrics_folder="/srv/metrics"), shown()
    assert plan["services"] == [*without["services"], "metrics"]
    assert plan["metrics_folder"] == "/srv/metrics" and plan["look_at"]["folders"] == ["/srv/metrics"]
    assert sorted(plan["look_at"]["parts"]) == sorted([*without["look_at"]["parts"], "folders"])
    for node in ("discovery", "sync"):
        assert plan[node].pop("metrics") == f"/run/multimaster-{node}/metrics.prom"
        assert plan[node] == without[node]


def test_upstreams_nodes_have_no_metrics_and_preflight_says_so():
    plan = shown(multimaster_metrics="textfile", multimaster_provider="fkie_apt")
    assert "metrics" not in plan["services"] and "metrics_folder" not in plan
    assert [text for text in plan["limits"] if "whose nodes measure nothing" in text]


def allowing(*values):
    """A change: these are in multimaster_allow."""
    return everywhere(multimaster_allow=list(values))


WRONG = {
    "allow a name": (allowing("laptop"), ["multimaster_allow laptop IPv4"]),
    "allow host bits": (allowing("10.0.0.1/8"), ["192.168.1.77 192.168.2.0/24 10.0.0.1/8"]),
    "allow loopback": (allowing("127.0.0.0/8"), ["127.0.0.0/8 networks"]),
    "allow a group": (allowing("226.0.0.0"), ["226.0.0.0 networks"]),
    "allow everybody": (allowing("0.0.0.0/0"), ["multimaster_strangers allow"]),
    "allow a number": (allowing(7), ["multimaster_allow 7"]),
    "allow no list": (everywhere(multimaster_allow="10.0.0.1"), ["IPv4 networks"]),
    "diagnostics that stay, exported": (
        setting("kobuki2computer", multimaster_exports=[{"topics": ["/pose", "/diagnostics"]}]),
        ["kobuki2computer multimaster_exports /diagnostics multimaster_diagnostics local"],
    ),
    "diagnostics that stay, wanted": (
        setting("kobuki2computer", multimaster_filters={"sync_topics": ["/diagnostics"]}),
        ["kobuki2computer multimaster_filters /diagnostics multimaster_diagnostics local"],
    ),
    "metrics": (everywhere(multimaster_metrics="prometheus"), ["prometheus none textfile"]),
    **{
        f"folder {path!r}": (everywhere(multimaster_metrics_folder=path), ["absolute folder"])
        for path in ("metrics", "/", "/a/../etc", "/a b", "/a%h", "/-x", "/a/", "/a\n[Service]", "", 7)
    },
    "strangers": (everywhere(multimaster_strangers="some"), ["some ignore allow"]),
    "duplicate address": (
        setting("kobuki2computer", multimaster_address="192.168.1.229"),
        ["kobuki2computer multimaster_address 192.168.1.229 kobuki1computer"],
    ),
    "duplicate name": (
        setting("kobuki2computer", multimaster_aliases=["Kobuki1Computer"]),
        ["kobuki2computer Kobuki1Computer kobuki1computer"],
    ),
    "alias localhost": (
        setting("kobuki2computer", multimaster_aliases=["localhost"]),
        ["kobuki2computer multimaster_aliases localhost"],
    ),
    "alias that is an address": (
        setting("kobuki2computer", multimaster_aliases=["192.168.1.240"]),
        ["kobuki2computer multimaster_aliases 192.168.1.240"],
    ),
    "master of another robot": (
        setting("kobuki2computer", multimaster_master="kobuki1computer"),
        ["kobuki2computer multimaster_master kobuki1computer kobuki2"],
    ),
    "no multicast group": (
        everywhere(multimaster_multicast_group="192.168.1.1"),
        ["kobuki1computer kobuki2computer multimaster_multicast_group 192.168.1.1 IPv4 multicast"],
    ),
    "outside the network": (
        setting("kobuki1computer", multimaster_address="192.168.2.229"),
        ["kobuki1computer multimaster_address 192.168.2.229 multimaster_common_network 192.168.1.0/24"],
    ),
    "broadcast address": (
        setting("kobuki1computer", multimaster_address="192.168.1.255"),
        ["kobuki1computer multimaster_address 192.168.1.255 broadcast"],
    ),
    "loopback address": (
        setting("kobuki1computer", multimaster_address="127.0.0.1"),
        ["kobuki1computer multimaster_address 127.0.0.1 IPv4"],
    ),
    "mistyped variable": (
        setting("kobuki1computer", multimaster_mulitcast_group="226.0.0.1"),
        ["multimaster_mulitcast_group multimaster_multicast_group"],
    ),
    "mistyped transport": (
        everywhere(multimaster_transport="broadcast"),
        ["kobuki1computer kobuki2computer multimaster_transport broadcast multicast"],
    ),
    "the fleet disagrees": (
        setting("kobuki2computer", multimaster_multicast_port=11512),
        ["kobuki2computer multimaster_multicast_port 11512 kobuki1computer 11511"],
    ),
    "no address": (
        lambda robots, variables: variables["kobuki1computer"].pop("multimaster_address"),
        ["kobuki1computer multimaster_address"],
    ),
    "one host, two robots": (
        lambda robots, variables: robots["kobuki2"].append("kobuki1computer"),
        ["kobuki1computer 2 kobuki1 kobuki2", "multimaster_master"],
    ),
    "localhost": (
        lambda robots, variables: (
            robots.update(kobuki1=["localhost"]),
            variables.update(localhost=variables.pop("kobuki1computer")),
        ),
        ["localhost inventory"],
    ),
    "underscore in the master": (
        setting("kobuki2computer", multimaster_master="kobuki2_computer"),
        ["kobuki2computer multimaster_master kobuki2_computer kobuki2 group_vars/kobuki2.yml"],
    ),
    "master that is a number": (
        setting("kobuki2computer", multimaster_master=7),
        ["kobuki2computer multimaster_master 7"],
    ),
    "robot without computers": (lambda robots, variables: robots.update(ghost=[]), ["ghost computers"]),
    "several computers and no master": (
        lambda robots, variables: (
            robots["kobuki1"].append("kobuki1arm"),
            variables.update(kobuki1arm=dict(variables["kobuki1computer"], multimaster_address="192.168.1.230")),
        ),
        ["kobuki1computer multimaster_master kobuki1"],
    ),
    "underscore in a name": (
        lambda robots, variables: (
            robots.update(kobuki1=["kobuki_1"]),
            variables.update(kobuki_1=variables.pop("kobuki1computer")),
        ),
        ["kobuki_1 inventory kobuki-1 multimaster_aliases"],
    ),
    "alias that is none": (
        setting("kobuki1computer", multimaster_aliases=["-kobuki_1"]),
        ["kobuki1computer multimaster_aliases"],
    ),
    "address as a name": (
        lambda robots, variables: (
            robots.update(kobuki1=["192.168.1.229"]),
            variables.update({"192.168.1.229": variables.pop("kobuki1computer")}),
        ),
        ["192.168.1.229 inventory"],
    ),
    "invalid pattern": (
        setting("kobuki1computer", multimaster_filters={"ignore_topics": ["/a[b"]}),
        ["multimaster_filters ignore_topics /a[b"],
    ),
    "unknown filter": (
        setting("kobuki1computer", multimaster_filters={"ignore_topic": ["/a"]}),
        ["ignore_topic ignore_topics"],
    ),
    "string for a list": (
        setting("kobuki1computer", multimaster_filters={"ignore_topics": "/tf"}),
        ["ignore_topics patterns"],
    ),
    "rpc port of the roscore": (
        setting("kobuki1computer", multimaster_rpc_port=11311),
        ["kobuki1computer multimaster_rpc_port 11311 roscore"],
    ),
    "exports that are no list": (
        setting("kobuki1computer", multimaster_exports={"topics": ["/pose"]}),
        ["kobuki1computer multimaster_exports /pose"],
    ),
    "exports to nobody": (
        setting("kobuki1computer", multimaster_exports=[{"topics": ["/pose"], "to": ["kobuki3"]}]),
        ["kobuki1computer multimaster_exports kobuki3 kobuki2"],
    ),
    "soon offline": (
        everywhere(multimaster_offline_after=1),
        ["kobuki1computer kobuki2computer multimaster_offline_after 1 3 3600"],
    ),
    "soon offline at a slow rate": (
        everywhere(multimaster_heartbeat_hz=0.02, multimaster_offline_after=5),
        ["multimaster_heartbeat_hz 0.02 multimaster_offline_after 5 0"],
    ),
    "shells of an unknown kind": (
        setting("kobuki1computer", multimaster_shells="some"),
        ["kobuki1computer multimaster_shells some"],
    ),
    "shells as a switch": (
        everywhere(multimaster_shells=False),
        ["kobuki1computer kobuki2computer multimaster_shells False"],
    ),
    "relative set-up file": (
        setting("kobuki1computer", multimaster_ros_setup="ws/devel/setup.bash"),
        ["kobuki1computer multimaster_ros_setup ws/devel/setup.bash"],
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_inventory_is_named(case):
    change, expected = WRONG[case]
    found = problems(change)
    assert len(found) == len(expected), found
    for sentence, part in zip(found, expected, strict=True):
        assert mentions(sentence, *part.split())


def test_all_problems_are_found_in_one_pass():
    def change(robots, variables):
        setting("kobuki1computer", multimaster_address="10.0.0.1")(robots, variables)
        setting("kobuki2computer", multimaster_roscore="none")(robots, variables)
        setting("kobuki2computer", multimaster_exports=[{"topics": ["/pose"], "to": ["kobuki2"]}])(robots, variables)

    assert len(problems(change)) == 3


def between(**changes):
    """The fleet of Fig. 5, whose robots are in a group of their own below `robots`."""
    data = copy.deepcopy(KOBUKIS)
    robots = {**data["robots"], **changes.pop("robots", {})}
    for name, variables in changes.items():
        data["variables"].setdefault(name, dict(data["variables"]["kobuki1computer"])).update(variables)
    hosts = [host for members in robots.values() for host in members]
    return fleet_module.Inventory(robots={"lab": hosts}, variables=data["variables"], parts={"lab": robots})


def test_a_group_between_robots_and_a_robot_is_named():
    with pytest.raises(fleet_module.InventoryProblems) as caught:
        fleet_module.read_fleet(between())
    (sentence,) = caught.value.problems
    assert mentions(sentence, "group", "robots", "kobuki1", "kobuki2")
    assert mentions(sentence, "multimaster_master", "group_vars/lab.yml")


def test_robots_below_a_group_between_are_read_as_robots():
    masters = {f"kobuki{number}computer": {"multimaster_master": f"kobuki{number}computer"} for number in (1, 2)}
    masters["kobuki2computer"]["multimaster_transport"] = "radio"
    with pytest.raises(fleet_module.InventoryProblems) as caught:
        fleet_module.read_fleet(between(**masters))
    assert len(caught.value.problems) == 2  # the group, and the value
    assert not any("multimaster_master is" in text for text in caught.value.problems)


def test_a_robot_may_have_groups_of_its_own():
    master = {"multimaster_master": "kobuki1computer"}
    (robot,) = fleet_module.read_fleet(between(kobuki1computer=master, kobuki2computer=master)).robots
    assert (robot.name, robot.master.name) == ("lab", "kobuki1computer")


def test_one_wrong_line_of_the_inventory_is_one_sentence():
    def change(robots, variables):
        for number in range(3, 9):
            robots[f"kobuki{number}"] = [f"kobuki{number}computer"]
            variables[f"kobuki{number}computer"] = dict(
                variables["kobuki1computer"], multimaster_address=f"192.168.1.{number}"
            )
        everywhere(multimaster_transport="radio")(robots, variables)

    (sentence,) = problems(change)
    assert mentions(
        sentence, "kobuki1computer", "kobuki2computer", "kobuki3computer", "5", "multimaster_transport", "radio"
    )


@pytest.mark.parametrize(("other", "clashes"), [("robot.a", True), ("robot-b", False)])
def test_names_that_are_one_in_names_of_ros_are_refused(other, clashes):
    """Their talkers would have one topic and one node, so the one would be judged by the messages of the other."""
    values = {
        host: {"multimaster_common_network": "192.168.1.0/24", "multimaster_address": f"192.168.1.{number}"}
        for number, host in enumerate(("robot-a", other), 1)
    }
    inventory = fleet_module.Inventory(robots={"one": ["robot-a"], "two": [other]}, variables=values)
    try:
        fleet_module.read_fleet(inventory)
        found = []
    except fleet_module.InventoryProblems as wrong:
        found = wrong.problems
    assert [problem.partition(", ")[0] for problem in found] == (
        ["robot.a: it and robot-a both become robot_a in ROS"] if clashes else []
    )


def test_an_empty_inventory_is_named():
    with pytest.raises(fleet_module.InventoryProblems, match="below the group 'robots'"):
        fleet_module.read_fleet(fleet_module.Inventory(robots={}, variables={}))


@given(
    st.dictionaries(
        st.sampled_from(
            [
                f"multimaster_{name}"
                for name in (
                    "address",
                    "aliases",
                    "common_network",
                    "transport",
                    "multicast_group",
                    "multicast_port",
                    "advertise",
                    "heartbeat_hz",
                    "master",
                    "roscore",
                    "roscore_port",
                    "rpc_port",
                    "filters",
                    "exports",
                    "offline_after",
                    "provider",
                    "ros_setup",
                    "shells",
                    "strangers",
                    "allow",
                    "nonsense",
                )
            ]
        ),
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats()
        | st.text()
        | st.lists(st.text() | st.integers())
        | st.dictionaries(st.text(), st.text() | st.lists(st.text())),
    )
)
def test_any_inventory_gives_a_plan_or_sentences(values):
    try:
        model = fleet(setting("kobuki1computer", **values))
    except fleet_module.InventoryProblems as found:
        assert all(found.problems)
    else:
        assert set(to_plain(plan_module.fleet_plan(model))["computers"]) == {"kobuki1computer", "kobuki2computer"}


def test_the_plan_grows_with_the_number_of_computers():
    """100 robots with 5 computers each: what every computer needs of all others is there once."""

    def change(robots, variables):
        robots.clear()
        variables.clear()
        for robot in range(100):
            robots[f"r{robot}"] = [f"r{robot}-c{computer}" for computer in range(5)]
            for computer in range(5):
                variables[f"r{robot}-c{computer}"] = {
                    "multimaster_address": f"10.1.{robot}.{computer + 1}",
                    "multimaster_common_network": "10.1.0.0/16",
                    "multimaster_master": f"r{robot}-c0",
                }

    plan = to_plain(plan_module.fleet_plan(fleet(change)))
    assert len(plan["hosts_entries"]) == 500
    inner = plan["computers"]["r7-c3"]
    assert len(str(inner)) < 1000
