# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The lines of /etc/hosts, and the plan of the new file. Pure: bytes in, bytes and a report out.

The mark in a line shows its owner. So there is no second record that could be lost, or differ from the file after a
run was killed. A line may be moved. A reader of the file sees which lines the module owns:

    192.168.1.239   kobuki2computer # rosfleet.multimaster
        Owned, whatever it says: repaired, and removed as a whole. A person who removes the mark owns the line again.
    127.0.1.1 other # rosfleet.multimaster replaced: 127.0.1.1 kobuki2computer other
        The user's line without the managed names. Behind the mark it is kept byte for byte.
    # rosfleet.multimaster created this file
        There was no file before, so it is removed when nothing else is left in it.

Every other line belongs to the user and is kept byte for byte. So a rollback is exact for any content.
"""

import typing

from .bindings import Binding, parse

# A mark is the whole first comment of its line: a person's remark about this module is no mark.
_MARK = b"# rosfleet.multimaster"
_CREATED = _MARK + b" created this file"
_REPLACED = _MARK + b" replaced: "
# A comment of Debian's own, which is no mark of a program.
_HEADING = b"# The following lines are desirable for IPv6 capable hosts"


_Item = typing.Dict[str, typing.Any]


class HostsPlan(typing.NamedTuple):
    """The new content of the file (None: no file), and the report as the module returns it."""

    content: typing.Optional[bytes]
    entries: typing.List[_Item]
    removed: typing.List[_Item]
    replaced: typing.List[_Item]
    conflicts: typing.List[_Item]


class _Line:
    """A line: its text (None: to be added), the user's text of it (None: owned) and the wanted text (None: no line)."""

    def __init__(self, number: int, text: typing.Optional[bytes]) -> None:
        self.number = number
        self.text = text
        self.user = self.wanted = _user_text(text)
        self.host = parse(self.user if self.user is not None else text or b"")
        self.created = _is_created(text or b"")


_Key = typing.Tuple[int, str]
_Bound = typing.Dict[Binding, _Line]
_Position = typing.Dict[_Line, int]  # the numbers of the lines in the new file


def _user_text(text: typing.Optional[bytes]) -> typing.Optional[bytes]:
    """The user's text of a line, or None for an owned line."""
    if text is None:
        return None
    start = 0
    while True:
        mark = text.find(b"#", start)
        if mark == -1 or not text.startswith(_MARK, mark):
            return text[start:]
        if not text.startswith(_REPLACED, mark):
            break
        start = mark + len(_REPLACED)
    bound, comment = text[start:mark].strip(), text[mark:].rstrip()
    owned = comment == _MARK if bound else _is_created(text[start:])
    return None if owned else text[start:]


def _is_created(text: bytes) -> bool:
    return text.rstrip() == _CREATED


def plan(content: typing.Optional[bytes], bindings: typing.List[Binding]) -> HostsPlan:
    """Plan the file for these bindings (content None: there is no file); without bindings, the rollback.

    plan(plan(x, a).content, []).content is x for every x without owned lines, and a second plan changes nothing.
    """
    # Joined again, the pieces are the same bytes, with or without a newline at the end.
    pieces = (_CREATED + b"\n" if content is None else content).split(b"\n")
    lines = [_Line(number, text) for number, text in enumerate(pieces, 1)]
    managed = {key: binding for binding in bindings for key in binding.keys}

    bound = _find_user_lines(lines, bindings)
    _take_out_of_loopback(lines, {name for version, name in managed})
    _place(lines, [binding for binding in bindings if binding not in bound], bound)
    for line in lines:
        if line.created and bindings:
            line.wanted = line.text
    return _report(lines, bindings, bound, managed)


def _report(
    lines: typing.List[_Line], bindings: typing.List[Binding], bound: _Bound, managed: typing.Dict[_Key, Binding]
) -> HostsPlan:
    left = [line for line in lines if line.wanted is not None]
    position = {line: number for number, line in enumerate(left, 1)}
    user_lines = [line for line in left if line.user is not None]
    return HostsPlan(
        content=_content(lines, left, rollback=not bindings),
        entries=[_entry(binding, bound[binding], position) for binding in bindings],
        removed=[_removal(line) for line in lines if line.wanted is None and not line.created],
        replaced=[_replacement(line, position) for line in user_lines if {line.text, line.wanted} != {line.user}],
        conflicts=[conflict for line in user_lines for conflict in _conflicts(line, managed, bound, position)],
    )


def _content(lines: typing.List[_Line], left: typing.List[_Line], rollback: bool) -> typing.Optional[bytes]:
    after = b"\n".join(line.wanted or b"" for line in left)
    created = any(line.created for line in lines)
    return None if created and rollback and not after else after


# The lines for the bindings


