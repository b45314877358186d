# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The variables of shells on this machine: older assignments in files, SetEnv of sshd, and the effective values."""

import fnmatch
import glob
import json
import os
import re
import shlex
import shutil
import time
import typing

from .._base.commands import BASE_PATH, Answer, find_nobody, read_source, run, text
from .._base.deadlines import call_all
from .._base.foreign import last_line
from .._base.plain_text import plain
from . import home_files, person_shells, systemd
from .person_shells import Person

Rows = typing.List[typing.Dict[str, typing.Any]]

VARIABLES = ("ROS_MASTER_URI", "ROS_IP", "ROS_HOSTNAME")
_OURS = ("/etc/profile.d/rosfleet-multimaster.sh", "/etc/environment.d/90-rosfleet-multimaster.conf")
_OUR_HOOK = "1.rosfleet-multimaster.sh"  # of catkin, in whatever workspace
OUR_DROP_IN = "/etc/ssh/sshd_config.d/rosfleet-multimaster.conf"

# The files that shells and sessions read: of the system, and of each person.
_SYSTEM = (
    "/etc/bash.bashrc",
    "/etc/profile",
    "/etc/profile.d/*.sh",
    "/etc/environment",
    "/etc/environment.d/*.conf",
    "/etc/zsh/zshenv",
    "/etc/zsh/zprofile",
    "/etc/zsh/zshrc",
    "/etc/zsh/zlogin",
    "/etc/fish/conf.d/*.fish",
    "/etc/fish/config.fish",
)
_PERSONAL = (
    ".bashrc",
    ".bash_profile",
    ".bash_login",
    ".profile",
    ".zshenv",
    ".zprofile",
    ".zshrc",
    ".zlogin",
    ".xsessionrc",
    ".pam_environment",
    ".ssh/environment",
    ".config/fish/conf.d/*.fish",
    ".config/fish/config.fish",
    ".config/environment.d/*.conf",
)
_READING = 20.0  # seconds for the files of all persons
_MOST_SILENT = 20  # shells that are named
FILES = "files"  # of a person, all of them
_NO_LOGIN = ("nologin", "false", "sync", "")
_ANY_OF_THEM = "|".join(VARIABLES)
_SETENV = re.compile(rf"(?:.*[;&\s])?setenv\s+({_ANY_OF_THEM})\s+(\S+)")
_FISH = re.compile(
    rf"(?:.*[;&\s])?set\s+(?=(?:-\S+\s+)*(?:-[^\Wx]*x\w*|--export)\s)(?:-\S+\s+)+({_ANY_OF_THEM})\s+(\S+)"
)
_PAM = re.compile(rf"\s*({_ANY_OF_THEM})\s+(?:DEFAULT|OVERRIDE)=(\S+)")
_GENERATOR = "/systemd/user-environment-generators/30-systemd-environment-d-generator"
_OUR_GENERATOR = "/etc/systemd/user-environment-generators/90-rosfleet-multimaster"
_DEEPEST = 16  # sshd refuses files that include each other more deeply
_OF_THE_SHELL = ("PWD", "OLDPWD", "SHLVL", "_", "HOME", "TERM")


def exports(root: str = "/") -> typing.Dict[str, Rows]:
    """Find older assignments of VARIABLES in the files that shells read, and ask the shells of persons for the results.

    A person's files are read as that person, with a limit of time: so a link to a file of root's gives nothing away. Many
    persons are read at once, and a home folder on a dead network disk costs no other person's files. What gave no answer is
    listed too: its variables are unknown.
    """
    under = os.path.join(root, "")
    own, silent = _list_personal(under)
    said = {(row["file"], row["line"], row["variable"]) for row in own}
    rows = [row for row in _list_system(under) if (row["file"], row["line"], row["variable"]) not in said] + own
    return {"exports": [dict({"person": "", "shell": ""}, **row) for row in rows], "silent_shells": silent}


def _list_system(under: str) -> Rows:
    paths = (path for path in _expand(under, _SYSTEM) if path not in _OURS)
    return [dict(entry, file=path) for path in paths for entry in assignments(text(under + path[1:]))]


def _list_personal(under: str) -> typing.Tuple[Rows, Rows]:
    """List the lines that set variables in the files of persons, and in their shells, of which some are asked; and what gave no answer."""
    persons = list_persons(text(under + "etc/passwd"))
    asked = [one for one in persons if under == "/" and person_shells.can_ask(one)][: person_shells.MOST_PERSONS]
    planned = (_login() or {}) if asked else {}

    def look(person: Person) -> typing.Tuple[Rows, Rows]:
        return _look_at(person, under, person_shells.KINDS if person in asked else (), planned)

    found = call_all(look, persons, _READING, lambda person: ([], _name_silent(person, [FILES])))
    silent = [row for _rows, silent in found for row in silent]
    return [row for rows, _silent in found for row in rows], silent[:_MOST_SILENT]


