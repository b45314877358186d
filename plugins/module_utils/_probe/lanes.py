# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Looks at all parts at the same time, in lanes."""

import time
import typing
from itertools import chain

from ansible_collections.rosfleet.multimaster.plugins.module_utils._client.ros import Ros
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import LINE, quote
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.options import Params
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.parts import (
    LONGEST,
    PARTS,
    Part,
    Result,
    is_due,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process.deadlines import call_all

PartResult = typing.Tuple[Part, typing.Any, str]  # a part, its value, and why there is none


def look(params: Params, quiet: bool) -> Result:
    """Look at all due parts at the same time. A part that fails gives a sentence in `problems`."""
    start = time.monotonic()
    result: Result = {part.name: part.default for part in PARTS}
    result["problems"] = []
    ros = Ros(params["environment_file"], params["environment"])

    def attempt(part: Part) -> PartResult:
        try:
            return part, part.look(params, ros, start + params["patience"]), ""
        except Exception as problem:  # a strange machine may raise anything: the other parts still count
            return part, part.default, f"{part.name} could not be looked at: {quote(str(problem).rstrip('.'), LINE)}."

    def late(part: Part) -> PartResult:
        return part, part.default, f"{part.name} gave no result within {LONGEST:g} s."

    for part, value, problem in look_in_lanes([part for part in PARTS if is_due(part, params, quiet)], attempt, late):
        result[part.name] = value
        result["problems"] += [problem] if problem else []
    result["seconds"] = round(time.monotonic() - start, 1)
    return result


def look_in_lanes(
    parts: typing.List[Part], attempt: typing.Callable[[Part], PartResult], late: typing.Callable[[Part], PartResult]
) -> typing.List[PartResult]:
    """Look at parts at the same time: the final parts after the others, and the shared parts beside both."""

    def lane(members: typing.List[Part]) -> typing.List[PartResult]:
        stages = ([part for part in members if part.final == final] for final in (False, True))
        return [result for stage in stages for result in call_all(attempt, stage, LONGEST, late)]

    lanes = [[part for part in parts if part.shared == shared] for shared in (True, False)]
    return list(chain.from_iterable(call_all(lane, lanes, 2 * LONGEST, lambda members: list(map(late, members)))))
