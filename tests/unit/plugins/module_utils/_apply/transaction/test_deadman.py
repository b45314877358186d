# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dead-man's switch on the machine: scripts, files and processes are real; a shell stands for systemd's timer, which
tests/systems/test_cut_off.py has.
"""

import itertools
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import threading
import time
import types

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import deadman
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.deadman import FileBefore
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.processes import SSH_SERVERS
from killed import die_at_call
from mentioned import mentions

HOUR = 3600


class ShellTimer:
    """A timer made of a shell that sleeps. It rings before its time where the test says so."""

    def __init__(self):
        self.running, self.commands = {}, {}

    def ring(self, unit):
        """Run the command now. A timer that was stopped does not ring."""
        assert self.running[unit].poll() is None
        self.start(unit, 0, self.commands[unit])

    def start(self, unit, seconds, argv):
        self.stop(unit)
        self.commands[unit] = argv
        words = ["sh", "-c", 'sleep "$0"; exec "$@"', str(seconds), *argv]
        self.running[unit] = subprocess.Popen(words, start_new_session=True)

    def stop(self, unit):
        if unit in self.running:
            process = self.running.pop(unit)
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture
def timer():
    timer = ShellTimer()
    yield timer
    for unit in list(timer.running):
        timer.stop(unit)


@pytest.fixture
def switch(tmp_path, timer):
    return deadman.Switch("test", str(tmp_path / "run"), timer)


def becomes(path, text, within=10.0):
    """Wait for a file to have a text."""
    deadline = time.monotonic() + within
    while not (path.exists() and path.read_text() == text):
        assert time.monotonic() < deadline, f"{path} never became {text!r}"
        time.sleep(0.02)


def writes(path, text):
    return ["sh", "-c", 'printf "%s" "$2" >>"$1"', "sh", str(path), text]


# The switch


def test_what_nobody_confirms_is_taken_back_in_order(switch, timer, tmp_path):
    place = tmp_path / "a place's name"
    switch.arm(
        "t", HOUR, [writes(place, "a "), ["false"], ["no-such-command", "x"], writes(place, "'b\"")], memory={"k": 1}
    )
    assert switch.look("t") == "armed"
    assert switch.look("u") == switch.look("") == "other"
    assert (switch.state()["token"], switch.state()["memory"]) == ("t", {"k": 1})
    timer.ring(switch.unit)
    becomes(place, "a 'b\"")
    assert [switch.look("t"), switch.look("u")] == ["rolled_back", "earlier"]
    assert switch.failures() == ["false", "no-such-command x"]
    assert not switch.release()
    switch.clear()
    assert switch.look("t") == "none"
    assert not (tmp_path / "run").exists()


def test_a_look_waits_for_the_way_back_while_the_clock_steps(switch, timer, tmp_path, monkeypatch):
    switch.arm("t", HOUR, [["sleep", "1"]])
    timer.ring(switch.unit)
    becomes(tmp_path / "run" / "rollback-test" / "undoing", "")
    hours = itertools.count(time.time(), HOUR)
    monkeypatch.setattr(time, "time", lambda: next(hours))
    assert switch.look("t") == "rolled_back"


def test_files_come_back_with_their_permissions(switch, tmp_path):
    kept, new = tmp_path / "kept file", tmp_path / "new"
    kept.write_text("old")
    kept.chmod(0o640)
    switch.arm("t", HOUR, [FileBefore(str(kept), kept.read_bytes()), FileBefore(str(new), None)])
    kept.unlink()
    kept.write_text("other")
    new.write_text("x")
    switch.roll_back_now()
    assert (kept.read_text(), kept.stat().st_mode & 0o777) == ("old", 0o640)
    assert not new.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept file", "run"]
    assert (switch.look("t"), switch.failures()) == ("rolled_back", [])


def test_what_is_released_stays(switch, timer, tmp_path):
    place = tmp_path / "place"
    switch.arm("t", HOUR, [writes(place, "x")])
    assert switch.release()
    assert switch.look("t") == "confirmed"
    assert not timer.running
    subprocess.run(timer.commands[switch.unit], check=True)  # as a timer does that rings in the same moment
    assert not place.exists()
    switch.roll_back_now()  # the boot part failed
    assert (place.read_text(), switch.look("t")) == ("x", "rolled_back")
    switch.roll_back_now()  # nothing twice
    assert place.read_text() == "x"


@pytest.mark.slow
def test_a_slow_machine_has_more_time_to_confirm(switch, timer, tmp_path):
    place = tmp_path / "place"
    switch.arm("t", HOUR, [writes(place, "x")])
    switch.extend(3)
    assert switch.state()["seconds"] == 3
    began = time.monotonic()
    timer.ring(switch.unit)  # at its first moment
    time.sleep(1)
    assert switch.look("t") == "armed"
    becomes(place, "x")
    assert time.monotonic() - began > 1.5


@pytest.mark.parametrize("end", ["release", "roll_back_now", "unreadable"])
def test_a_wait_that_was_extended_ends_at_once(switch, timer, tmp_path, end):
    place = tmp_path / "place"
    switch.arm("t", HOUR, [writes(place, "x")])
    switch.extend(HOUR)
    script = subprocess.Popen(timer.commands[switch.unit])
    if end == "unreadable":
        pathlib.Path(switch.folder, "until").write_text("never")
    else:
        getattr(switch, end)()
    assert script.wait(timeout=20) == 0
    assert place.exists() is (end != "release")


def test_a_state_that_cannot_be_read_is_said_while_there_is_one(switch):
    switch.arm("t", HOUR, [])
    state = pathlib.Path(switch.folder) / "state.json"
    state.unlink()
    state.mkdir()
    with pytest.raises(Problem, match=r"state.json cannot be read \(Is a directory\)"):
        switch.look("t")
    (pathlib.Path(switch.folder) / "armed").unlink()
    assert (switch.look("t"), switch.state()) == ("none", {})
    state.rmdir()
    switch.clear()


@pytest.mark.slow
def test_the_confirmation_or_the_timer_never_both(switch, tmp_path):
    """Both at the same moment, many times."""
    place, released = tmp_path / "place", 0
    for number in range(40):
        switch.arm("t", HOUR, [writes(place, "x")])
        script = subprocess.Popen(["sh", os.path.join(switch.folder, "undo.sh")])
        time.sleep(0.0001 * number)
        kept = switch.release()
        script.wait()
        assert place.exists() != kept
        assert switch.look("t") == ("confirmed" if kept else "rolled_back")
        released += kept
        place.unlink(missing_ok=True)
        switch.clear()
    assert released, "the confirmation never came in time: the test shows nothing"


def test_looking_waits_for_a_way_back_that_runs(switch, tmp_path):
    place = tmp_path / "place"
    switch.arm("t", HOUR, [["sleep", "0.5"], writes(place, "x")])
    thread = threading.Thread(target=switch.roll_back_now)
    thread.start()
    while os.path.exists(os.path.join(switch.folder, "armed")):
        time.sleep(0.01)
    assert (switch.look("t"), place.read_text()) == ("rolled_back", "x")
    thread.join()


def test_a_switch_that_cannot_be_armed_leaves_nothing(tmp_path):
    class NoTimer(ShellTimer):
        def start(self, unit, seconds, argv):
            raise Problem("no timer")

    switch = deadman.Switch("test", str(tmp_path / "run"), NoTimer())
    with pytest.raises(Problem, match="no timer"):
        switch.arm("t", 5, [])
    assert not (tmp_path / "run").exists()
    (tmp_path / "run").write_text("a file")
    with pytest.raises(Problem, match="confirm_within: found .*rollback-test not to be written"):
        switch.arm("t", 5, [])


@pytest.mark.skipif(os.path.isdir("/run/systemd/system"), reason="systemd runs here")
def test_without_systemd_the_sentence_says_what_to_do(tmp_path):
    with pytest.raises(Problem, match="multimaster-rollback-test.timer .*set confirm_within to 0"):
        deadman.Switch("test", str(tmp_path / "run")).arm("t", 5, [])
    assert not (tmp_path / "run").exists()


def test_an_armed_switch_is_replaced_whole(switch, timer, tmp_path):
    place = tmp_path / "place"
    switch.arm("t", HOUR, [writes(place, "first")])
    first = timer.running[switch.unit]
    switch.arm("u", HOUR, [writes(place, "second")])
    assert first.poll() is not None, "its timer rings no more"
    assert not place.exists()
    assert (switch.look("t"), switch.look("u")) == ("other", "armed")
    timer.ring(switch.unit)
    becomes(place, "second")


@pytest.mark.slow
def test_killed_while_arming_at_any_moment(tmp_path, timer):
    """SIGKILL before every system call that changes something: the next run always gets on, and nothing is half there."""
    place = tmp_path / "place"
    place.write_text("before")
    for step in range(100):
        switch = deadman.Switch("test", str(tmp_path / "run"), timer)
        child = os.fork()
        if child == 0:
            die_at_call(step, "mkdir", "chmod", "open", "write", "fchmod", "fsync", "rename", "rmdir")
            switch.timer = types.SimpleNamespace(start=lambda *words: None, stop=lambda unit: None)
            switch.arm("t", HOUR, [FileBefore(str(place), b"before")])
            os._exit(0)
        killed = os.WIFSIGNALED(os.waitpid(child, 0)[1])
        assert switch.look("u") in ("none", "other")
        if switch.look("u") == "other":
            switch.roll_back_now()
        switch.clear()
        assert place.read_text() == "before"
        switch.arm("u", HOUR, [])
        assert switch.look("u") == "armed"
        switch.clear()
        assert not (tmp_path / "run").exists()
        if not killed:
            break
    assert step > 15 and not killed


# The connection


@pytest.fixture
def asking(tmp_path):
    """A program that prints its connection, and a shell under a name of a server's."""
    shell = shutil.which("dash") or shutil.which("bash")
    for name in (*SSH_SERVERS, "other"):
        shutil.copy(shell, tmp_path / name)
    ask = tmp_path / "ask"
    paths = os.pathsep.join(path for path in sys.path if path)
    program = "from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.deadman import connection as c; print(c())"
    # Without an environment, as sudo leaves none of ssh's.
    ask.write_text(f"env -i PYTHONPATH='{paths}' {sys.executable} -c '{program}'; :\n")

    def lines(*names, script="sh ask; sh ask"):
        """The text that is printed below servers of these names, the outermost first."""
        for name in reversed(names):
            script = f"./{name} -c '{script}; :'"
        done = subprocess.run(["sh", "-c", script], cwd=tmp_path, check=True, stdout=subprocess.PIPE, text=True)
        return done.stdout.splitlines()

    return lines


