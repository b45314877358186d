# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The ends of a module, and its warnings. All quotations of files, commands and strangers become plain text.

Nothing else calls exit_json, fail_json or warn (tests/unit/test_exits.py).
"""

import typing

from .plain_text import VALUE, change_texts, plain, plain_data, plain_lines

_LONG = 1000  # characters of an option that are still returned


def leave(module: typing.Any, **result: typing.Any) -> None:
    """End a module with its result."""
    module.exit_json(**_plain(result), **_long_options(module))


def fail(module: typing.Any, msg: str, **result: typing.Any) -> None:
    """End a module with a sentence, and with the rest of its result."""
    module.fail_json(**_plain(dict(result, msg=msg)), **_long_options(module))


def warn(module: typing.Any, sentence: str) -> None:
    """Warn with a sentence."""
    module.warn(plain(sentence, VALUE))


def _long_options(module: typing.Any) -> typing.Dict[str, typing.Any]:
    """Return the options, shortened, if one is long: Ansible returns them, and the controller keeps them for each host."""
    short = change_texts(module.params, lambda text: text if len(text) <= _LONG else f"({len(text)} characters)")
    return {} if short == module.params else {"invocation": {"module_args": short}}


def _plain(result: typing.Dict[str, typing.Any]) -> typing.Dict[str, typing.Any]:
    """Make all texts of a result plain. Those of `diff` are files and keep their lines."""
    made = plain_data({name: value for name, value in result.items() if name != "diff"})
    if "diff" in result:
        made["diff"] = change_texts(result["diff"], lambda text: plain_lines(text, VALUE))
    return made
