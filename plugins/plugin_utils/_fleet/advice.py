# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A command in advice: the only way to make one. Pure, our words and values in, a command or nothing out.

People paste it as root. So each value has the whole form that its place asks for, of ASCII alone, and is a single word for a
shell whatever stands around it. Where one has not, there is no command.
"""

from __future__ import annotations

import re
import shlex
from ipaddress import IPv4Address

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import LONGEST

#: forms of values; none of them begins as an option does
FORMS = {
    "device": re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.@-]{0,14}"),
    "number": re.compile(r"[0-9]{1,10}"),
    "address": re.compile(r"[0-9]{1,3}(?:\.[0-9]{1,3}){3}"),
    "name": re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*"),  # of a computer
    "unit": re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@:-]*\.service"),
    "setting": re.compile(r"[a-z0-9_]+(?:\.[A-Za-z0-9_-]+)+"),
    "file": re.compile(r"/etc/(?!.*\.\.)[A-Za-z0-9_./-]+"),
    "drop-in": re.compile(r"/(?:etc|run)/systemd/system/(?!.*\.\.)[A-Za-z0-9_./@-]+\.conf"),
    # what is deleted, as policy.py has read it
    "route": re.compile(r"(?:blackhole|unreachable|prohibit) (?:default|[0-9./]+)(?: table [A-Za-z0-9_.-]+)?"),
    "rule": re.compile(
        r"priority [0-9]+(?: from (?:all|[0-9./]+))?(?: to [0-9./]+)? (?:table [A-Za-z0-9_.-]+|blackhole|unreachable|prohibit)"
    ),
    # a name, address, unit or setting in the remedy of a part
    "what": re.compile(r"[A-Za-z0-9][A-Za-z0-9_./@:-]*"),
}
PHRASES = ("route", "rule")  # several words of `ip`, each of which passes a shell as it is
# As a value stands in an expression of sed, within quotes.
WRITTEN = {"name": (".", r"\."), "setting": (".", "[./]")}


def command(words: str, *values: tuple[str, object]) -> str:
    """Put values, each with its form, at the {} of our words. Empty where a value has not its form."""
    texts = [format_value(form, str(value)) for form, value in values]
    return words.format(*texts) if all(texts) else ""


def format_value(form: str, text: str) -> str:
    """The text as it stands in a command, empty where it is not of this form."""
    if len(text) > LONGEST or not FORMS[form].fullmatch(text) or (form == "address" and not _is_address(text)):
        return ""
    words = text.split(" ") if form in PHRASES else [text]
    if any(shlex.quote(word) != word for word in words):
        return ""
    return text.replace(*WRITTEN[form]) if form in WRITTEN else text


def _is_address(text: str) -> bool:
    try:
        return bool(IPv4Address(text))
    except ValueError:
        return False
