# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The actions of multimaster_verify: start, collect, stream and stop."""

import typing

from .._base.module import validate_options
from .._base.problem import Problem
from .._features.probes import SETTLINGS
from . import ghosts
from .measure import network, talker
from .options import Params
from .parts import Result, group, list_members, list_talkers, look
from .ros_client.ros import Ros


def start_verification(params: Params, check_mode: bool) -> Result:
    """Look at the machine, start the listener, call the other listeners, and start the talker. Raises Problem."""
    noted = [settling.note() for settling in SETTLINGS]
    # First: the listeners that start below are no part of the machine.
    machine = look_at_machine(params)
    multicast = None if check_mode else group(params, "start")
    result = {"msg": "Check mode: no talker was started."} if check_mode else talk(params, machine)
    for settling, state in zip(SETTLINGS, noted):
        settling.wait(state)  # later measurements go through it
    parts = {"multicast": multicast, "machine": machine}
    return dict(result, **{name: value for name, value in parts.items() if value is not None})


def look_at_machine(params: Params) -> typing.Optional[Result]:
    """Return the result of multimaster_info; None if it is not asked for. Raises Problem."""
    if params["look"] is None:
        return None
    from .facts import machine

    options = validate_options("look", params["look"], machine.OPTIONS)
    error = machine.wrong(options)
    if error:
        raise Problem(f"look: {error}")
    return machine.look(options)


def talk(params: Params, machine: typing.Optional[Result]) -> Result:
    """Call the other listeners, and start the talker. A talker that does not start is a result too."""
    call(params)
    if params["is_router"]:
        return {"msg": "The router of the common network has no talker."}
    ros = Ros(params["environment_file"], choose_environment(params, machine))
    missing = ros.problem()
    if not missing:
        ghosts.end_ghosts(ros, params["name"])
    error = missing or talker.start(ros, params["run"], params["name"], params["lifetime"])
    if not error:
        return {
            "msg": f"The talker runs for {params['lifetime']} s at most.",
            "talker": {"running": True, "error": "", "failed": False},
        }
    failed = params["is_master"] or not missing
    msg = f"{'Cannot start the talker' if failed else 'No talker'}: {error.rstrip('.')}."
    return {"msg": msg, "talker": {"running": False, "error": error, "failed": failed, "msg": msg}}


def choose_environment(params: Params, machine: typing.Optional[Result]) -> typing.Dict[str, str]:
    """Return the variables of ROS if there is no file with them; empty if the collection has set up the machine."""
    if machine is None:
        return dict(params["environment"])
    chosen = (machine.get("ros") or {}).get("chosen")
    return {} if machine.get("owned") or not chosen else {**chosen["environment"], **params["variables"]}


def call(params: Params) -> None:
    """Send to the helpers. In other networks they see a translation of addresses, in the own network a loss of packets."""
    network.call(
        [
            member["discovery_address"] or member["address"]
            for member in params["members"] or []
            if member["discovery"] and member["name"] != params["name"]
        ],
        params["port"],
    )


def collect_results(params: Params, check_mode: bool) -> Result:
    """Look at all others."""
    if not check_mode:
        call(params)  # once more: a computer without a listener at the first time hears it now
    result = look(params, check_mode)
    if not params["is_router"]:
        missing = result["ros_missing"]
        result["talker"] = {"running": False, "error": missing} if missing else talker.state()
    if result["multicast"] is None:
        del result["multicast"]
    result["msg"] = f"Looked at {len(list_members(params))} computers in {result['seconds']:.1f} s."
    return result


def stream_to_talkers(params: Params, check_mode: bool) -> Result:
    """Send to the talkers of the others, one after the other."""
    if check_mode or params["is_router"]:
        return {"msg": "Nothing was sent.", "streams": []}
    from .measure import streams

    ros = Ros(params["environment_file"], params["environment"])
    results = (
        streams.streams(ros, list_talkers(params), params["run"], params["name"], params["seconds"])
        if not ros.problem()
        else []
    )
    return {"msg": f"Sent to {len(results)} computers.", "streams": results}


def stop_talker(_params: Params, check_mode: bool) -> Result:
    """End the talker, wherever there is one."""
    if check_mode:
        return {"msg": "Check mode: no talker was stopped."}
    talker.stop()
    return {"msg": "No talker runs."}


ACTIONS = {
    "start": start_verification,
    "collect": collect_results,
    "stream": stream_to_talkers,
    "stop": stop_talker,
}
