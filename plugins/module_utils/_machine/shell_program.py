# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A program that asks the shell of a person for variables. A process of that person runs only this source.

The shell has no terminal, no input, an output that is thrown away, and a few seconds. Background processes of its files end with it.
"""

import ctypes
import json
import os
import selectors
import shlex
import signal
import subprocess
import sys
import time

MOST = 1 << 20  # bytes of an environment
MOST_PLACES = 100  # of a variable
LONGEST = 500  # characters of a value or a line
MARK = "\x1f"
SUBREAPER = 36  # prctl(2): processes that lose their parent become ours
ASK = "exec /usr/bin/env -0 >&{0}"
# The prompts with which a shell reports each command: its file and line, then whether a subshell of bash, or an eval of zsh, runs it.
PROMPTS = {
    "bash": MARK.join(("+", "${BASH_SOURCE[0]}", "${LINENO}", "${BASH_SUBSHELL#0}", "")),
    "zsh": MARK.join(("+", "%x", "%I", "%N", "")),
}
# Files that put a terminal multiplexer in the place of the shell do so only outside of one. Inside is the shell that people type in.
INSIDE = {"TMUX": "/dev/null,0,0", "STY": "0.none", "ZELLIJ": "0"}
EVAL = "(eval)"  # whose lines zsh counts from the line of the command `eval` on
SETTERS = ("export", "declare", "typeset", "readonly")


def ask(shell, options, home, names, seconds):
    """Return the answer of a shell; see ask_once. A shell that ends without one is asked again, inside a terminal multiplexer."""
    deadline = time.monotonic() + seconds
    found = ask_once(shell, options, home, names, deadline, {})
    if found is None and time.monotonic() < deadline:
        found = ask_once(shell, options, home, names, deadline, INSIDE)
    return found


def ask_once(shell, options, home, names, deadline, more):
    """Return (values, places): the variables that the shell exports, and (file, line, text) of the line that has set each last; None without an answer."""
    (out, answer), (trace, traced) = os.pipe(), os.pipe()
    variables = dict(os.environ, HOME=home, SHELL=shell, TERM="dumb", HISTFILE="/dev/null", **more)
    kind, nothing = os.path.basename(shell), subprocess.DEVNULL
    if kind in PROMPTS:
        variables.update(PS4=PROMPTS[kind], BASH_XTRACEFD=str(traced))
    command = [shell] + (["-x"] if kind in PROMPTS else []) + options + ["-c", ASK.format(answer)]
    try:
        process = subprocess.Popen(
            command,
            env=variables,
            cwd=home if os.access(home, os.X_OK) else "/",  # as a login without a home folder
            stdin=nothing,
            stdout=nothing,
            stderr=traced if kind == "zsh" else nothing,
            pass_fds=(answer, traced),
            start_new_session=True,
        )
    except (OSError, ValueError):
        return None
    finally:
        os.close(answer)
        os.close(traced)
    places = VariablePlaces(names, home)
    output = read_both(out, trace, places, deadline)
    end_all(process)
    if not output.endswith(b"\0"):
        return None
    pairs = (entry.partition("=") for entry in output.decode("utf-8", "replace").split("\0"))
    values = {name: value[:LONGEST] for name, equals, value in pairs if equals and name in names}
    return values, places.choose(values)


def read_both(out, trace, places, deadline):
    """Read the answer of a shell until it ends, or is too long, and its trace, until the deadline."""
    output, rest, waited = b"", b"", selectors.DefaultSelector()
    for pipe in (out, trace):
        waited.register(pipe, selectors.EVENT_READ)
    while out in [key.fd for key in waited.get_map().values()] and len(output) < MOST:
        ready = waited.select(max(0.0, deadline - time.monotonic()))
        if not ready:
            break
        for key, _events in ready:
            data = os.read(key.fd, 65536)
            if not data:
                waited.unregister(key.fd)
            elif key.fd == out:
                output += data
            else:
                lines = (rest + data).split(b"\n")
                rest = lines.pop()[-4 * LONGEST :]
                places.look(lines)
    places.look([rest])
    for pipe in (out, trace):
        os.close(pipe)
    return output


class VariablePlaces:
    """The places where variables were set, as the trace of the shell shows them."""

    def __init__(self, names, home):
        self.found, self.names, self.home, self.place = {}, names, home, ("", 0)

    def look(self, lines):
        """Look at lines of the trace."""
        for line in lines:
            if b"ROS_" not in line or len(line) > 4 * LONGEST:
                continue
            fields = line.decode("utf-8", "replace").split(MARK, 4)
            if len(fields) < 5 or not fields[1] or not fields[2].isdigit() or fields[0].strip("+"):
                continue
            if fields[3] != EVAL:
                self.place = (os.path.join(self.home, fields[1])[:LONGEST], int(fields[2]))
            if fields[3].isdigit():  # what a subshell sets is gone with it
                continue
            words = fields[4].partition(" +" + MARK)[0]  # zsh reports a command behind the variables that it alone gets
            for name, value in list_assigned(words, self.names):
                places = self.found.setdefault(name, {})
                places.pop(value, None)  # so that the last one is the last
                places[value] = self.place + (words[:LONGEST],)
                if len(places) > MOST_PLACES:
                    del places[next(iter(places))]

    def choose(self, values):
        """Choose the place where each variable got the value that it has: it was there for one command only where it got another value last."""
        chosen = {}
        for name, value in values.items():
            fitting = [place for given, place in self.found.get(name, {}).items() if given in (None, value)]
            if fitting:
                chosen[name] = fitting[-1]
        return chosen


def list_assigned(words, names):
    """List the variables that a command of a trace sets: (name, value), with None for a value in a form of the shell's own."""
    try:
        parts = shlex.split(words)
    except ValueError:
        parts = words.split()
    sets, found = parts[:1] and parts[0] in SETTERS, []
    for part in parts:
        name, equals, value = part.lstrip("$").partition("=")
        if equals and name in names:
            found.append((name, None if "$'" in words else value[:LONGEST]))
        elif not equals and not sets:
            break
    return found


def end_all(process):
    """End the shell, its group, and whatever it has started that is ours now."""
    for _round in range(50):
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except OSError:
            pass
        children = list_children()
        for pid in children:
            try:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
            except OSError:
                pass
        if not children:
            return


def list_children():
    """List the processes whose parent is this one (proc(5))."""
    found = []
    for name in os.listdir("/proc"):
        try:
            with open("/proc/" + name + "/stat") as stream:
                words = stream.read(4096).rpartition(")")[2].split()
        except (OSError, UnicodeError):
            continue
        if name.isdigit() and len(words) > 1 and words[1] == str(os.getpid()):
            found.append(int(name))
    return found


def answer(shell, kinds, home, names, seconds):
    """Ask a shell in each of its kinds, each within so many seconds: {kind: answer, or None}. Never as root."""
    if 0 in (os.getuid(), os.geteuid()):
        return {}
    ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    return {kind: ask(shell, options, home, names, seconds) for kind, options in sorted(kinds.items())}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(answer(*json.load(sys.stdin))) + "\n")
