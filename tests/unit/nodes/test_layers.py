# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The core is free of sockets, threads, clocks, chance and ROS; ROS and the outside each have one module."""

import ast
import pathlib

import pytest

NODES = pathlib.Path(__file__).parents[3] / "roles/nodes/files"

FOLDER = NODES / "python/rosfleet_multimaster"
CORE = {"heartbeat", "discovery_core", "graph", "filters", "sync_core", "message_types", "losses", "parameters"}
OUTSIDE = {
    "socket",
    "socketserver",
    "select",
    "selectors",
    "http",
    "xmlrpc",
    "subprocess",
    "signal",
    "os",
    "sys",
    "logging",
}
TIME = {
    "time",
    "datetime",
    "threading",
    "queue",
    "asyncio",
    "concurrent",
    "multiprocessing",
    "random",
    "secrets",
    "uuid",
}
SOCKETS = {
    "sockets",
    "connections",
    "ros",
    "master_discovery",
}  # ros: to cut one of rospy's; the last for names of hosts
ROS = {
    "rospy",
    "rosgraph",
    "roslib",
    "rospkg",
    "genpy",
    "std_msgs",
    "std_srvs",
    "diagnostic_msgs",
    "fkie_multimaster_msgs",
}


def imports(path):
    """The outermost packages that a file imports, and its own siblings."""
    packages, siblings = set(), set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            packages |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level:
            siblings |= {node.module} if node.module else {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            packages.add(node.module.split(".")[0])
    return packages, siblings


def test_all_modules_are_known_here():
    names = {path.stem for path in FOLDER.glob("*.py")}
    assert names == CORE | {
        "__init__",
        "sockets",
        "connections",
        "ros",
        "program",
        "master_discovery",
        "master_sync",
        "wait_for_master",
    }


@pytest.mark.parametrize("name", sorted(CORE))
def test_the_core_is_pure(name):
    packages, siblings = imports(FOLDER / f"{name}.py")
    assert not packages & (OUTSIDE | TIME | ROS)
    assert siblings <= CORE


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_ros_and_the_outside_have_one_module_each(path):
    packages, _siblings = imports(path)
    if path.stem != "ros":
        assert not packages & ROS
    if path.stem != "sockets":
        assert not packages & {"socketserver", "select", "selectors", "http"}
    if path.stem not in SOCKETS:
        assert "socket" not in packages


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_no_setting_of_the_process_is_changed(path):
    assert "setdefaulttimeout" not in path.read_text(encoding="utf-8")
    assert not path.read_text(encoding="utf-8").startswith("#!")
    compile(path.read_text(encoding="utf-8"), str(path), "exec", ast.PyCF_ONLY_AST)
    ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 8))
