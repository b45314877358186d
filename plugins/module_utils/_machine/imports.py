# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A trial import of Python modules by a user without rights: the services of the nodes run as such a user."""

import re
import typing

from .._module.plain_text import plain
from .._process.foreign import foreign, last_line

_IMPORTING = 60.0  # seconds; 0.4 on a PC, cold on a small robot ten
_VERSION = re.compile(r"[23]\.[0-9]{1,3}\.[0-9]{1,3}")

_ASK = """
import importlib, json, sys
missing = []
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except Exception:
        missing.append(name)
print()
print(json.dumps({"version": "%d.%d.%d" % sys.version_info[:3], "missing": missing}))
"""


class Trial(typing.NamedTuple):
    """A trial import: the version of Python ("" for no answer), the missing modules, and the error."""

    version: str
    missing: typing.List[str]
    error: str = ""


def attempt(python: str, modules: typing.Sequence[str], environment: typing.Dict[str, str]) -> Trial:
    """Let a user without rights import modules with this Python."""
    answer = foreign([python, "-c", _ASK, *modules], environment, _IMPORTING)
    result = last_line(answer.output)
    result = result if isinstance(result, dict) else {}
    version, missing = result.get("version"), result.get("missing")
    if not isinstance(version, str) or not _VERSION.fullmatch(version) or not isinstance(missing, list):
        return Trial("", [], plain(answer.last_error or "no answer"))
    return Trial(version, [name for name in modules if name in missing])
