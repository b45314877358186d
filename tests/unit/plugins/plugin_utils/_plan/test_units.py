# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The units: order and digests; their whole texts are in golden/providers and golden/multicast_routing."""

import ast
import pathlib
import re
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.units import files_read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.multicast_routing import files
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import quotes, units

GOLDEN = pathlib.Path(__file__).resolve().parents[3] / "golden/multicast_routing"
ADDRESS = "192.168.1.201"
OPTIONS = {
    "robot": "tibi",
    "address": ADDRESS,
    "roscore_command": "/usr/bin/roscore",
    "roscore_port": 11311,
    "environment_digest": "environment",
    "files": {},
}
INTERFACES = ["eth1", "eth0"]


def made(names, **options):
    programs = units.render_programs("bundled", "/usr/bin/python3", {}, 11311)
    return {
        unit["name"]: unit["content"]
        for unit in units.render_services(names, **{**OPTIONS, "programs": programs, **options})
    }


def test_the_units_have_the_order_of_the_services():
    names = ["discovery", "roscore"]
    assert list(made(names)) == [f"multimaster-{name}.service" for name in names]


def find_changed(**options):
    """The services whose units differ between two values of an option."""
    names = [*units.OTHERS, *units.NODES]
    (option, values), *_rest = options.items()
    old, new = (made(names, metrics_folder="/var/lib/m", **{option: value}) for value in values)
    return {name for name in names if new[f"multimaster-{name}.service"] != old[f"multimaster-{name}.service"]}


def test_the_environment_restarts_the_services_that_have_it():
    found = find_changed(environment_digest=("old", "new"))
    assert found == {"roscore", *units.NODES}
    names = [*units.OTHERS, *units.NODES]
    texts = made(names, metrics_folder="/var/lib/m")
    assert found == {name for name in names if "EnvironmentFile=" in texts[f"multimaster-{name}.service"]}


CODE = f"{units.LIBRARY}/python/rosfleet_multimaster"


@pytest.mark.parametrize(
    ("path", "restarted"),
    [
        (f"{units.CONFIGURATION}/master_relay.json", {"relay"}),
        (f"{units.CONFIGURATION}/master_discovery.json", {"discovery"}),
        (f"{units.CONFIGURATION}/master_sync.json", {"sync", "connections"}),
        (f"{CODE}/relay/feed.py", {"relay"}),
        (f"{CODE}/roscore/core/feed.py", {"roscore"}),
        (f"{CODE}/end_hangs.py", {"watchdog"}),
        (f"{CODE}/edge/loop.py", {"watchdog", "roscore", "connections", "metrics", *units.NODES}),
        (f"{CODE}/new/room.py", {"watchdog", "roscore", "connections", "metrics", *units.NODES}),
    ],
)
def test_a_file_restarts_the_services_that_read_it(path, restarted):
    found = find_changed(files=({path: "old"}, {path: "new"}))
    assert found == restarted
    added = find_changed(files=({}, {path: "new"}))
    assert added == restarted


def find_imports(file, root):
    """All files of the nodes that a program imports, itself among them, as Python finds them."""
    found, due = set(), [file]
    while due:
        one = due.pop()
        if one in found:
            continue
        found.add(one)
        for node in ast.walk(ast.parse(one.read_text())):
            if not isinstance(node, ast.ImportFrom) or not node.level and "multimaster" not in str(node.module):
                continue
            base = one.parents[node.level - 1] if node.level else root
            place = base.joinpath(*(node.module or "").split("."))
            places = [place, *(place / alias.name for alias in node.names)]
            due += [
                path for each in places for path in (each.with_suffix(".py"), each / "__init__.py") if path.is_file()
            ]
    return found


PROGRAMS = {
    **{
        "roscore": "roscore/__main__",
        "connections": "end_connections",
        "metrics": "publish_metrics",
        "watchdog": "end_hangs",
    },
    **{name: f"master_{name}" for name in units.NODES},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PROGRAMS)
def test_a_service_is_said_to_read_what_its_program_imports(name):
    root = pathlib.Path(__file__).resolve().parents[5] / "roles/nodes/files/python"
    imported = find_imports(root / f"rosfleet_multimaster/{PROGRAMS[name]}.py", root)
    assert len(imported) > 3
    paths = {f"{units.LIBRARY}/python/{file.relative_to(root)}" for file in imported}
    assert not {path for path in paths if not units.reads(name, path)}


def test_the_roscore_of_ros_depends_on_the_environment_alone():
    programs = units.render_programs("fkie_apt", "/usr/bin/python3", {}, 11311)
    old, new = (made(["roscore"], programs=programs, files={f"{CODE}/edge/loop.py": text}) for text in ("old", "new"))
    assert old == new and "Environment=ROSFLEET_INPUTS=environment\n" in new["multimaster-roscore.service"]


def test_a_unit_ends_with_a_newline():
    assert all(text.endswith("multi-user.target\n") for text in made(["address", "roscore", "sync"]).values())


