# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The option `action` of a module that measures: what it is to do. The option was `state` before, and its words were others.

Playbooks with the former name and words run as before: `state` is an alias, and each former word stands for one of today.
"""

import typing

_WORDS = {"listed": "list", "started": "start", "collected": "collect", "streamed": "stream", "stopped": "stop"}


def list_words(*actions: str) -> typing.List[str]:
    """Return the words that stand for these actions: those of today, then the former ones."""
    return [*actions, *(former for former, action in _WORDS.items() if action in actions)]


def read_action(params: typing.Mapping[str, typing.Any]) -> str:
    """Return the action that the options ask for, in the word of today."""
    word: str = params["action"]
    return _WORDS.get(word, word)