def _look_at(
    person: Person, under: str, kinds: typing.Iterable[str], planned: typing.Dict[str, str]
) -> typing.Tuple[Rows, Rows]:
    """List the lines in the files of a person and in shells of these kinds, and what of both gave no answer."""
    files = _read_as((person.uid, person.gid), person.home, under)
    parsed = [dict(entry, file=path) for path, content in files or () for entry in assignments(content)]
    answers = person_shells.ask(person, VARIABLES) if kinds else {}
    silent = [kind for kind in kinds if kind not in answers] + ([FILES] if files is None else [])
    return person_shells.list_rows(person, answers, parsed, planned, _is_ours), _name_silent(person, silent)


def _name_silent(person: Person, what: typing.Iterable[str]) -> Rows:
    return [{"person": plain(person.name), "shell": one} for one in what]


def _is_ours(path: str) -> bool:
    return path in _OURS or os.path.basename(path) == _OUR_HOOK


def _expand(under: str, patterns: typing.Iterable[str]) -> typing.List[str]:
    return ["/" + path[len(under) :] for pattern in patterns for path in sorted(glob.glob(under + pattern[1:]))]


def list_persons(passwd: str) -> typing.List[Person]:
    """List root and the persons in the text of /etc/passwd, whose shells read files in their home folders; of one folder the first."""
    persons: typing.Dict[str, Person] = {}
    for line in passwd.splitlines():
        fields = line.split(":")
        if len(fields) != 7 or not (fields[2] + fields[3]).isdigit() or os.path.basename(fields[6]) in _NO_LOGIN:
            continue
        if (int(fields[2]) >= 1000 or fields[2] == "0") and os.path.isabs(fields[5]):
            one = Person(fields[0], int(fields[2]), int(fields[3]), fields[5], fields[6])
            persons.setdefault(one.home, one)
    return list(persons.values())


def _read_as(
    user: typing.Tuple[int, int], home: str, under: str
) -> typing.Optional[typing.List[typing.Tuple[str, str]]]:
    """Read the files of a home folder as its person: (path, text), with only the lines about VARIABLES. None without an answer."""
    patterns = [under + os.path.join(home, name)[1:] for name in _PERSONAL]
    question = json.dumps([patterns, VARIABLES]).encode()
    program = ["/usr/bin/python3", "-I", "-c", read_source(home_files)]
    answer = run(program, given=question, user=user)
    try:  # the person could change the process, and its answer
        return [
            ("/" + plain(path[len(under) :]), "\n".join(map(str, lines))) for path, lines in last_line(answer.output)
        ]
    except (TypeError, ValueError, LookupError, RecursionError):
        return None


def assignments(content: str) -> Rows:
    """Find the lines of a shell's file (sh, csh, fish, pam_env.conf(5)) that assign one of VARIABLES."""
    rows = []
    for number, line in enumerate(content.replace("\r\n", "\n").split("\n"), 1):
        if any(name in line for name in VARIABLES):
            for variable, value in _read_line(line):
                shown = plain(person_shells.show_statement(line, variable))
                rows.append({"line": number, "variable": variable, "value": plain(value), "text": shown})
    return rows


def _read_line(line: str) -> typing.List[typing.Tuple[str, str]]:
    words = _words(line)
    other = None if not words else _match_any(" ".join(words), _SETENV, _FISH, _PAM)
    if other:
        return [(other.group(1), other.group(2))]
    pairs = [word.partition("=") for word in words]
    return [(name, value) for name, equals, value in pairs if equals and name in VARIABLES]


def _match_any(words: str, *forms: "re.Pattern[str]") -> typing.Optional["re.Match[str]"]:
    return next(filter(None, (form.match(words) for form in forms)), None)


def _words(line: str) -> typing.List[str]:
    lexer = shlex.shlex(line, posix=True, punctuation_chars=";&|(){}")
    lexer.wordchars += ":$@%+,`!^[]\\"
    try:
        return list(lexer)
    except ValueError:  # a quotation that goes on in the next line
        return line.partition("#")[0].split()


def sshd(root: str = "/") -> typing.Dict[str, typing.Any]:
    """Read the settings of sshd: its SetEnv lines, and if it is installed, reads drop-ins, and has read our present file."""
    directives = list(_directives(os.path.join(root, "etc/ssh/sshd_config"), os.path.join(root, ""), False))
    path = re.search(r"^PATH=[\"']?([^\"'\n]+)", text(os.path.join(root, "etc/environment")), re.MULTILINE)
    service, since = _listener() if root == "/" else ("", 0.0)
    return {
        "installed": shutil.which("sshd", path=BASE_PATH if root == "/" else os.path.join(root, "usr/sbin"))
        is not None,
        "includes_drop_ins": any(
            keyword == "include"
            and not match
            and any(fnmatch.fnmatch(OUR_DROP_IN, pattern) for pattern in _patterns(rest))
            for file, line, keyword, rest, match in directives
        ),
        "other_setenv": [
            {"file": file, "line": line, "text": "SetEnv " + rest, "match": match}
            for file, line, keyword, rest, match in directives
            if keyword == "setenv" and file != OUR_DROP_IN
        ],
        "match_setenv": _match_setenv() if root == "/" else True,
        "path": path.group(1) if path else "",
        "service": service,
        "reload_due": bool(service) and since < _change_time(os.path.join(root, OUR_DROP_IN[1:])),
    }


