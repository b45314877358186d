# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The parameters of discovery and sync on the roscore, compared with those of the plan; and the digests of those that cross."""

import hashlib
import json
import typing

from ..._base.plain_text import plain
from ..._base.regular_files import read_regular
from ..._contract.ros import CrossingParameter, NodeParameters, ParameterDifference
from ..ros_client.ros import Ros

FILTERS = ("ignore_", "sync_", "hide_", "do_not_sync")  # how the names of filters begin
SIM_TIME = "/use_sim_time"
MOST = 50  # parameters that are listed
LONGEST = 200  # characters of a value: they are for people
# The nodes that have their parameters from a file. They start again as soon as it is another one.
FILES = {"master_relay": "/etc/rosfleet-multimaster/master_relay.json"}
_MOST_BYTES = 4 << 20
# The same nodes of fkie_mas, if a person has started them by hand.
SUCCESSOR = {"master_discovery": "mas_discovery", "master_sync": "mas_sync"}
Plan = typing.Dict[str, typing.Dict[str, typing.Any]]  # node -> its parameters


def parameters(
    ros: Ros, planned: typing.Optional[Plan], crossing: typing.Iterable[str] = ()
) -> typing.Dict[str, typing.Any]:
    """Compare the namespace of each node with the planned one; its units write all of it there when the node starts.

    `crossing`: names of parameters whose digests are wanted, since two robots are to have the same.
    """
    found = NodeParameters().plain()
    for node, wanted in sorted((planned or {}).items()):
        if not wanted:
            continue
        try:
            there = _read(ros, node)
        except OSError as problem:
            found["error"] = str(problem)
            continue
        if isinstance(there, dict):
            found["nodes"].append(node)
            found["differing"] += compare(node, wanted, there)
    try:
        found["simulated"] = _is_simulated(ros)
        found["crossing"] = [CrossingParameter(name, digest=_read_digest(ros, name)).plain() for name in crossing]
    except OSError as problem:
        found["error"] = str(problem)
    return found


def _is_simulated(ros: Ros) -> bool:
    """Return True if nodes of this roscore take their time from /clock. Raises OSError if the roscore does not answer."""
    return bool(ros.ask("hasParam", SIM_TIME)) and ros.ask("getParam", SIM_TIME) is True


def _read_digest(ros: Ros, name: str) -> str:
    """Read the digest of a parameter, empty if it is not set. Raises OSError if the roscore does not answer."""
    if not ros.ask("hasParam", name):
        return ""
    value = ros.ask("getParam", name)
    return "" if value == {} else digest(value)


def digest(value: typing.Any) -> str:
    """Return the common form of two values that are the same. The ends of lines are as XML has them."""
    try:
        text = json.dumps(value, sort_keys=True, default=repr)
    except (ValueError, TypeError, RecursionError):
        text = "?"
    return hashlib.sha256(text.replace("\\r\\n", "\\n").replace("\\r", "\\n").encode()).hexdigest()


def _read(ros: Ros, node: str) -> typing.Any:
    """Read the namespace of a node, or its file. Raises OSError with the sentence about the usual name if neither is there."""
    if node in FILES:
        return _read_file(FILES[node])
    try:
        return ros.ask("getParam", "/" + node)
    except OSError:
        try:
            return ros.ask("getParam", "/" + SUCCESSOR[node])
        except (OSError, KeyError):
            pass
        raise


def _read_file(path: str) -> typing.Any:
    """Read the parameters in a file. Raises OSError."""
    try:
        return json.loads(read_regular(path, _MOST_BYTES).decode("utf-8"))
    except (ValueError, RecursionError) as problem:
        raise OSError(f"{path} is no JSON: {problem}") from problem


def compare(
    node: str, wanted: typing.Dict[str, typing.Any], there: typing.Dict[str, typing.Any]
) -> typing.List[typing.Dict[str, str]]:
    """List the parameters with another value; None stands for a parameter that is not set.

    Of parameters that the plan does not have only filters count: nodes read more than the collection sets, and write their defaults.
    """
    both = dict({name: None for name, value in there.items() if _filters(name, value)}, **wanted)
    return [
        ParameterDifference(node, plain(name)[:LONGEST], expected=_text(expected), found=_text(found)).plain()
        for name, value in sorted(both.items())
        if there.get(name) != value
        for expected, found in [_leave_out_common(value, there.get(name))]
    ][:MOST]


def _leave_out_common(value: typing.Any, found: typing.Any) -> typing.Tuple[typing.Any, typing.Any]:
    """Return the items of two lists that differ: a text for people is cut, and the difference may be at its end."""
    if not (isinstance(value, list) and isinstance(found, list)) or len(value) + len(found) > MOST * MOST:
        return value, found
    more, less = [one for one in value if one not in found], [one for one in found if one not in value]
    if [type(one) for one in (*more, *less)] == [dict, dict] and more and less:
        return _compare_entries(more[0], less[0])
    return (more, less) if more or less else (value, found)  # another order


def _compare_entries(
    one: typing.Dict[str, typing.Any], other: typing.Dict[str, typing.Any]
) -> typing.Tuple[typing.Dict[str, typing.Any], typing.Dict[str, typing.Any]]:
    """Return the keys of two entries of which the values differ, with their differences."""
    names = [name for name in sorted({*one, *other}) if one.get(name) != other.get(name)]
    pairs = [(name, _leave_out_common(one.get(name), other.get(name))) for name in names]
    return {name: both[0] for name, both in pairs}, {name: both[1] for name, both in pairs}


def _filters(name: str, value: typing.Any) -> bool:
    """Return True for a parameter, or the section of a master, by which a node keeps something back."""
    return name == "exports" or isinstance(value, dict) or (name.startswith(FILTERS) and bool(value))


def _text(value: typing.Any) -> str:
    """A value for people: a roscore takes anything from any program."""
    try:
        return "not set" if value is None else plain(json.dumps(value, sort_keys=True, default=str))[:LONGEST]
    except (ValueError, RecursionError):
        return "a value that cannot be written"