@pytest.mark.slow
@pytest.mark.parametrize("server", SSH_SERVERS)
def test_two_runs_over_one_connection_and_over_two(asking, server):
    first, second = asking(server), asking(server)
    assert len(set(first)) == len(set(second)) == 1
    assert first[0] and second[0] and first != second


def test_one_listening_server_has_many_connections(asking):
    """Before 9.8 the listening process has the same name as those of the sessions."""
    one, two = asking("sshd", script='./sshd -c "sh ask; :"; ./sshd -c "sh ask; :"')
    assert one and two and one != two


def test_no_server_no_connection(asking):
    outside = deadman.connection()  # whoever runs the tests may have come by ssh
    assert asking("other") == [outside, outside]


def test_names_with_blanks_and_brackets(tmp_path):
    pid = os.getppid()
    for number, text in (
        (pid, f"{pid} (a) (b S 7) S 7 " + "1 " * 17 + "99 0"),
        (7, "7 (sshd) S 1 " + "1 " * 17 + "1234 0"),
    ):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "stat").write_text(text)
    assert deadman.connection(str(tmp_path)) == "7-1234"


# The module's side


class Module:
    """The part of a module that a Guard needs."""

    def __init__(self, confirm_within=0, confirmation="", check_mode=False):
        self.params = {"confirm_within": confirm_within, "confirmation": confirmation}
        self.check_mode, self.warnings = check_mode, []

    def warn(self, sentence):
        self.warnings.append(sentence)


