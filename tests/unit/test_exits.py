# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Text from the network is plain at every exit: any text in, plain text out; and nobody writes beside these exits.

DOORS says who alone may use a way out of the process. EXITS feeds each exit with any text. A new way out must be written
into one of the two, or the first test fails.
"""

import ast
import functools
import io
import logging
import pathlib
import sys
from unittest.mock import MagicMock, patch

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import ends
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import plain_data, plain_lines
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.sentences import number_problems
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import refusal
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, Row
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import (
    Diagnosis,
    Finding,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import terminal
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import FleetJudgement
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.summary import summarise
from hypothesis import given, settings
from hypothesis import strategies as st
from rosfleet_multimaster.discovery.core import report as links
from rosfleet_multimaster.discovery.core.health import LinkHealth, LinkList
from rosfleet_multimaster.discovery.rpc_methods import RpcMethods, ServedMaster
from rosfleet_multimaster.edge import journal
from rosfleet_multimaster.edge.process import systemd
from rosfleet_multimaster.edge.rpc_client import Rpc
from rosfleet_multimaster.edge.rpc_server import RefusedCall, RpcServer
from rosfleet_multimaster.protocol import metrics
from rosfleet_multimaster.protocol.plain_text import is_plain

ROOT = pathlib.Path(__file__).parents[2]
NODES = "roles/nodes/files/python/rosfleet_multimaster"

pytestmark = pytest.mark.whole

#: a way out -> the only files that use it, by tree
DOORS = {
    "plugins": {
        "exit_json": {"module_utils/_base/ends.py"},
        "fail_json": {"module_utils/_base/ends.py"},
        "warn": {"module_utils/_base/ends.py"},
        "deprecate": set(),
        "print": set(),
        "write to a standard stream": {  # JSON for the module that runs them, which reads and ends with it
            "module_utils/_probe/ros_client/message_types.py",
            "module_utils/_machine/home_files.py",
            "module_utils/_machine/shell_program.py",
        },
        "display": {
            "action/fleet_bundle.py",
            "action/fleet_predict.py",
            "action/fleet_report.py",
            "action/fleet_summary.py",
            "action/fleet_watch.py",
            "plugin_utils/_robot_io/refusal.py",
        },
        "warning": {"plugin_utils/_robot_io/refusal.py"},
    },
    NODES: {
        "print": set(),
        "write to a standard stream": set(),
        "StreamHandler": {"edge/journal.py"},
        "FileHandler": set(),
        "basicConfig": set(),
        "DiagnosticStatus": {"edge/diagnostic_classes.py"},
        "NOTIFY_SOCKET": {"edge/process/systemd.py"},
        "logwarn": set(),
        "logerr": set(),
        "loginfo": set(),
    },
}


@functools.cache  # a tree is asked for each way
def ways_out(path):
    """The ways out that a file uses."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            called = node.func
            found.add(called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", ""))
            if isinstance(called, ast.Attribute) and called.attr in ("write", "writelines"):
                if isinstance(called.value, ast.Attribute) and called.value.attr in ("stdout", "stderr"):
                    found.add("write to a standard stream")
        elif isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.Constant) and node.value == "NOTIFY_SOCKET":
            found.add("NOTIFY_SOCKET")
    return found


def owner(path, tree):
    return path.relative_to(ROOT / tree).as_posix()


@pytest.mark.slow
@pytest.mark.parametrize(("tree", "way"), [(tree, way) for tree, ways in DOORS.items() for way in ways])
def test_a_way_out_is_used_by_its_door_alone(tree, way):
    used = {owner(path, tree) for path in (ROOT / tree).rglob("*.py") if way in ways_out(path)}
    if way == "warn":  # ends.warn is the door itself; its callers name it
        used = {name for name in used if calls_a_module(ROOT / tree / name)}
    assert used == DOORS[tree][way]


@pytest.mark.parametrize("tree", DOORS)
def test_no_program_is_given_the_standard_streams(tree):
    """A program may print any text, so its output goes to its reader, or nowhere."""
    given = {}
    for path in (ROOT / tree).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            if called.startswith("subprocess.") or called in ("Popen", "os.system", "os.popen", "os.posix_spawn"):
                names = {keyword.arg for keyword in node.keywords}
                whole = "capture_output" in names or called == "subprocess.check_output" and "stderr" in names
                given[owner(path, tree), node.lineno] = whole or {"stdout", "stderr"} <= names
    assert given and all(given.values()), given


def calls_a_module(path):
    """True where `warn` is called on something else than the door."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "warn":
            if not (isinstance(node.func.value, ast.Name) and node.func.value.id == "ends"):
                return True
    return False


# Any text in, plain text out


class Module:
    """An AnsibleModule that keeps what it is given."""

    params: dict = {}

    def __init__(self):
        self.said = []

    def exit_json(self, **result):
        self.said.append(result)

    fail_json = exit_json

    def warn(self, sentence):
        self.said.append(sentence)


def texts(value):
    """All texts in plain data."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for name, part in value.items():
            yield from [*texts(name), *texts(part)]
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from texts(part)


def through_a_module(text):
    module = Module()
    ends.fail(module, f"it said {text}", found=[{"name": text, text: 1}])
    ends.leave(module, msg=text, topics=(text,))
    ends.warn(module, f"{text} is odd")
    return list(texts(module.said))


