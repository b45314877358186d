# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The dead-man's switch: the machine itself rolls back an unconfirmed change at run time.

Before the change, a timer of systemd is started. It runs a script of plain commands, so the former state comes back
whatever happens to the module, the connection or the controller. All its files are below /run, and files that are read
at boot are written only after the confirmation. So a power cycle brings the former state back, too.

The script and the confirmation exclude each other by renaming one file (rename(2)): the script renames `armed` to
`undoing`, the confirmation renames it to `confirmed`. Only one of them can.
"""

import contextlib
import json
import math
import os
import shlex
import time
import typing

from ..._base import commands, ends, processes
from ..._base.plain_text import LINE, quote
from ..._base.problem import Problem, explain_unreadable, sentence
from . import atomic
from .network import state as network_state
from .transaction import explain_state

FOLDER = "/run/rosfleet-multimaster"
OPTIONS = {
    "confirm_within": {"type": "int", "default": 0},
    "confirmation": {"type": "str", "default": ""},
}

_LIMIT = 60  # seconds for systemd, and for the script; both need a few hundredths
PACE = 5  # the confirmation may take this many times as long as the run that changed something: a busy machine is slow in both
LONGEST = 600  # seconds by which the pace of a machine lengthens the wait at most
# The states, each the name of a file; the last two are ends.
_MARKS = ("armed", "undoing", "rolled_back", "confirmed")

_SCRIPT = """\
# Written by rosfleet.multimaster: brings the state from before a change back that nobody has confirmed.
PATH={path}
cd {folder} || exit 1
while [ -e armed ] && [ -e until ] && read -r now rest </proc/uptime && [ "${{now%%.*}}" -lt "$(cat until)" ]; do sleep 1; done
mv armed undoing 2>/dev/null || exit 0
try() {{ "$@" >>log 2>&1 || echo "$*" >>failures; }}
put() {{ cp -p "$1" "$2.rosfleet-new-undo" && mv "$2.rosfleet-new-undo" "$2"; }}
{steps}mv undoing rolled_back
"""


class FileBefore(typing.NamedTuple):
    """A file as it was before a change: a step of the way back gives it this content again."""

    path: str
    content: typing.Optional[bytes]  # None for no file


UndoStep = typing.Union[typing.Sequence[str], FileBefore]  # a command, or a file


class RolledBack(Problem):
    """The confirmation did not come in time, so the former state is back."""


class FormerConnection(Problem):
    """The confirming run came over the connection from before the change, so the change still waits."""


def connection(proc: str = "/proc") -> str:
    """Return the connection that asked for this run as PID-START: the nearest ancestor that serves ssh.

    Sessions over one kept connection have the same text. A new TCP connection has a new one. The text is empty without
    ssh, as in a container. (The environment is no help: sudo(8) removes SSH_CONNECTION.)
    """
    found = processes.ancestors(proc)
    return next((f"{pid}-{start}" for pid, name, start in found if name in processes.SSH_SERVERS), "")


class Timer:
    """A timer of systemd that runs a command once and leaves nothing behind (systemd-run(1))."""

    def start(self, unit: str, seconds: int, argv: typing.Sequence[str]) -> None:
        """Run the command in so many seconds. Raises Problem if this machine cannot."""
        self.stop(unit)  # one of this name may be left
        command = [
            "systemd-run",
            "--quiet",
            "--no-ask-password",
            "--collect",
            f"--unit={unit}",
            "--description=Take back a change that nobody has confirmed",
            f"--on-active={seconds}s",
            "--timer-property=AccuracySec=50ms",
            "--",
            *argv,
        ]
        answer = commands.run(command, limit=_LIMIT)
        if answer.status != 0:
            raise Problem(
                f"confirm_within: found no way to start the timer {unit}.timer "
                f"({quote(answer.error, LINE) or f'status {answer.status}'}), expected systemd and the right to "
                "start units: run as root (become: true), or set confirm_within to 0 to go without the dead-man's switch."
            )

    def stop(self, unit: str) -> None:
        """End the timer; a timer that is not there is no error. A failed unit has gone by itself (--collect)."""
        commands.run(["systemctl", "stop", f"{unit}.timer"], limit=_LIMIT)


class Switch:
    """One dead-man's switch of this machine, by its name."""

    def __init__(self, name: str, folder: str = "", timer: typing.Optional[Timer] = None) -> None:
        self.unit = f"multimaster-rollback-{name}"
        self.base = folder or FOLDER
        self.folder = os.path.join(self.base, f"rollback-{name}")
        self.timer = timer or Timer()

    def arm(
        self,
        token: str,
        seconds: int,
        undo: typing.Iterable[UndoStep],
        memory: typing.Any = None,
        network: typing.Any = None,
    ) -> None:
        """Start the timer: `undo` happens in so many seconds, unless the switch is released.

        The steps of `undo` go in their order, each even if an earlier one fails. `memory` is data for JSON: all that
        the confirming run has to know of the state before; `network` the network state, to compare with after a rollback.
        Raises Problem if the switch cannot be armed; then no switch is left.
        """
        try:
            self.clear()
            atomic.make_folders(self.base)
            os.mkdir(self.folder, 0o700)
            steps = [self._prepare(number, step) for number, step in enumerate(undo)]
            text = _SCRIPT.format(
                path=commands.BASE_PATH,
                folder=shlex.quote(self.folder),
                steps="".join(" ".join(shlex.quote(word) for word in step) + "\n" for step in steps),
            )
            state = {
                "token": token,
                "seconds": seconds,
                "connection": connection(),
                "memory": memory,
                "network": network,
            }
            self._write("undo.sh", text.encode("utf-8", "surrogateescape"))
            self._write("state.json", json.dumps(state).encode("utf-8"))
            self._write("armed", b"")
            self.timer.start(self.unit, seconds, ["/bin/sh", self._path("undo.sh")])
        except (OSError, Problem) as problem:
            self.clear()
            if isinstance(problem, Problem):
                raise
            raise Problem(
                f"confirm_within: found {self.folder} not to be written ({problem.strerror}), expected a place for the "
                "way back: run as root (become: true), or set confirm_within to 0 to go without the dead-man's switch."
            ) from problem

    def look(self, token: str) -> str:
        """Return the state of the switch. Raises Problem if its script hangs.

        none         there is no switch
        armed        it has this token and waits
        rolled_back  it has this token, and the former state has come back
        other        it is armed with another token: an earlier run was broken off
        earlier      it has another token and has rolled back, and no run has reported that yet
        confirmed    a confirming run was broken off; state()["memory"] has its remaining work
        """
        mark = self._mark()
        deadline = time.monotonic() + _LIMIT
        while mark == "undoing":  # now, by the timer
            if time.monotonic() > deadline:
                raise Problem(f"The way back in {self.folder} has not ended within {_LIMIT} s: look at its log.")
            time.sleep(0.1)
            mark = self._mark()
        if token and self.state().get("token") == token:
            return mark
        return {"armed": "other", "rolled_back": "earlier"}.get(mark, mark)

    def state(self) -> typing.Dict[str, typing.Any]:
        """Read the data of arm(): token, seconds, connection, memory. Empty if there is no switch. Raises Problem."""
        if self._mark() == "none":  # or one of root, whose folder another user cannot read
            return {}
        with explain_unreadable(""):
            return json.loads((atomic.read_bytes(self._path("state.json")) or b"{}").decode("utf-8"))

    def failures(self) -> typing.List[str]:
        """Read the commands of the rollback that failed."""
        return commands.text(self._path("failures")).splitlines()

    def release(self) -> bool:
        """Keep the change: there will be no rollback. False if the script was faster, or there is no switch."""
        if not self._turn("armed", "confirmed"):
            return False
        self.timer.stop(self.unit)
        return True

    def extend(self, seconds: int) -> None:
        """Let the way back wait for so many seconds from now on. If that cannot be written, it comes at its earlier moment."""
        if self.waits():
            with contextlib.suppress(OSError, ValueError, LookupError, Problem):
                state = dict(self.state(), seconds=seconds)
                self._write("until", b"%d\n" % (float(commands.text("/proc/uptime").split()[0]) + seconds))
                self._write("state.json", json.dumps(state).encode("utf-8"))

    def waits(self) -> bool:
        """True while there is neither a confirmation nor a rollback."""
        return self._mark() == "armed"

    def rearm(self) -> None:
        """Let the way back run once more, after the end of one that has begun. Raises Problem if that one hangs."""
        self.look("")
        self._turn("rolled_back", "armed")

    def roll_back_now(self) -> None:
        """Roll back at once, also after a release. Raises Problem if the script did not run to its end."""
        self._turn("confirmed", "armed")
        atomic.remove(self._path("until"))
        commands.run(["/bin/sh", self._path("undo.sh")], limit=_LIMIT)
        self.look("")  # waits, if the timer was faster
        self.timer.stop(self.unit)
        if self._mark() not in ("rolled_back", "none"):
            raise Problem(f"The way back could not run: look at {self._path('undo.sh')}, and run it by hand.")

    def clear(self) -> None:
        """Remove the switch: timer, script and folder, and the remains of one that was removed in part. Raises OSError."""
        if os.path.isdir(self.folder):
            self._turn("armed", "confirmed")
            self.timer.stop(self.unit)  # also that of a rollback that a person started by hand
            for name in os.listdir(self.folder):
                atomic.remove(self._path(name))
            atomic.remove_folder_if_empty(self.folder)
        if os.path.isdir(self.base):
            atomic.remove_folder_if_empty(self.base)

    def _turn(self, mark: str, successor: str) -> bool:
        """Change the state from `mark` to `successor`; False if the state is not `mark`."""
        try:
            os.rename(self._path(mark), self._path(successor))
        except FileNotFoundError:
            return False
        return True

    def _mark(self) -> str:
        return next((mark for mark in _MARKS if os.path.exists(self._path(mark))), "none")

    def _path(self, name: str) -> str:
        return os.path.join(self.folder, name)

    def _write(self, name: str, content: bytes) -> None:
        atomic.write_by_rename(self._path(name), content, mode=0o600)

    def _prepare(self, number: int, step: UndoStep) -> typing.List[str]:
        """The line of the script for a step; stores the content of a file, with the permissions that it has now."""
        if not isinstance(step, FileBefore):
            return ["try", *step]
        path, content = step
        if content is None:
            return ["try", "rm", "-f", path]
        name = f"file-{number}"
        atomic.write_by_rename(self._path(name), content, *atomic.permissions(path))
        return ["try", "put", name, path]