class FilesRun:
    """A run whose kernel and boot part are two files."""

    def __init__(self, folder, wanted, memory=None, breaks=""):
        self.runtime, self.boot, self.wanted = folder / "runtime", folder / "boot", wanted
        self.now = self.runtime.read_text()
        earlier = self.boot.read_text().partition(" after ")[2]
        self.before = memory or earlier or self.now
        self.memory, self.breaks = self.before, breaks

    @property
    def runtime_changes(self):
        return self.now != self.wanted

    @property
    def changed(self):
        return self.runtime_changes or self.boot.read_text() != f"{self.wanted} after {self.before}"

    def undo_steps(self):
        return [["sh", "-c", 'printf "%s" "$2" >"$1"', "sh", str(self.runtime), self.now]]

    def apply_runtime(self):
        if self.breaks == "runtime":
            raise Problem("The kernel refuses.")
        if self.breaks.startswith("slow"):
            becomes(self.runtime.parent / "run/rollback-test/rolled_back", "")
        self.runtime.write_text(self.wanted)
        if self.breaks == "slow and refused":
            raise Problem("The kernel refuses the rest.")

    def apply(self):
        self.apply_runtime()
        if self.breaks == "boot":
            raise Problem("The disk is full.")
        self.boot.write_text(f"{self.wanted} after {self.before}")


