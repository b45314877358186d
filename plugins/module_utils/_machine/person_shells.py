# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The variables that the shells of persons really have: each shell is asked, and a parser only finds the file and the line.

A file may source others, call a function or build a value of several variables, so only the shell knows the result.
"""

import fnmatch
import json
import os
import re
import typing

from .._base.commands import BASE_PATH, read_source, run
from .._base.foreign import last_line
from .._base.plain_text import plain
from . import shell_program

MOST_PERSONS = 8  # that are asked; the files of all are read
MOST_LINES = 1 << 31  # of a file
_ASKING = 6.0  # seconds for a shell
_LIMIT = 15.0  # for both shells of a person
KINDS = {"interactive": ["-i"], "login": ["-l", "-i"]}  # a terminal of a desktop, and one by ssh

#: shell -> the files that it reads, by patterns of their last names
_OF_BASH = ("bash.bashrc", ".bashrc", "profile", ".profile", ".bash_profile", ".bash_login")
_OF_ZSH = ("zshenv", "zprofile", "zshrc", "zlogin", ".zshenv", ".zprofile", ".zshrc", ".zlogin")
_OF_SH = ("profile", ".profile")
FILES = {"bash": _OF_BASH, "zsh": _OF_ZSH, "sh": _OF_SH, "dash": _OF_SH, "ksh": _OF_SH, "fish": ("*.fish",)}

# The ends of the statements of a line, and the values of variables that are not of ROS: they may be passwords, and reports show lines.
_STATEMENT = re.compile(r";|&&?|\|\||(?:^|(?<=\s))[{}](?=\s|$)")
_OTHER_VALUE = re.compile(r"\b(?!ROS_|DEFAULT=|OVERRIDE=)(\w+)=(?:\"[^\"]*\"|'[^']*'|[^\s\"';&|])+")
_COMMENT = re.compile(r"\s#.*")
_COMPUTED = re.compile(r"[$`(]")  # a part of a value that the shell puts in

Row = typing.Dict[str, typing.Any]
Values = typing.Dict[str, str]


class Person(typing.NamedTuple):
    """A person with an account on this computer."""

    name: str
    uid: int
    gid: int
    home: str
    shell: str

    @property
    def kind(self) -> str:
        """The kind of the shell, a key of FILES, or another word."""
        return os.path.basename(self.shell)


class Seen(typing.NamedTuple):
    """The answer of a shell: the variables that it exports, and the place where each was set last, as far as it shows that."""

    values: Values
    places: typing.Dict[str, typing.Tuple[str, int, str]]  # file, line, the command there


Answers = typing.Dict[str, Seen]  # kind of a shell -> its answer


def can_ask(person: Person) -> bool:
    """Return True if the shell of a person may be asked: never root's, and only as that person."""
    own = os.geteuid()
    return person.kind in FILES and person.uid != 0 and own in (0, person.uid)


def ask(person: Person, names: typing.Sequence[str]) -> Answers:
    """Ask the shells of a person for the variables of these names; one that gives no answer is left out."""
    question = json.dumps([person.shell, KINDS, person.home, list(names), _ASKING]).encode()
    clean = {"PATH": BASE_PATH, "LANG": "C.UTF-8", "USER": person.name, "LOGNAME": person.name}
    program = ["/usr/bin/python3", "-I", "-c", read_source(shell_program)]
    answer = run(program, clean, _LIMIT, question, (person.uid, person.gid))
    try:  # the person could change the process, and its answer
        kinds = last_line(answer.output)
        return {kind: _read(kinds[kind], names) for kind in KINDS if kinds[kind] is not None}
    except (TypeError, ValueError, LookupError, AttributeError, RecursionError):
        return {}


def _is_number(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _read(answer: typing.Any, names: typing.Sequence[str]) -> Seen:
    """Read the answer of a shell. Raises TypeError, ValueError, LookupError or AttributeError for anything else."""
    values, places = answer
    # An answer of this computer with another number of a line could be refused as a whole.
    if not all(_is_number(line) and 0 <= line < MOST_LINES for _file, line, _words in places.values()):
        raise ValueError("no number of a line")
    return Seen(
        {name: str(values[name]) for name in names if name in values},
        {name: (plain(str(file)), line, str(words)) for name, (file, line, words) in sorted(places.items())},
    )


def _is_one(path: str, own: typing.Sequence[str]) -> bool:
    """Return True for a file of the shell whose files have these names."""
    return any(fnmatch.fnmatchcase(os.path.basename(path), name) for name in own)


def _list_untold(own: typing.Sequence[str], answers: Answers, parsed: typing.Sequence[Row]) -> typing.List[Row]:
    """List what was parsed and no shell tells: in files of other programs, and of a shell without an answer, as after `set -e` and an error."""
    told = {(*place[:2], name) for seen in answers.values() for name, place in seen.places.items()}
    silent = len(answers) < len(KINDS)
    return [
        row
        for row in parsed
        if not _is_one(row["file"], own) or (silent and (row["file"], row["line"], row["variable"]) not in told)
    ]


def list_rows(
    person: Person, answers: Answers, parsed: typing.Sequence[Row], planned: Values, ours: typing.Callable[[str], bool]
) -> typing.List[Row]:
    """List the lines that set variables in the shells of a person: those in the answers of shells, and for other programs those `parsed` in files.

    `planned`: the values of a shell without files of a person. `ours`: returns True for a file of the collection.
    """
    if not answers:
        return list(parsed)
    own = FILES[person.kind]
    rows = _list_untold(own, answers, parsed)
    for kind, seen in sorted(answers.items()):
        for name, value in sorted(seen.values.items()):
            place = seen.places.get(name) or _find_line(parsed, own, name, value)
            if (place and ours(place[0])) or (not place and value == planned.get(name)):
                continue
            file, line, text = place or ("", 0, "")
            row = {
                "file": file,
                "line": line,
                "variable": name,
                "value": _spell(value),
                "text": _spell(show_statement(text, name)),
            }
            row.update(person=plain(person.name), shell=kind)
            if all(dict(other, shell=kind) != row for other in rows):  # the other shell said the same
                rows.append(row)
    return rows


def show_statement(line: str, variable: str) -> str:
    """Return the statement of a line that sets a variable, without the values of variables that are not of ROS."""
    hidden = _OTHER_VALUE.sub(r"\1=...", line)  # first, since a value may have the end of a statement in it
    parts = list(filter(None, map(str.strip, _STATEMENT.split(_COMMENT.sub("", hidden)))))
    sets = [part for part in parts if re.search(r"(?<![$\w{])" + variable + r"\b", part)]
    chosen = sets[-1] if sets else variable
    cut = ["..." if parts and parts[0] != chosen else "", chosen, "..." if parts and parts[-1] != chosen else ""]
    return " ".join(filter(None, cut))


def _spell(text: str) -> str:
    """Spell a text for people. A carriage return at its end is the fault of a file of another system."""
    return plain(text.replace("\r", "\\r"))


def _find_line(
    parsed: typing.Sequence[Row], own: typing.Sequence[str], name: str, value: str
) -> typing.Optional[typing.Tuple[str, int, str]]:
    """Find the last line in files of the shell that gives a variable this value, or one that the shell alone knows."""
    lines = [
        row
        for row in parsed
        if row["variable"] == name
        and _is_one(row["file"], own)
        and (row["value"] == plain(value) or _COMPUTED.search(row["value"]))
    ]
    return (lines[-1]["file"], lines[-1]["line"], lines[-1]["text"]) if lines else None
