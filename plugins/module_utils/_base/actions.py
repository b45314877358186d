# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The option `action` of a module that measures: its task. The option was `state` before, and its words were others.

Playbooks with the former name and words run as before: `state` is an alias, and each former word means one of today.
"""

import typing

from . import ends
from .problem import Problem

_WORDS = {"listed": "list", "started": "start", "collected": "collect", "streamed": "stream", "stopped": "stop"}

Params = typing.Dict[str, typing.Any]


def list_words(*actions: str) -> typing.List[str]:
    """Return the words for these actions: those of today, then the former ones."""
    return [*actions, *(former for former, action in _WORDS.items() if action in actions)]


def read_action(params: Params) -> str:
    """Return the action that the options ask for, in the word of today."""
    word: str = params["action"]
    return _WORDS.get(word, word)


def carry_out(
    module: typing.Any,
    find_wrong: typing.Callable[[Params], typing.Optional[str]],
    actions: typing.Mapping[str, typing.Callable[[Params, bool], typing.Dict[str, typing.Any]]],
) -> None:
    """Carry out the action, and end the module. Wrong options, and a Problem, end it with their sentence.

    Each action takes the options, and whether it is only to look (check mode).
    """
    try:
        wrong = find_wrong(module.params)
        if wrong:
            raise Problem(wrong)
        result = actions[read_action(module.params)](module.params, module.check_mode)
    except Problem as problem:
        ends.fail(module, msg=str(problem))
    ends.leave(module, changed=False, **result)