@pytest.fixture
def play(tmp_path, switch, monkeypatch):
    """Run a module; over another connection every time, unless said otherwise."""
    (tmp_path / "runtime").write_text("old")
    (tmp_path / "boot").write_text("old")
    connections = iter(range(1000))

    def play(wanted="new", connection=None, breaks="", check=False, refused=None, **options):
        name = connection if connection is not None else f"c{next(connections)}"
        monkeypatch.setattr(deadman, "connection", lambda: name)
        module = Module(check_mode=check, **options)
        guard = deadman.DeadmanGuard(module, "test values", switch)
        try:
            run = FilesRun(tmp_path, wanted, guard.begin(), breaks)
            changed = run.changed
            if refused:
                raise Problem(refused)
            if not check:
                guard.apply(run)
            result = guard.success(changed=changed)
        except Problem as problem:
            result = guard.failure(problem)
        return types.SimpleNamespace(**{"failed": False, **result}, warnings=module.warnings)

    play.state = lambda: ((tmp_path / "runtime").read_text(), (tmp_path / "boot").read_text())
    play.clean = lambda: not (tmp_path / "run").exists()
    return play


def test_two_runs_first_the_run_time_then_the_boot_part(play):
    first = play(confirm_within=HOUR, confirmation="t")
    assert (first.changed, first.unconfirmed, play.state()) == (True, True, ("new", "old"))
    second = play(confirmation="t")
    assert (second.changed, second.unconfirmed, play.state()) == (True, False, ("new", "new after old"))
    assert play.clean()
    third = play(confirm_within=HOUR, confirmation="u")
    assert third.unconfirmed is False and play.clean()


def test_a_kept_connection_confirms_nothing(play):
    play(confirm_within=HOUR, confirmation="t", connection="same")
    second = play(confirmation="t", connection="same")
    assert (second.failed, second.unconfirmed, second.same_connection, second.changed) == (False, True, True, False)
    assert play.state() == ("new", "old")
    assert not play(confirmation="t", connection="other").unconfirmed


def test_where_there_is_no_connection_the_second_run_confirms(play):
    play(confirm_within=HOUR, confirmation="t", connection="")
    assert not play(confirmation="t", connection="").unconfirmed
    assert play.state() == ("new", "new after old")


def test_unconfirmed_in_time(play, switch, timer, tmp_path):
    play(confirm_within=HOUR, confirmation="t")
    timer.ring(switch.unit)
    becomes(tmp_path / "runtime", "old")
    late = play(confirmation="t")
    assert mentions(late.msg, "3600", "depend")
    assert (late.failed, late.rolled_back, play.state(), play.clean()) == (True, True, ("old", "old"), True)


def test_the_timer_between_looking_and_releasing(play, switch, tmp_path, monkeypatch):
    play(confirm_within=HOUR, confirmation="t")
    real = switch.release
    monkeypatch.setattr(switch, "release", lambda: switch.roll_back_now() or real())
    late = play(confirmation="t")
    assert (late.failed, late.rolled_back, play.state(), play.clean()) == (True, True, ("old", "old"), True)


def test_what_could_not_be_taken_back_is_named(play, switch, tmp_path):
    switch.arm("t", HOUR, [["false"]])
    switch.roll_back_now()
    assert mentions(play(confirmation="t").msg, "failed: false")
    switch.arm("t", HOUR, [["false"]])
    result = play(confirm_within=HOUR, confirmation="u")
    assert result.failed and "these commands failed: false" in result.msg and play.state() == ("old", "old")


def test_a_run_that_was_broken_off_is_taken_back_first(play):
    play(confirm_within=HOUR, confirmation="t")
    checked = play(confirm_within=HOUR, confirmation="u", check=True)
    assert "would be taken back first" in checked.warnings[0]
    assert play.state() == ("new", "old")
    result = play(wanted="newer", confirm_within=HOUR, confirmation="u")
    assert result.warnings == ["The test values of an earlier run, not confirmed within 3600 s, were taken back first."]
    assert not play(wanted="newer", confirmation="u").unconfirmed
    assert play.state() == ("newer", "newer after old")  # the state before is the one before the broken-off run


