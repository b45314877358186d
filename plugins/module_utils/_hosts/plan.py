# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The lines of /etc/hosts, and the plan of what becomes of them. Pure: bytes in, bytes and a report out.

Who owns a line stands in the line, so there is no second memory that could be lost, or differ from the file when a
run dies between two writes; a line may be moved; and a person who reads the file sees what is ours:

    192.168.1.239   kobuki2computer # rosfleet.multimaster
        Ours, whatever it says: put right, and taken back as a whole. Who takes the mark away takes the line over.
    127.0.1.1 other # rosfleet.multimaster replaced: 127.0.1.1 kobuki2computer other
        The user's line, with our names taken out of it (erratum E5). Behind the mark it stands byte for byte.
    # rosfleet.multimaster created this file
        There was no file before us, so it goes when nothing else is left in it.

Every other line is the user's, and is kept byte for byte. Taking back is therefore exact for any content.
"""

import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._hosts.bindings import Binding, parse

# A mark is the first comment of its line, and all of it: a person's remark about us is not taken for one.
_MARK = b"# rosfleet.multimaster"
_CREATED = _MARK + b" created this file"
_OURS = re.compile(rb"[^#]*[^#\s][^#]*" + re.escape(_MARK) + rb"\s*\Z")
_REPLACED = re.compile(rb"[^#]*" + re.escape(_MARK) + rb" replaced: (.*)\Z", re.DOTALL)


_Item = typing.Dict[str, typing.Any]


class Plan(typing.NamedTuple):
    """What becomes of the file: its content (None: no file), and the report as the module returns it."""

    content: typing.Optional[bytes]
    entries: typing.List[_Item]
    removed: typing.List[_Item]
    replaced: typing.List[_Item]
    conflicts: typing.List[_Item]


class _Line:
    """A line: its text (None: to be added), the user's text of it (None: ours), and the text wanted (None: no line)."""

    def __init__(self, number: int, text: typing.Optional[bytes]) -> None:
        self.number = number
        self.text = text
        self.user = self.wanted = _of_user(text)
        self.host = parse(self.user if self.user is not None else text or b"")
        self.created = _is_created(text or b"")


_Key = typing.Tuple[int, str]
_Bound = typing.Dict[Binding, _Line]
_Position = typing.Dict[_Line, int]


def _of_user(text: typing.Optional[bytes]) -> typing.Optional[bytes]:
    """The user's text of a line, or None where the line is ours."""
    if text is None or _is_created(text) or _OURS.match(text):
        return None
    replaced = _REPLACED.match(text)
    return _of_user(replaced.group(1)) if replaced else text


def _is_created(text: bytes) -> bool:
    return text.rstrip() == _CREATED


def plan(content: typing.Optional[bytes], bindings: typing.List[Binding]) -> Plan:
    """What becomes of a file (None: there is none) under these bindings; none of them take all of ours back.

    plan(plan(x, a).content, []).content is x for every x without lines of ours, and a second plan changes nothing.
    """
    # Joined again, the pieces are the same bytes, with or without a newline at the end.
    pieces = (_CREATED + b"\n" if content is None else content).split(b"\n")
    lines = [_Line(number, text) for number, text in enumerate(pieces, 1)]
    managed = {key: binding for binding in bindings for key in binding.keys}

    bound = _kept_of_user(lines, bindings)
    _take_out_of_loopback(lines, {name for version, name in managed})
    _place(lines, [binding for binding in bindings if binding not in bound], bound)
    for line in lines:
        if line.created and bindings:
            line.wanted = line.text

    left = [line for line in lines if line.wanted is not None]
    of_user = [line for line in left if line.user is not None]
    position = {line: number for number, line in enumerate(left, 1)}
    after = b"\n".join(line.wanted or b"" for line in left)
    created = any(line.created for line in lines)
    return Plan(
        content=None if created and not bindings and not after else after,
        entries=[_entry(binding, bound[binding], position) for binding in bindings],
        removed=[_removed(line) for line in lines if line.wanted is None and not line.created],
        replaced=[_replaced(line, position) for line in of_user if {line.text, line.wanted} != {line.user}],
        conflicts=[conflict for line in of_user for conflict in _conflicts(line, managed, bound, position)],
    )


def _kept_of_user(lines: typing.List[_Line], bindings: typing.List[Binding]) -> _Bound:
    """The bindings that a line of the user's already gives, with that line: nothing is to be added for them."""
    bound = {}
    for binding in bindings:
        for line in lines:
            host = line.host if line.user is not None else None
            if host and host.address == binding.address and set(binding.keys) <= set(host.keys):
                bound[binding] = line
                break
    return bound


def _take_out_of_loopback(lines: typing.List[_Line], names: typing.Set[str]) -> None:
    """Take managed names out of the user's loopback lines, of both families: libc answers ::1 as 127.0.0.1, too."""
    for line in lines:
        if line.user is None or not line.host or not line.host.address.is_loopback:
            continue
        address, given = line.user.split(b"#", 1)[0].split(None, 1)
        rest = [name for name in given.split() if name.decode("latin-1").lower() not in names]
        if len(rest) < len(given.split()):
            shown = address + b" " + b" ".join(rest) + b" " if rest else b""
            line.wanted = shown + _MARK + b" replaced: " + line.user


def _place(lines: typing.List[_Line], bindings: typing.List[Binding], bound: _Bound) -> None:
    """Give each binding a line of ours: where its name already has one, else behind ours, else behind IPv4 ones."""
    end = b"\r" if lines[0].text and lines[0].text.endswith(b"\r") else b""
    missing = {binding.keys[0]: binding for binding in bindings}
    ours, ipv4 = [], []
    for index, line in enumerate(lines):
        if line.user is not None:
            ipv4 += [index] if line.host and line.host.address.version == 4 else []
        elif line.host and line.host.keys[0] in missing:
            binding = missing.pop(line.host.keys[0])
            line.wanted = _text(binding, end)
            bound[binding] = line
            ours.append(index)
    # Before the last piece: that is what follows the last newline, or a line that has none and keeps none.
    last = len(lines) - 1
    at = min((ours or ipv4 or [last])[-1] + 1, last)
    for binding in bindings:
        if binding not in bound:
            bound[binding] = _Line(0, None)
            bound[binding].wanted = _text(binding, end)
            lines.insert(at, bound[binding])
            at += 1


def _text(binding: Binding, end: bytes) -> bytes:
    return "{}\t{} ".format(binding.address, " ".join(binding.names)).encode("ascii") + _MARK + end


def _entry(binding: Binding, line: _Line, position: _Position) -> _Item:
    return {
        "address": str(binding.address),
        "names": list(binding.names),
        "state": "added" if line.text is None else "unchanged" if line.text == line.wanted else "changed",
        "ours": line.user is None,
        "line": position[line],
    }


def _removed(line: _Line) -> _Item:
    return {"line": line.number, "text": readable(line.text)}


def _replaced(line: _Line, position: _Position) -> _Item:
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
    """The managed names to which a line of the user's gives another address of the same family."""
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
    """Bytes of the file, for a person."""
    return (text or b"").decode("utf-8", "replace")
