# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A fleet with lost links, lost robots and restarted roscores: three robots, with the defaults.

All times are of the kernel's steady clock, which the containers share. The order of the tests is that of a day.
"""

import time

import pytest
from setups.links import Watch, chat, cut, lossy, measure_recovery, message_times, repair, wait_until
from subject import three_robots

NAME = "systems-links"
COMPUTERS = ("ana-pc", "bob-pc", "cid-pc")
PAIRS = (("ana", "bob"), ("bob", "ana"))  # who hears whom
OFFLINE_AFTER = 5.0  # seconds, the default of multimaster_offline_after
BACK = {"roscpp": 2.0, "rospy": 5.0}  # seconds from the return of the link to the first message
BUSY = "/bob/busy"
SERVICES = {"/master_discovery/list_masters", "/master_sync/get_sync_info"}


@pytest.fixture(scope="module")
def lab():
    """Ordinary nodes on ana and bob hear each other, by roscpp and by rospy; each roscore is watched."""
    with three_robots(NAME) as found:
        start_nodes(found)
        yield found


@pytest.fixture(scope="module")
def watches(lab):
    return {host: Watch(lab, host) for host in COMPUTERS}


def start_nodes(lab):
    for here, there in PAIRS:
        chat(lab, here, there)
    for here, _there in PAIRS:
        flows(lab, here)


def flows(lab, here):
    """Wait until messages come, by both libraries."""
    since = time.monotonic()
    wait_until(lambda: all(message_times(lab, here, since).values()), 60, f"{here} hears")


def flow_again(lab):
    """Wait until messages come to both robots, and some seconds more, in which they go on; returns the end."""
    for here, _there in PAIRS:
        flows(lab, here)
    time.sleep(3)
    return time.monotonic()


def of(host, items):
    """The registrations that belong to the nodes of a robot, discovery and sync left out: those are never imported."""
    robot = host.partition("-")[0]
    return {item for item in items if item.rpartition("/")[2].startswith(f"{robot}_")}


def gone_from(watches, lost, since, to=None):
    """Seconds until the last registration of a lost robot went, by the others; nothing else may go."""
    gone = {}
    for host, watch in watches.items():
        if host != lost:
            if to is None:
                wait_until(
                    lambda watch=watch: not of(lost, watch.registrations()), 60, f"{host} holds nothing of {lost}"
                )
            # Newcomers come and go.
            removed = [
                (at, item) for at, item in watch.removals(since) if at < (to or at + 1) and "newcomer" not in item
            ]
            assert removed and of(lost, [item for _at, item in removed]) == {item for _at, item in removed}
            gone[host] = removed[-1][0] - since
    return gone


def rounded(seconds):
    return {key: round(value, 2) for key, value in seconds.items()}


def log(lab, host, since):
    """The log of master_sync from a moment of the steady clock on."""
    began = time.time() - (time.monotonic() - since)
    return lab.run(host, f"journalctl --unit multimaster-sync --output cat --since @{began:.3f}")


def test_a_loss_of_two_seconds_removes_nothing(lab, watches):
    since = cut(lab, "bob-pc")
    time.sleep(2)
    back = repair(lab, "bob-pc")
    time.sleep(4)
    print(f"the link was away for {back - since:.2f} s")
    for host, watch in watches.items():
        assert watch.removals(since) == []
        assert "unregister" not in log(lab, host, since)


def blocked(lab, host):
    """(seconds from the start, seconds until a new publisher was heard) of the newcomers on a computer."""
    return [(at, float(text)) for at, text in lab.output(host, "newcomer")]


@pytest.fixture(scope="module")
def loss(lab, watches):
    """bob is away for 70 s, with three subscribers whom the other roscores want to tell about each new publisher."""
    for number in range(3):
        lab.start(
            "bob-pc", f"busy{number}", f"rosrun topic_tools relay {BUSY} /bob/out{number} __name:=bob_busy{number}"
        )
    wait_until(
        lambda: all(f"subscriber {BUSY} /bob_busy2" in watches[host].registrations() for host in COMPUTERS),
        60,
        "the three",
    )
    for host in ("ana-pc", "cid-pc"):
        # As behind a gateway: whoever asks for the way gets an answer, so nothing but time ends an attempt to connect.
        lab.run(
            host,
            "ip neigh replace 192.168.20.22 lladdr $(ip neigh show 192.168.20.22 | grep -o '..:[^ ]*') dev eth0 nud permanent",
        )
        # Nobody else knows of them, or another robot's roscore would tell the subscriber.
        lab.run(host, f"rosparam set /do_not_sync '[/{host[:3]}_newcomer/new]'")
    time.sleep(5)  # discovery reads this now and then
    for host in ("ana-pc", "cid-pc"):
        lab.start(host, "newcomer", f"python3 {{script}} {host[:3]}_newcomer {BUSY}", "programs/newcomer.py")
        wait_until(lambda host=host: blocked(lab, host), 60, f"a newcomer on {host}")
    since = cut(lab, "bob-pc")
    gone = gone_from(watches, "bob-pc", since)
    time.sleep(max(0.0, since + 25 - time.monotonic()))
    newcomers = {host: blocked(lab, host) for host in ("ana-pc", "cid-pc")}
    for host in ("ana-pc", "cid-pc"):
        lab.stop(host, "newcomer")
        lab.run(host, "ip neigh del 192.168.20.22 dev eth0")
    time.sleep(max(0.0, since + 70 - time.monotonic()))
    back = repair(lab, "bob-pc")
    end = flow_again(lab)
    lab.stop("bob-pc", "busy0", "busy1", "busy2")
    return {"since": since, "gone": gone, "newcomers": newcomers, "back": back, "end": end}


def test_what_a_lost_robot_had_is_gone_within_the_time(loss, slack):
    print("\ngone after the loss:", rounded(loss["gone"]))
    assert max(loss["gone"].values()) <= OFFLINE_AFTER + slack(loss["since"])


@pytest.mark.parametrize("host", ["ana-pc", "cid-pc"])
def test_unreachable_subscribers_do_not_block_the_own_roscore(loss, slack, host):
    """ana's is the collection's, cid's has three workers and no time limit."""
    seen = [(at - loss["since"], seconds) for at, seconds in loss["newcomers"][host] if at + seconds > loss["since"]]
    waited = [round(at + seconds, 1) for at, seconds in seen if at < OFFLINE_AFTER]
    later = [seconds for at, seconds in seen if at >= OFFLINE_AFTER]
    print(
        f"\n{host}: those of the first seconds heard {waited} s after the loss, {len(later)} later ones within {max(later)} s"
    )
    more = slack(loss["since"])
    assert max(waited) <= OFFLINE_AFTER + 1.5 + more
    assert max(later) <= 1.5 + more and len(later) >= 10 / (1 + more)