def test_the_own_address_route_is_found_by_its_mark():
    """The text of the stop is that of the new address already when a planned address changes: it may not name one."""
    (text,) = made(["address"]).values()
    commands = dict(re.findall(r"^(Exec\w+)=-?(.*)$", text, re.M))
    assert commands == {"ExecStart": "/sbin/ip -4 -batch -", "ExecStop": "/sbin/ip -4 route flush table local proto 84"}
    assert re.findall(r"^StandardInput\w*=(.*)$", text, re.M) == [
        "data",
        "route flush table local proto 84",
        "route replace local 192.168.1.201/32 dev lo table local proto 84 metric 84",
    ]
    assert set(re.findall(r"[\w-]+\.service", re.findall(r"^Before=.*$", text, re.M)[0])) == {
        f"multimaster-{name}.service" for name in ("roscore", "discovery", "sync")
    }


def test_no_unit_waits_for_a_network():
    """A target of the network is reached late or never on a robot that is switched on alone."""
    texts = [*made(["address", "roscore", "discovery", "sync"]).values()]
    texts.append(files.render_router("tibi", "239.255.11.11", INTERFACES, "/usr/sbin/smcrouted", "feed")["content"])
    assert len(texts) == 5
    for text in texts:
        assert not re.search(
            r"network|ifup|dhcp|time-sync", "".join(re.findall(r"^(?:After|Wants|Requires)=.*", text, re.M))
        )


def test_no_limit_costs_a_process_that_waits():
    """A start has minutes, and the watchdog of systemd itself, which cannot tell a hang from a wait, has half an hour."""
    names = [*units.OTHERS, *units.NODES]
    for provider in units.PROGRAMS:
        programs = units.render_programs(provider, "/bin/true", dict.fromkeys(units.NODES, "/bin/true"), 11311)
        for unit, text in made(names, programs=programs, metrics_folder="/var/lib/x").items():
            start, oneshot = re.findall(r"^TimeoutStartSec=(.*)", text, re.M), "\nType=oneshot\n" in text
            assert start in (["300"], ["infinity"]) or oneshot, unit
            waits = re.findall(r"^ExecStartPost=.*wait_for_master (.*)", text, re.M)
            assert all(wait.startswith("--timeout 300") for wait in waits) and (start != ["infinity"] or waits), unit
            assert re.findall(r"^WatchdogSec=(.*)", text, re.M) in ([], ["30min"]), unit
            assert oneshot or "\nStartLimitIntervalSec=0\n" in text, unit


def test_the_watchdog_judges_what_gives_signs_of_life():
    programs = units.render_programs("bundled", "/bin/true", {}, 11311)
    names = ["address", "watchdog", "roscore", "discovery", "connections", "sync"]
    text = made(names, programs=programs)["multimaster-watchdog.service"]
    (judged,) = re.findall(r"end_hangs import main; main.*?' (.*)", text)
    assert judged.split() == [f"multimaster-{name}.service" for name in ("roscore", "discovery", "connections", "sync")]


@pytest.mark.parametrize("path", ["+/bin/sh", "/tmp/x\nExecStartPre=+/bin/sh", "bin/roscore", ""])
def test_a_path_that_systemd_would_read_otherwise_is_refused(path):
    with pytest.raises(quotes.Unquotable, match="expected an absolute path"):
        units.render_programs("fkie_existing", "/usr/bin/python3", {"discovery": path, "sync": "/opt/sync"}, 11311)
    with pytest.raises(quotes.Unquotable, match="expected an absolute path"):
        made(["roscore"], roscore_command=path, programs={})


def test_the_name_of_a_robot_is_a_text():
    (text,) = made(["roscore"], robot="50%h").values()
    assert "Description=ROS master of 50%%h (roscore)\n" in text
    with pytest.raises(quotes.Unquotable, match="on one line"):
        made(["roscore"], robot="tibi\n[Service]")


def test_the_bundled_roscore_remembers_and_upstreams_does_not():
    bundled = units.render_programs("bundled", "/opt/python3", {}, 11411)
    (text,) = made(["roscore"], programs=bundled).values()
    members = "%E/rosfleet-multimaster/master_discovery.json"
    assert f"\nExecStart=/opt/python3 -m rosfleet_multimaster.roscore --port 11411 --members {members}\n" in text
    assert files_read(text) == [f"{units.CONFIGURATION}/environment"], "a robot that is added restarts no roscore"
    assert "\nStateDirectory=%N\n" in text and "ExecStartPost" not in text and "/usr/bin/roscore" not in text
    upstream = units.render_programs("fkie_apt", "/opt/python3", dict.fromkeys(units.NODES, "/opt/node"), 11411)
    (text,) = made(["roscore"], programs=upstream).values()
    assert (
        "\nExecStart=/usr/bin/python3 -m rosfleet_multimaster.run_plain /usr/bin/roscore -p 11311 -w 16 -t 3\n" in text
        and "StateDirectory" not in text
    )


