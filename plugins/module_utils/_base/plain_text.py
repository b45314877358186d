# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Foreign text, made plain: a text of strangers must not steer a terminal, a journal or systemd.

One file for three trees: the controller imports it (plugins/plugin_utils/_base/plain_text.py), the modules have a copy
(plugins/module_utils/_base/plain_text.py; `make copies`). So it runs on Python 3.6 and needs nothing.
"""

import re
import typing

LONGEST = 200  # characters of a foreign text
LINE = 2000  # characters of a line of ours that quotes such texts
VALUE = 65536  # characters of a value that a program reads: names and paths stay whole
CUT = "..."  # the sign that more was there

# Printable for Python, and yet invisible (Default_Ignorable_Code_Point of Unicode), or empty as a space is.
_INVISIBLE = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u2800\u3164\ufe00-\ufe0f\uffa0\ufff0-\ufff8\U000e0000-\U000e0fff]"
)


# Texts that are in a sentence without quotes: a name, an address, a URI or a time. Each has a character that no word of a sentence
# has. So `none`, `PASSED` and `ok=1` are none of these, also if something has such a name.
_NAME = re.compile(
    r"""
    (?= .* [0-9_/.@~] )
    (?: [A-Za-z0-9_~/] (?: [A-Za-z0-9_./@+-]* [A-Za-z0-9_/] )?
    | [0-9A-Fa-f:.]* [0-9A-Fa-f] (?: / [0-9]{1,3} )?
    | (?: [a-z]+:// )? [A-Za-z0-9_.-]+ : [0-9]{1,5} /?
    | [a-z]+:// [A-Za-z0-9_.-]+ /?
    | (?: [A-Z][a-z]{2}[ ] )? [0-9]{4}-[0-9]{2}-[0-9]{2} [ ] [0-9:.]{5,15} (?: [ ] [A-Z+-][A-Z0-9]{1,5} )?
    )
    """,
    re.VERBOSE,
)
_NAME_LENGTH = 120


def plain(value: typing.Any, most: int = LONGEST) -> str:
    """The text of a value on one line, of printable characters only, and of at most `most` of them.

    Line breaks and other spaces become a blank, and many of them are one; any other character that is not printable, such
    as one of an escape sequence or one that turns the direction of writing, is shown as Python writes it (`\\x1b`). Plain
    text stays as it is.
    """
    text = str(value)
    if is_plain(text, most) and "  " not in text and text == text.strip():
        return text
    joined = " ".join(text[: 4 * most + 2].split())
    head = joined[: most + 1]
    more = len(joined) > most or bool(text[4 * most + 2 :].strip())
    shown = "".join(map(_escape, head))
    return _cut(shown, most) if more or len(shown) > most else shown


def _cut(text: str, most: int) -> str:
    """The beginning of a text. A quotation that is open there is closed, so the next words are not read as a part of it."""
    head = text[: max(most - len(CUT), 0)]
    if head.count('"') % 2 == 0:
        return head + CUT
    head = head[:-1]
    return head + CUT + '"' * (head.count('"') % 2)


def quote(value: typing.Any, most: int = LONGEST) -> str:
    """A name or a foreign text as it is in a sentence of ours, so that nothing in it is taken for one.

    A name is itself, if it has the form of one. Every other text is in quotes, and has no quotes in it: a name with blanks or
    of only letters, a reason, a message. A text that is quoted already stays as it is.
    """
    text = str(value)
    if not text or (len(text) <= _NAME_LENGTH and _NAME.fullmatch(text)):
        return text
    inner = text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text
    return '"' + plain(inner, most).replace('"', "'") + '"'


def plain_lines(value: typing.Any, most: int = LINE) -> str:
    """A text of several lines, each of printable characters and tabs only; others are shown as an escape."""
    return "\n".join(_plain_line(line, most) for line in str(value).split("\n"))


def plain_data(value: typing.Any, most: int = VALUE) -> typing.Any:
    """The same value with all of its texts made plain."""
    return change_texts(value, lambda text: text if is_plain(text, most) else plain(text, most))


def change_texts(value: typing.Any, change: typing.Callable[[str], str]) -> typing.Any:
    """The same value with each text changed: those of lists and mappings, and the names in mappings."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, dict):
        return {change_texts(name, change): change_texts(part, change) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [change_texts(part, change) for part in value]
    return value


def is_plain(text: str, most: int = VALUE) -> bool:
    """True if a text is on one line, printable and not too long: names that are not are refused, never changed."""
    return len(text) <= most and text.isprintable() and not _INVISIBLE.search(text)


def _plain_line(line: str, most: int) -> str:
    if is_plain(line.replace("\t", ""), most):
        return line
    shown = "".join(character if character == "\t" else _escape(character) for character in line[: most + 1])
    return shown[: most - len(CUT)] + CUT if len(shown) > most or len(line) > most else shown


def _escape(character: str) -> str:
    if character.isprintable() and not _INVISIBLE.match(character):
        return character
    return character.encode("unicode_escape").decode("ascii")