@pytest.mark.parametrize("library", BACK)
def test_messages_come_again_when_the_link_is_back(lab, loss, slack, library):
    seconds = {
        here: measure_recovery(message_times(lab, here)[library], loss["back"], loss["end"]) for here, _there in PAIRS
    }
    print(f"\n{library}, messages again after 70 s:", rounded(seconds))
    assert max(seconds.values()) <= BACK[library] + slack(loss["back"])


def test_an_interface_that_goes_down_and_up(lab, watches, slack):
    lab.run("bob-pc", "ip link set eth0 down")
    since = time.monotonic()
    time.sleep(20)
    back = time.monotonic()
    lab.run("bob-pc", "ip link set eth0 up")
    end = flow_again(lab)
    gone = gone_from(watches, "bob-pc", since, back)
    print("\ngone:", rounded(gone))
    assert max(gone.values()) <= OFFLINE_AFTER + slack(since)
    assert [
        text for _at, text in watches["bob-pc"].events(since) if "/master_" in text
    ] == []  # neither node was restarted
    for here, _there in PAIRS:
        seconds = {library: measure_recovery(times, back, end) for library, times in message_times(lab, here).items()}
        print(f"messages at {here} again:", rounded(seconds))
        assert all(seconds[library] <= BACK[library] + slack(back) for library in BACK)


def test_no_false_removal_while_a_third_of_the_frames_is_lost(lab, watches):
    since = time.monotonic()
    with lossy(lab, COMPUTERS, 30):
        time.sleep(40)
    assert {host: watch.removals(since) for host, watch in watches.items()} == dict.fromkeys(COMPUTERS, [])