class DeadmanGuard:
    """A module's side of the switch. The first run changes the run time, and the second run confirms it.

    The first run has confirm_within and a token as confirmation, the second the token only. The module's own run has
    two methods besides those of module.ModuleRun:

    undo_steps()      for Switch.arm
    apply_runtime()   changes only the run time

    Its apply() changes all that is not yet as planned: the run time, then the boot part. Both undo their changes when
    they fail.
    """

    def __init__(self, module: typing.Any, what: str, switch: Switch) -> None:
        """Read the module's options; `what` names the concern in a sentence, in the plural: kernel settings, routes."""
        self.module, self.what, self.switch = module, what, switch
        self.seconds = module.params["confirm_within"]
        self.token = module.params["confirmation"]
        self.state = "none"
        self.unconfirmed = self.rolled_back = self.changed = False
        self.lost: typing.List[str] = []  # the sentences on the network state after a rollback

    def begin(self) -> typing.Any:
        """Finish or roll back an earlier run; returns the memory of the run that is to be confirmed, or None.

        Raises Problem; FormerConnection if the connection is still the one from before the change.
        """
        if self.seconds < 0 or (self.seconds and not self.token):
            raise Problem(
                f"confirm_within is {self.seconds} and confirmation {self.token!r}, expected 0 s, or more and a word that "
                "the second run repeats."
            )
        self.state = self.switch.look(self.token)
        state = self.switch.state()
        if self.state == "rolled_back":
            self._report_rollback(state)
        if self.state in ("other", "earlier"):
            self._clear_leftover(state)
            self.state = "none"
            return None
        if self.state == "armed" and state["connection"] and state["connection"] == connection():
            raise FormerConnection(f"The {self.what} are not confirmed: this is the connection from before the change.")
        self.changed = self.state in ("armed", "confirmed")
        return state.get("memory") if self.changed else None

    def apply(self, run: typing.Any) -> None:
        """Apply the plan as far as this run may. Raises Problem, which lists all that is not as it was before the first run."""
        if self.state == "armed":
            if not self.switch.release():
                self.switch.look(self.token)
                self._report_rollback(self.switch.state())
        elif run.runtime_changes and self.seconds:
            return self._try_out(run)
        elif run.runtime_changes and self.token and self.state == "none":
            raise Problem(
                f"The change of the {self.what} can no longer be confirmed: the machine has been restarted meanwhile, a run "
                "of another play has taken it back, or the first run never got as far. It is not in force: run the play again."
            )
        run.apply()
        with contextlib.suppress(OSError):  # the change is complete: the next run removes the remains of the switch
            self.switch.clear()
        return None

    def _try_out(self, run: typing.Any) -> None:
        watch = getattr(run, "watch", None)
        network = watch.begin().to_json() if watch else None
        self.switch.arm(self.token, self.seconds, run.undo_steps(), run.memory, network)
        try:
            run.apply_runtime()
            late = not self.switch.waits()
        except Problem:
            self._undo_again()  # as the run has done already; its sentence has the failures
            raise
        if late:
            self._undo_again()
            self.rolled_back = True
            raise RolledBack(
                f"The change of the {self.what} took longer than the {self.seconds} s of confirm_within, so the machine has "
                f"taken it back{_describe_state(self.lost)}: give confirm_within more time."
            )
        self.unconfirmed = True

    @property
    def waits_for(self) -> int:
        """Seconds for which the machine waits for the confirmation of this run, 0 if nothing is to be confirmed."""
        return self.seconds if self.unconfirmed else 0

    def wait_at_this_pace(self, took: float) -> None:
        """At the end of a run that took so many seconds: the time to confirm begins now, and knows the pace of the machine."""
        if self.unconfirmed:
            self.seconds = max(self.seconds, min(math.ceil(PACE * took), LONGEST))
            self.switch.extend(self.seconds)

    def _undo_again(self) -> None:
        self.switch.rearm()  # its timer may have rung while the change went on, and missed the rest of it
        self._roll_back()

    def _roll_back(self) -> typing.List[str]:
        """Roll back at once and remove the switch; returns the failures. `lost` has the sentences on the network state then."""
        try:
            before = self.switch.state().get("network")
            self.switch.roll_back_now()
            failures = self.switch.failures()
            self.switch.clear()
        except (OSError, Problem) as problem:
            return [sentence(problem)]
        self._look(before)
        return failures

    def _look(self, before: typing.Any) -> None:
        """Compare the network state with that of before, and put back the items that are gone."""
        if before and not self.module.check_mode:
            self.lost = network_state.put_back(network_state.from_json(before), lambda item: False)[1]

    def _report_rollback(self, state: typing.Mapping[str, typing.Any]) -> typing.NoReturn:
        failures = self.switch.failures()
        self.rolled_back, self.changed = True, False
        if not self.module.check_mode:
            self.switch.clear()
        self._look(state.get("network"))
        end = (
            f", but these commands of it failed: {', '.join(failures)}: correct them by hand."
            if failures
            else f"{_describe_state(self.lost)}: correct the plan of this host, or reach it by a way that does not "
            "depend on it."
        )
        raise RolledBack(
            f"The {self.what} were not confirmed over a new connection within {int(state.get('seconds', 0))} s, so the machine "
            f"has taken them back{end}"
        )

    def _clear_leftover(self, state: typing.Mapping[str, typing.Any]) -> None:
        """Roll back an earlier play that was broken off, and warn."""
        waits = self.state == "other"
        if not self.module.check_mode:
            if waits:
                self.switch.roll_back_now()
            failures = self.switch.failures()
            self.switch.clear()
            if failures:
                raise Problem(
                    f"The {self.what} of an earlier run, not confirmed, could not be taken back; these commands "
                    f"failed: {', '.join(failures)}: correct them by hand."
                )
            self._look(state.get("network"))
            for text in self.lost:
                ends.warn(self.module, text)
        self.changed = waits
        were = "would be" if waits and self.module.check_mode else "were"
        ends.warn(
            self.module,
            f"The {self.what} of an earlier run, not confirmed within {int(state.get('seconds', 0))} s, {were} taken "
            f"back{' first' if waits else ''}.",
        )

    def failure(self, problem: Problem, **result: typing.Any) -> typing.Dict[str, typing.Any]:
        """Return the result of a module that ends with a sentence; a change that was to be confirmed is rolled back."""
        text = str(problem)
        if isinstance(problem, FormerConnection):
            return {"changed": False, "unconfirmed": True, "same_connection": True, "msg": text}
        if not self.module.check_mode and self.state == "armed" and not self.rolled_back:
            text += f" {self._take_back()}"
        return dict(result, failed=True, msg=text, unconfirmed=False, rolled_back=self.rolled_back)

    def give_up(self) -> str:
        """Take back a change that waits for a confirmation with this token, or was taken back; returns a sentence if there is any."""
        if not self.token or self.module.check_mode or self.switch.look(self.token) not in ("armed", "rolled_back"):
            return ""
        return self._take_back(", too")

    def _take_back(self, too: str = "") -> str:
        """Roll back, and say so."""
        failures = self._roll_back()
        self.rolled_back = not failures
        if failures:
            return " ".join([f"Taking the {self.what} back failed, too: {', '.join(failures)}", *self.lost])
        if too and not self.lost:
            return f"So the {self.what} were taken back{too}."
        return f"So the {self.what} were taken back{too}{_describe_state(self.lost, ', and the machine is as it was before')}."

    def success(self, changed: bool, **result: typing.Any) -> typing.Dict[str, typing.Any]:
        """Return the result of a module."""
        return dict(
            result, changed=changed or self.changed, unconfirmed=self.unconfirmed, confirm_within=self.waits_for
        )


def _describe_state(lost: typing.Sequence[str], good: str = " and is as it was before") -> str:
    """The end of a clause on a rollback: that all is well, or the exceptions."""
    return f" ({explain_state(lost, '')})" if lost else good
