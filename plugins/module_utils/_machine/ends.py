# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The ends of a module, and its warnings: what they quote of files, commands and strangers is plain text.

Nothing else calls exit_json, fail_json or warn (tests/unit/test_exits.py).
"""

import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.plain_text import (
    VALUE,
    plain,
    plain_data,
    plain_lines,
)


def leave(module: typing.Any, **result: typing.Any) -> None:
    """End a module with its result."""
    module.exit_json(**_plain(result))


def fail(module: typing.Any, msg: str, **result: typing.Any) -> None:
    """End a module with a sentence, and with the rest of its result."""
    module.fail_json(**_plain(dict(result, msg=msg)))


def warn(module: typing.Any, sentence: str) -> None:
    """Warn with a sentence."""
    module.warn(plain(sentence, VALUE))


def _plain(result: typing.Dict[str, typing.Any]) -> typing.Dict[str, typing.Any]:
    """A result of plain texts. Those of `diff` are files: there, lines stay lines."""
    made = plain_data({name: value for name, value in result.items() if name != "diff"})
    if "diff" in result:
        made["diff"] = _lines(result["diff"])
    return made


def _lines(value: typing.Any) -> typing.Any:
    if isinstance(value, str):
        return plain_lines(value, VALUE)
    if isinstance(value, dict):
        return {plain(name, VALUE): _lines(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_lines(part) for part in value]
    return value