def test_both_nodes_register_again_at_a_roscore_that_forgets(lab, slack):
    host, unit = "cid-pc", "foreign-roscore"
    watch, seconds, began = Watch(lab, host, looks=50), [], time.monotonic()
    for restart in ("systemctl kill --signal=KILL", "systemctl restart", "systemctl restart"):
        since = time.monotonic()
        lab.run(host, f"{restart} {unit}")
        wait_until(lambda since=since: services(watch, since), 60, f"{unit} and both nodes are back")
        seconds.append(services(watch, since) - answers(watch, since))
        time.sleep(2)
    print(
        f"\n{host}: both nodes registered", ", ".join(f"{value:.2f}" for value in seconds), "s after the first answer"
    )
    assert max(seconds) <= 2.0 + slack(began)


def test_a_roscore_that_remembers_loses_no_registration(lab):
    """However it ends. rosout alone registers again, since it ends with its roscore."""
    watch = Watch(lab, "ana-pc", looks=50)
    main_pid = "systemctl show --property=MainPID --value multimaster-roscore"
    for number, restart in enumerate(("systemctl kill --signal=KILL", "systemctl restart", "systemctl restart")):
        wait_until(lambda: SERVICES <= {item.split()[1] for item in watch.registrations()}, 60, "both nodes are there")
        since, gone = time.monotonic(), {lab.run("ana-pc", main_pid).strip(), "0"}
        lab.run("ana-pc", f"{restart} multimaster-roscore")
        wait_until(lambda gone=gone: lab.run("ana-pc", main_pid).strip() not in gone, 60, "a new roscore runs")
        # When the watch has seen what the new roscore tells of a node that begins now, it has seen all that went before.
        mark = f"ana_mark{number}"
        lab.start("ana-pc", mark, f"rostopic pub -r 1 /{mark} std_msgs/String x __name:={mark}")
        registered = f"publisher /{mark} /{mark}"
        wait_until(lambda text=registered: text in watch.registrations(), 60, "the mark is seen")
        assert {item.split()[-1] for _at, item in watch.removals(since)} <= {"/rosout"}
        assert {"/master_discovery", "/master_sync"} <= set(lab.run("ana-pc", "rosnode list").split())
        lab.run("ana-pc", f"systemctl stop {mark}")
        wait_until(lambda text=registered: text not in watch.registrations(), 60, "the mark is gone")


def answers(watch, since):
    """The time at which the roscore answered again."""
    return max((at for at, text in watch.events(since) if text == "answers"), default=None)


def services(watch, since):
    """The time at which the last service of both nodes was in the new roscore."""
    new = answers(watch, since)
    found = {text.split()[2]: at for at, text in watch.events(new or 0) if new and text.startswith("+ service")}
    return max(found[name] for name in SERVICES) if found.keys() >= SERVICES else None


def test_a_dead_roscore_is_no_empty_one(lab, watches, slack):
    ask = "python3 -c 'import xmlrpc.client as x; print(len(x.ServerProxy(\"http://ana-pc:11611\").masterInfo()[5]))'"
    start_nodes(lab)
    since = time.monotonic()
    lab.run("ana-pc", "systemctl stop multimaster-roscore")
    time.sleep(1)
    assert "Fault" in lab.run("bob-pc", f"{ask} 2>&1", check=False)
    gone = gone_from(watches, "ana-pc", since)
    print("\ngone after the end of the roscore:", rounded(gone))
    assert max(gone.values()) <= OFFLINE_AFTER + 1 + slack(since)
    back = time.monotonic()
    lab.run("ana-pc", "systemctl start multimaster-roscore")
    for here, _there in PAIRS:  # it has remembered the nodes of ROS, which do not register again
        flows(lab, here)
    for host in ("bob-pc", "cid-pc"):
        assert watches[host].removals(back) == []


def test_what_a_robot_without_power_had_is_gone_within_the_time(lab, watches, slack):
    since = time.monotonic()
    lab.podman("kill", "bob-pc")
    gone = gone_from(watches, "bob-pc", since)
    print("\ngone after a loss of power:", rounded(gone))
    assert max(gone.values()) <= OFFLINE_AFTER + slack(since)
    lab.podman("start", "bob-pc")
    lab.wait_until_up("bob-pc")
    start_nodes(lab)