def test_a_run_that_was_taken_back_and_never_heard_of(play, switch):
    play(confirm_within=HOUR, confirmation="t")
    switch.roll_back_now()
    result = play(wanted="old", confirm_within=HOUR, confirmation="u")
    assert len(result.warnings) == 1 and mentions(result.warnings, "3600 s", "taken back")
    assert play.clean()


@pytest.mark.parametrize("options", [{"confirm_within": 0}, {"confirm_within": HOUR, "confirmation": "u"}])
def test_killed_after_the_confirmation(play, switch, options):
    """The boot part is missing; the next run has it, with the state from before the change."""
    play(confirm_within=HOUR, confirmation="t")
    assert switch.release()
    result = play(**options)
    assert (result.changed, result.unconfirmed, play.state(), play.clean()) == (
        True,
        False,
        ("new", "new after old"),
        True,
    )


def test_a_boot_part_that_fails_takes_the_run_time_back(play):
    play(confirm_within=HOUR, confirmation="t")
    result = play(confirmation="t", breaks="boot")
    assert mentions(result.msg, "disk", "taken back")
    assert (result.rolled_back, play.state(), play.clean()) == (True, ("old", "old"), True)


def test_what_stands_against_it_meanwhile_takes_it_back(play):
    play(confirm_within=HOUR, confirmation="t")
    result = play(confirmation="t", refused="A conflict.")
    assert result.failed and result.msg.startswith("A conflict. So the test values were taken back")
    assert (play.state(), play.clean()) == (("old", "old"), True)


def test_a_run_time_that_is_refused_leaves_no_switch(play):
    result = play(confirm_within=HOUR, confirmation="t", breaks="runtime")
    assert (result.failed, result.rolled_back, play.state(), play.clean()) == (True, False, ("old", "old"), True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("breaks", "said"),
    [("slow", "took longer than the 1 s of confirm_within"), ("slow and refused", "The kernel refuses the rest.")],
)
def test_a_change_beside_its_way_back_is_taken_back_whole(play, breaks, said):
    failed = play(confirm_within=1, confirmation="t", breaks=breaks)
    assert said in failed.msg
    assert (failed.failed, failed.unconfirmed, failed.rolled_back) == (True, False, breaks == "slow")
    assert (play.state(), play.clean()) == (("old", "old"), True)


def test_a_restart_before_the_confirmation(play, switch, tmp_path):
    play(confirm_within=HOUR, confirmation="t")
    switch.clear()
    (tmp_path / "runtime").write_text("old")
    result = play(confirmation="t")
    assert mentions(result.msg, "restarted")
    assert play.state() == ("old", "old")


def test_a_confirmation_of_one_play_does_not_confirm_another(play):
    play(confirm_within=HOUR, confirmation="t")
    result = play(confirmation="u")
    assert result.failed and "can no longer be confirmed" in result.msg
    assert (play.state(), play.clean()) == (("old", "old"), True)


def test_killed_while_arming_is_forgotten(play, switch):
    """Without its mark the rest of a switch counts for nothing."""
    switch.arm("t", HOUR, [], memory="never applied")
    os.unlink(os.path.join(switch.folder, "armed"))
    assert play(confirm_within=HOUR, confirmation="u").unconfirmed
    assert not play(confirmation="u").failed
    assert play.state() == ("new", "new after old")


def test_a_confirmation_whose_answer_was_lost_is_given_again(play):
    play(confirm_within=HOUR, confirmation="t")
    play(confirmation="t")
    result = play(confirmation="t")
    assert (result.failed, result.changed, play.state()) == (False, False, ("new", "new after old"))


def test_check_mode_and_no_switch(play):
    assert play(check=True).changed and play.state() == ("old", "old")
    assert play().changed and play.state() == ("new", "new after old")
    assert play.clean()


@pytest.mark.parametrize("options", [{"confirm_within": -1}, {"confirm_within": 5}])
def test_options_that_cannot_be_meant(play, options):
    result = play(**options)
    assert result.failed and result.msg.startswith(
        "confirm_within is %d and confirmation ''" % options["confirm_within"]
    )
    assert play.state() == ("old", "old")


def test_the_state_is_for_root_only(switch, tmp_path):
    switch.arm("t", HOUR, [], memory={"secret": 1})
    folder = pathlib.Path(switch.folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {path.stat().st_mode & 0o777 for path in folder.iterdir()} == {0o600}
    assert json.loads((folder / "state.json").read_text())["seconds"] == HOUR