def _find_user_lines(lines: typing.List[_Line], bindings: typing.List[Binding]) -> _Bound:
    """The bindings that a line of the user has already, with that line: no line is added for them."""
    by_address = {binding.address: binding for binding in bindings}
    bound: _Bound = {}
    for line in lines:
        host = line.host if line.user is not None else None
        binding = by_address.get(host.address) if host else None
        if host and binding and binding not in bound and set(binding.keys) <= set(host.keys):
            bound[binding] = line
    return bound


def _take_out_of_loopback(lines: typing.List[_Line], names: typing.Set[str]) -> None:
    """Remove managed names from the user's loopback lines, of both families: libc answers ::1 as 127.0.0.1, too."""
    for line in lines:
        if line.user is None or not line.host or not line.host.address.is_loopback:
            continue
        address, names_text = line.user.partition(b"#")[0].split(None, 1)
        rest = [name for name in names_text.split() if name.decode("latin-1").lower() not in names]
        if len(rest) < len(names_text.split()):
            shown = address + b" " + b" ".join(rest) + b" " if rest else b""
            line.wanted = shown + _MARK + b" replaced: " + line.user


def _place(lines: typing.List[_Line], bindings: typing.List[Binding], bound: _Bound) -> None:
    """Give each binding an owned line: if its name has one already, else at the place for new ones."""
    end = b"\r" if lines[0].text and lines[0].text.endswith(b"\r") else b""
    missing = {binding.keys[0]: binding for binding in bindings}
    owned_lines = []
    for index, line in enumerate(lines):
        key = line.host.keys[0] if line.user is None and line.host else None
        if key in missing:
            binding = missing.pop(key)
            line.wanted = _text(binding, end)
            bound[binding] = line
            owned_lines.append(index)
    at = _find_place(lines, owned_lines)
    new = []
    for binding in bindings:
        if binding not in bound:
            bound[binding] = _Line(0, None)
            bound[binding].wanted = _text(binding, end)
            new.append(bound[binding])
    lines[at:at] = new


def _find_place(lines: typing.List[_Line], owned_lines: typing.List[int]) -> int:
    """The index for new lines: behind owned lines, else behind IPv4, but never between two comments of the user.

    Other programs keep lines of theirs between two comments, in words of their own, and write all that is between them anew.
    """
    # Before the last piece: that is what follows the last newline, or a line without a newline, which stays without one.
    last = len(lines) - 1
    texts = [(line.user or b"").strip() for line in lines]
    comments = [index for index, text in enumerate(texts) if b"#" in text and text != _HEADING]
    above, below = (comments[0], comments[-1] + 1) if comments else (last, 0)
    ipv4_lines = _find_ipv4_lines(lines)
    places = [min(one[-1] + 1, last) for one in (owned_lines, ipv4_lines) if one]
    places += [index + 1 for index in ipv4_lines[::-1] if index < above] + [last, 0]
    return next(place for place in places if place <= above or place >= below)


def _find_ipv4_lines(lines: typing.List[_Line]) -> typing.List[int]:
    """The indexes of the user's lines that have an IPv4 address."""
    return [
        index
        for index, line in enumerate(lines)
        if line.user is not None and line.host and line.host.address.version == 4
    ]


def _text(binding: Binding, end: bytes) -> bytes:
    return f"{binding.address}\t{' '.join(binding.names)} ".encode("ascii") + _MARK + end


# The report


def _entry(binding: Binding, line: _Line, position: _Position) -> _Item:
    return {
        "address": str(binding.address),
        "names": list(binding.names),
        "state": "added" if line.text is None else "unchanged" if line.text == line.wanted else "changed",
        "ours": line.user is None,
        "line": position[line],
    }


def _removal(line: _Line) -> _Item:
    return {"line": line.number, "text": readable(line.text)}


def _replacement(line: _Line, position: _Position) -> _Item:
    state = "restored" if line.wanted == line.user else "unchanged" if line.wanted == line.text else "replaced"
    shown = line.user if state == "restored" else (line.wanted or b"").split(b"#", 1)[0]
    return {
        "before": readable(line.user),
        "after": readable(shown).rstrip(),
        "state": state,
        "line": position[line],
    }


def _conflicts(
    line: _Line, managed: typing.Dict[_Key, Binding], bound: _Bound, position: _Position
) -> typing.Iterator[_Item]:
    """The managed names that have another address of the same family in this line of the user."""
    if not line.host or line.host.address.is_loopback:
        return
    for name in line.host.names:
        binding = managed.get((line.host.address.version, name.lower()))
        if binding and binding.address != line.host.address:
            yield {
                "line": line.number,
                "text": readable(line.user),
                "name": name,
                "found": str(line.host.address),
                "expected": str(binding.address),
                "effect": "shadows" if position[line] < position[bound[binding]] else "adds",
            }


def readable(text: typing.Optional[bytes]) -> str:
    """Bytes of the file as text for a person."""
    return (text or b"").decode("utf-8", "replace")
