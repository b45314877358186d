# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The ends of a module, and its warnings: what they quote of files, commands and strangers is plain text.

Nothing else calls exit_json, fail_json or warn (tests/unit/test_exits.py).
"""

import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import (
    VALUE,
    plain,
    plain_data,
    plain_lines,
)

_LONG = 1000  # characters of an option that are still returned


def leave(module: typing.Any, **result: typing.Any) -> None:
    """End a module with its result."""
    module.exit_json(**_plain(result), **_asked(module))


def fail(module: typing.Any, msg: str, **result: typing.Any) -> None:
    """End a module with a sentence, and with the rest of its result."""
    module.fail_json(**_plain(dict(result, msg=msg)), **_asked(module))


def warn(module: typing.Any, sentence: str) -> None:
    """Warn with a sentence."""
    module.warn(plain(sentence, VALUE))


def _asked(module: typing.Any) -> typing.Dict[str, typing.Any]:
    """Return what the module was asked for, where that is long: Ansible returns it, and the controller keeps it for each host.

    The nodes' files are half a megabyte, which each computer would send back.
    """
    if not hasattr(module, "argument_spec"):  # a part of a module, whose result has no such entry
        return {}
    short = _shortened(module.params)
    return {} if short == module.params else {"invocation": {"module_args": short}}


def _shortened(value: typing.Any) -> typing.Any:
    """A copy in which a long text is its length."""
    if isinstance(value, str) and len(value) > _LONG:
        return f"({len(value)} characters)"
    if isinstance(value, dict):
        return {name: _shortened(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_shortened(part) for part in value]
    return value


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