#: unit -> the worst rating of `systemd-analyze security` that it may have; tests/systems has the same of running ones
RATED = {
    "tunnel": 3.5,
    "address": 1.5,
    "watchdog": 2.0,
    "roscore": 1.5,
    "discovery": 1.5,
    "relay": 1.5,
    "connections": 2.0,
    "metrics": 2.0,
    "sync": 2.0,
    "multicast-routing": 3.0,
}


def analyzed(*words):
    """The output of systemd-analyze, or None if it is missing or older than these words."""
    try:
        done = subprocess.run(["systemd-analyze", *words], capture_output=True, text=True, timeout=60, check=False)
    except FileNotFoundError:
        return None
    return None if "unrecognized option" in done.stderr else done.stdout + done.stderr


@pytest.fixture(name="files")
def _files(tmp_path, monkeypatch):
    """All units as files, with programs that every machine has."""
    monkeypatch.setattr(units, "WAIT", "/bin/true")
    programs = units.render_programs("bundled", "/bin/true", {}, 11311)
    options = {**OPTIONS, "roscore_command": "/bin/true", "metrics_folder": "/var/lib/x"}
    made = units.render_services(list(dict.fromkeys([*units.OTHERS, *programs])), programs=programs, **options)
    upstream = units.render_programs("fkie_apt", "/bin/true", dict.fromkeys(programs, "/bin/true"), 11311)
    made += [
        {**unit, "name": unit["name"].replace(".service", "-upstream.service")}
        for unit in units.render_services(["roscore", *upstream], programs=upstream, **options)
    ]
    made.append(files.render_router("tibi", "239.255.11.11", INTERFACES, "/bin/true", "feed"))
    for unit in made:
        (tmp_path / unit["name"]).write_text(unit["content"], encoding="utf-8")
    return sorted(tmp_path.iterdir())


def test_the_sandbox_of_each_unit_is_rated_well(files):
    ratings, rated = {}, set()
    for path in files:
        said = analyzed("security", "--offline=true", "--no-pager", str(path))
        if said is None:
            pytest.skip("needs systemd-analyze security --offline (systemd 250)")
        name = path.stem.replace("multimaster-", "").replace("-upstream", "")
        rated.add(name)
        ratings[path.stem] = (float(re.search(r"Overall exposure level for .*: ([0-9.]+)", said)[1]), RATED[name])
    print(ratings)
    assert rated == set(RATED)
    assert {name: rating for name, (rating, worst) in ratings.items() if rating > worst} == {}


def test_systemd_has_nothing_to_say_about_a_unit(files):
    for path in files:
        said = analyzed("verify", "--man=no", str(path))
        if said is None:
            pytest.skip("needs systemd-analyze")
        assert [line for line in said.splitlines() if path.name in line] == []


def directives(text):
    """name -> all values of a directive."""
    found = {}
    for line in text.splitlines():
        name, equals, value = line.partition("=")
        if equals and name.isalnum():
            found.setdefault(name, []).append(value)
    return found


#: directive -> the units that have it alone, where the page says which
SOME = {
    "IPAddressDeny": {"connections"},
    "MemoryDenyWriteExecute": {"connections", "metrics", "watchdog", "address", "multicast-routing"},
    "PrivateUsers": set(),
    "ProcSubset": set(),
}


def test_the_page_has_the_sandbox_of_each_unit(files):
    page = (pathlib.Path(__file__).parents[5] / "docs/operate/on_a_robot.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| `")]
    told = {row[0].split("`")[1]: row for row in rows if len(row) == 6}
    assert set(told) == set(RATED)
    sandbox = directives(units._SANDBOX)
    for path in files:
        name, has = path.stem.replace("multimaster-", ""), directives(path.read_text(encoding="utf-8"))
        assert all(set(values) <= set(has[key]) for key, values in sandbox.items()), name
        name = name.replace("-upstream", "")
        assert {key for key in SOME if key in has} == {key for key, those in SOME.items() if name in those}
        _name, user, capabilities, _more, memory, rating = told[name]
        assert user.startswith("dynamic") is ("DynamicUser" in has), name
        assert " ".join(re.findall(r"CAP_\w+", capabilities)) == has["CapabilityBoundingSet"][0], name
        limits = [has[key][0] for key in ("MemoryMax", "TasksMax") if key in has]
        assert memory == ", ".join(limits), name
        said = analyzed("security", "--offline=true", "--no-pager", str(path))
        if said is not None and "-upstream" not in path.stem:
            measured = float(re.search(r"Overall exposure level for .*: ([0-9.]+)", said)[1])
            assert abs(float(rating.split()[0]) - measured) < 0.15, (
                name,
                measured,
            )  # a systemd may know one thing more
    text = {path.stem: directives(path.read_text(encoding="utf-8")) for path in files}
    ours = ("roscore", "discovery", "sync", "relay", "connections", "metrics", "watchdog")
    assert {name for name in told if "WatchdogSec" in text[f"multimaster-{name}"]} == set(ours)
    assert "ROSOUT_DISABLE_FILE_LOGGING=1" in text["multimaster-roscore"]["Environment"]