def through_a_difference(text):
    module = Module()
    ends.leave(module, diff=[{"before": text, "after": "", "before_header": text}])
    return [line.replace("\t", " ") for part in texts(module.said) for line in part.split("\n")]


def through_the_report(text):
    row = Row("names", "robot1", "robot2", FAILED, text, text)
    part, rival = Component("registration", "robot1", "ghost", text), Component("messages", "robot2", "differ", text)
    diagnosis = Diagnosis((Finding(part, rivals=(rival,), proof=(row,), rows=(row,)),), (row,))
    summary = summarise([row], ["robot1", "robot2"], 2)
    shown = plain_lines(terminal.render(summary, diagnosis))
    return [
        *shown.replace("\t", " ").split("\n"),
        *texts(plain_data(FleetJudgement(summary, diagnosis, [row], None, 0.0).as_data())),
    ]


def through_a_refusal(text):
    """The warnings and the problems that it prints."""
    with patch.object(refusal, "Display") as display, patch.object(refusal, "__version__", "2.19.0"):
        with pytest.raises(refusal.PlainFailure):
            refusal.refuse([text, text], warnings=[text])
        printed = [call.args[0] for call in (display().warning.call_args, display().display.call_args)]
    return [line for one in printed for line in one.split("\n")]


def through_preflight(text):
    return number_problems([f"robot1: found {text}", text]).split("\n")


def through_the_log(text):
    stream = io.StringIO(newline="")
    handler = journal.LineHandler(stream)
    handler.setFormatter(journal.Format())
    handler.handle(logging.LogRecord("rosfleet", logging.WARNING, "", 1, "it says %s", (text,), None))
    lines = stream.getvalue().split("\n")
    assert len(lines) == 2, "one record is one line"
    return lines


def through_print(text):
    stream = io.StringIO(newline="")
    print(f"shutdown request: {text}", file=journal.PlainStream(stream))
    return stream.getvalue().replace("\t", " ").split("\n")


def through_systemd(text):
    sent = []
    with patch.object(systemd.socket, "socket") as made, patch.dict(systemd.os.environ, NOTIFY_SOCKET="/x"):
        made.return_value.__enter__.return_value.sendmsg.side_effect = lambda parts, *_more: sent.append(parts[0])
        systemd.notify("STOPPING=1", f"STATUS={text}")
    lines = sent[0].decode().split("\n")
    assert len(lines) == 2 and lines[1].startswith("STATUS=")
    return lines


def through_diagnostics(text):
    modules = {
        name: MagicMock()
        for name in "genpy rosgraph rosgraph.network roslib roslib.message rospy std_srvs std_srvs.srv diagnostic_msgs "
        "diagnostic_msgs.msg fkie_multimaster_msgs".split()
    }
    with patch.dict(sys.modules, modules), patch.dict("os.environ"):
        sys.modules.pop("rosfleet_multimaster.edge.ros", None)
        from rosfleet_multimaster.edge import ros
        from rosfleet_multimaster.protocol.messages import DiagnosticEntry

        ros.hostname = lambda: "robot1"
        said = []
        ros.diagnostic_classes = MagicMock()
        messages = ros.diagnostic_classes.messages.return_value
        messages.DiagnosticStatus = lambda **fields: said.append(fields)
        messages.KeyValue = lambda *pair: said.append(pair)
        ros.Diagnostics().publish([DiagnosticEntry(text, text, [(text, text)])], 1.0, "robot")
        sys.modules.pop("rosfleet_multimaster.edge.ros", None)
        del sys.modules["rosfleet_multimaster.edge"].ros  # made of what is no ROS, and of no use to other tests
    return list(texts(said))


def through_metrics(text):
    seen = LinkHealth(text, "http://own:11311/", True, 100.0, 0.1, 0, None)
    return metrics.text(links.link_samples(LinkList([seen]))).split("\n")


def through_an_answer(text):
    """A fault of the server; and masterErrors."""
    own = ServedMaster("http://own:11311/", "own", "/master_discovery", lambda: "own", 11611)
    served = RpcMethods(own, MagicMock(), {"x": text}, set, lambda: None, lambda _name: None, list)
    return list(texts(served.methods()["masterErrors"]()))


EXITS = [
    through_a_module,
    through_a_difference,
    through_the_report,
    through_a_refusal,
    through_preflight,
    through_the_log,
    through_print,
    through_systemd,
    through_diagnostics,
    through_metrics,
    through_an_answer,
]


@pytest.mark.parametrize("through", EXITS, ids=lambda through: through.__name__)
@settings(max_examples=25)
@given(
    st.text(st.one_of(st.characters(), st.sampled_from("\n\r\x1b\x85\x9b\u2028\u2029\u202e\u200b\u2066")), max_size=400)
)
def test_any_text_leaves_as_plain_text(through, text):
    for shown in through(text):
        assert is_plain(shown), ascii(shown)


def test_a_fault_of_the_server_is_plain_when_sent_and_when_read():
    def refuse():
        raise RefusedCall("no\nstate\x1b[2J\u202e")

    server = RpcServer("127.0.0.1", 0, {"refuse": refuse}, lambda _host, _why: None)
    try:
        with pytest.raises(Exception) as failure:  # noqa: PT011 a Fault
            Rpc(f"http://127.0.0.1:{server.server_address[1]}", 5.0).call("refuse")
    finally:
        server.stop()
    assert failure.value.faultString == "no state\\x1b[2J\\u202e"