def _directives(
    path: str, root: str, match: bool, depth: int = 0
) -> typing.Iterator[typing.Tuple[str, int, str, str, bool]]:
    """Yield (file, line, keyword, arguments, inside a Match) of sshd_config(5) and its includes, in the order of reading."""
    for number, line in enumerate(text(path).splitlines(), 1):
        words = re.match(r"\s*([A-Za-z]+)[\s=]+(.*?)\s*$", line)
        if not words:
            continue  # a comment, or empty
        keyword, rest = words.group(1).lower(), words.group(2)
        if keyword == "match":
            match = rest.split("#")[0].strip().lower() != "all"
        yield "/" + path[len(root) :], number, keyword, rest, match
        if keyword == "include" and depth < _DEEPEST:
            for pattern in _patterns(rest):
                for included in sorted(glob.glob(root + pattern[1:])):
                    yield from _directives(included, root, match, depth + 1)


def _patterns(rest: str) -> typing.List[str]:
    return [os.path.join("/etc/ssh", word.strip('"')) for word in rest.split()]


def _match_setenv() -> bool:
    """Ask sshd if it knows SetEnv below a Match: OpenSSH 8.4 reads it, but sets no variables."""
    answer = _ask_sshd("-f", "/dev/stdin", given=b"Match User nobody\nSetEnv ASKED=1\n")
    return answer is None or b"setenv ASKED=1" in answer.output


def _ask_sshd(*options: str, given: bytes = b"") -> typing.Optional[Answer]:
    """Let sshd print its settings for the user nobody; None if it does not."""
    daemon = shutil.which("sshd", path=BASE_PATH)
    command = [str(daemon), "-T", *options, "-C", "user=nobody,host=localhost,addr=127.0.0.1"]
    answer = run(command, given=given) if daemon else None
    return answer if answer and answer.status == 0 else None


def _listener() -> typing.Tuple[str, float]:
    """Return the active unit of sshd's daemon, or an empty text, and the time (s since 1970) of its last reading."""
    properties = ("Id", "ActiveState", "StateChangeTimestampMonotonic")
    for unit in systemd.show(("ssh.service", "sshd.service"), properties).units:
        if unit.get("ActiveState") == "active":
            # A reload is a change of state too (active, reloading, active).
            return unit.get("Id", ""), systemd.find_change(unit)
    return "", 0.0


def _change_time(path: str) -> float:
    """Return the time (s since 1970) of the last change of a file, or of its folder; 0 for a time in the future."""
    for place in (path, os.path.dirname(path)):
        try:
            changed = os.stat(place).st_mtime
        except OSError:
            continue
        return changed if changed <= time.time() else 0.0
    return 0.0


NOTHING_SEEN: typing.Dict[str, None] = {"login": None, "ssh": None, "desktop": None}


def probe() -> typing.Dict[str, typing.Optional[typing.Dict[str, str]]]:
    """Return the variables of a new login shell, a command by ssh and a terminal of a desktop.

    The programs themselves read their files, as the user nobody, which has no home folder. None means a program that
    does not exist, or fails.
    """
    return {"login": _login(), "ssh": _ssh(), "desktop": _desktop()}


def _login() -> typing.Optional[typing.Dict[str, str]]:
    clean = {"HOME": "/nonexistent", "PATH": BASE_PATH, "TERM": "dumb"}
    # The output of the files comes before the mark.
    answer = run(["bash", "-lc", "printf '\\0\\0'; exec /usr/bin/env -0"], clean, user=find_nobody())
    if answer.status == -1:
        return None
    entries = answer.text.partition("\0\0")[2].split("\0")
    pairs = [entry.partition("=") for entry in entries]
    return {name: value for name, equals, value in pairs if equals and name not in _OF_THE_SHELL}


def _ssh() -> typing.Optional[typing.Dict[str, str]]:
    answer = _ask_sshd()
    if answer is None:
        return None
    lines = [line[len("setenv ") :] for line in answer.text.splitlines() if line.startswith("setenv ")]
    return dict(line.partition("=")[::2] for line in lines)


def _desktop() -> typing.Optional[typing.Dict[str, str]]:
    for folder in ("/usr/lib", "/lib"):
        if os.path.exists(folder + _GENERATOR):
            variables = {"HOME": "/nonexistent", "PATH": BASE_PATH}
            environment: typing.Dict[str, str] = {}
            # Our generator comes later, and gets the variables of systemd's own.
            for program in [folder + _GENERATOR] + ([_OUR_GENERATOR] if os.path.exists(_OUR_GENERATOR) else []):
                answer = run([program], dict(variables, **environment), user=find_nobody())
                if answer.status != 0:
                    return None
                environment.update(read_generated(answer.text))
            return environment
    return None


def read_generated(output: str) -> typing.Dict[str, str]:
    """Read the variables in the output of an environment generator of systemd (systemd.environment-generator(7))."""
    variables = {}
    for line in output.splitlines():
        name, _equals, value = line.partition("=")
        if value[:1] == '"' and value[-1:] == '"':
            value = re.sub(r"\\(.)", r"\1", value[1:-1])
        variables[name] = value
    return variables
