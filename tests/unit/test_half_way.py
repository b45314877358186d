# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs of the modules that fail at any call: the state is the old or the new one, and the next runs know of all that is left.

The runs are those of a module with its lock and its dead-man's switch, on folders of the test. (Kills of those modules are
tried beside the modules.)
"""

import errno
import itertools
import os
import pathlib
import random
import re
import shutil
import stat
import tempfile

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import run as hosts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import run as sysctl
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import (
    deadman,
    file_bundle,
    lock,
    module,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.tunnel import key
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.tunnel import run as tunnel

from tests.unit.failing_calls import ERRORS, KILL, Fault, die

HOUR = 3600


class Module:
    """Stands for the AnsibleModule of a run."""

    check_mode, _diff = False, True

    def __init__(self, options):
        self.params = options

    def warn(self, text):
        pass

    def backup_local(self, path):
        pass


class NoTimer:
    """A timer that never rings."""

    def start(self, unit, seconds, argv):
        pass

    def stop(self, unit):
        pass


def run(concern, **options):
    """One run of a module, as module.run_module has it."""
    made = Module(options)
    guard = concern.make_guard(made)
    with lock.hold([options["records"]], "test") as unlocked:
        return module.run_locked(made, concern.make, guard, unlocked)


class Place:
    """A folder that stands for the computer. Each place has `plans`: (what is there at first, what is wanted then)."""

    nothing = ()  # what a teardown wants

    def __init__(self, folder, monkeypatch):
        self.folder, self.records = folder, str(folder / "records")
        (folder / "etc").mkdir(parents=True)
        monkeypatch.setattr(deadman, "FOLDER", str(folder / "run"))
        monkeypatch.setattr(deadman, "Timer", NoTimer)
        self.set_up(monkeypatch)

    def set_up(self, monkeypatch):
        """Make what is there before the first run."""

    def state(self):
        """All that is there: path -> (mode, owner, group, content), without what the next run removes: the lock, the switch, neighbours."""
        found = {}
        for path in sorted(self.folder.rglob("*")):
            name, status = str(path.relative_to(self.folder)), path.lstat()
            content = path.read_bytes() if path.is_file() else None
            if name != "records/lock" and not name.startswith("run") and ".rosfleet-new" not in name:
                found[name] = (stat.S_IMODE(status.st_mode), status.st_uid, status.st_gid, content)
        records = [name for name in found if name.startswith("records/")]
        return {name: entry for name, entry in found.items() if name != "records" or records}


class Files(Place):
    plans = (((), ("lib/a", "lib/deep/b")), (("lib/a", "c"), ()), (("lib/a", "lib/deep/b"), ("lib/a", "new/d")))

    def set_up(self, monkeypatch):
        (self.folder / "etc/theirs").write_text("theirs")

    def apply(self, names):
        listed = [
            {"path": f"{self.folder}/etc/{name}", "content": " ".join(names), "mode": "0640", "validate": []}
            for name in names
        ]
        return run(file_bundle.CONCERN, bundle="b", files=listed, brief=[], reload=None, records=self.records)


class Hosts(Place):
    plans = (((), (1,)), ((1,), (2,)), ((1,), ()))

    def set_up(self, monkeypatch):
        (self.folder / "etc/hosts").write_text("127.0.0.1 localhost\n127.0.1.1 kobuki1computer\n")
        os.chmod(self.folder / "etc/hosts", 0o640)

    def apply(self, numbers):
        entries = [{"address": f"192.168.1.{number}", "names": [f"kobuki{number}computer"]} for number in numbers]
        more = {"own_name": "kobuki1computer", "on_conflict": "fail", "backup": False, "records": self.records}
        return run(hosts.CONCERN, entries=entries, path=f"{self.folder}/etc/hosts", **more)


class MountedHosts(Hosts):
    """The file is a mount point, so it is written in place."""

    def apply(self, numbers):
        rename = os.rename

        def busy(source, target):
            if target.endswith("etc/hosts"):
                raise OSError(16, os.strerror(16), target)
            rename(source, target)

        os.rename = busy
        try:
            return super().apply(numbers)
        finally:
            os.rename = rename


class Sysctl(Place):
    plans = (((), ("1", "0")), (("1", "0"), ("1",)), (("1", "0"), ()))

    def set_up(self, monkeypatch):
        (self.folder / "sbin").mkdir()
        (self.folder / "sbin/init").symlink_to("/lib/systemd/systemd")
        (self.folder / "proc/net/ipv4").mkdir(parents=True)
        for name, value in (("ip_forward", "0"), ("icmp_echo_ignore_broadcasts", "1")):
            (self.folder / "proc/net/ipv4" / name).write_text(f"{value}\n")

    def run_once(self, values, seconds=0, token=""):
        names = ("net.ipv4.ip_forward", "net.ipv4.icmp_echo_ignore_broadcasts")
        settings = [
            {"name": name, "value": value, "ignore_missing": False, "enough": []} for name, value in zip(names, values)
        ]
        more = {
            "drop_in": "/etc/sysctl.d/90-rosfleet-multimaster.conf",
            "on_conflict": "fail",
            "root": str(self.folder),
        }
        more.update(proc=f"{self.folder}/proc", records=self.records, confirm_within=seconds, confirmation=token)
        return run(sysctl.CONCERN, settings=settings, **more)

    def apply(self, values):
        return self.run_once(values)


class SysctlOnTrial(Sysctl):
    """Two runs under the dead-man's switch."""

    plans = ((("1", "0"), ("1",)),)

    def apply(self, values):
        first = self.run_once(values, HOUR, "token")
        return first if first.get("failed") else self.run_once(values, 0, "token")


class Tunnel(Place):
    plans = (((), ("one",)), (("one",), ("two",)), (("one",), ()))

    def set_up(self, monkeypatch):
        monkeypatch.setattr(key, "KEY", f"{self.folder}/etc/x.key")
        monkeypatch.setattr(tunnel, "FOLDER", f"{self.folder}/run/trial")
        monkeypatch.setattr(tunnel.systemd, "states", lambda units, properties: [{"ActiveState": "active"}])
        monkeypatch.setattr(
            tunnel.commands, "run", lambda argv, given=b"", **_more: Answer(0, b"public-of-" + given, "")
        )

    def apply(self, names):
        waits = self.folder / "etc/x.key.next"
        used = self.folder / "etc/x.key"
        if names and not waits.exists() and (used.read_text() if used.exists() else "") != names[0]:
            waits.write_text(names[0])  # as the module tunnel_key does
        text = f"# PublicKey = public-of-{names[0]}\n" if names else ""
        files = [{"path": f"{self.folder}/etc/multimaster0.conf", "content": text, "mode": "0600", "validate": []}][
            : len(names)
        ]
        return run(tunnel.CONCERN, files=files, records=self.records, confirm_within=0, confirmation="")

    def state(self):
        """Without the new key: it waits before the run."""
        return {name: entry for name, entry in super().state().items() if name != "etc/x.key.next"}


class Key(Place):
    plans = (((), (False,)), ((False,), (True,)))

    def set_up(self, monkeypatch):
        monkeypatch.setattr(key.commands, "run", lambda argv, given=b"", **_more: Answer(0, b"a key", ""))

    def apply(self, rotate):
        return (
            run(key.CONCERN, rotate=rotate[0], path=f"{self.folder}/etc/x.key", records=self.records) if rotate else {}
        )


PLACES = [Files, Hosts, MountedHosts, Sysctl, SysctlOnTrial, Tunnel, Key]


@pytest.fixture(name="make")
def _make(monkeypatch):
    """Make a place anew, in a folder of the same name each time; in memory, where fsync(2) takes no time."""
    tempfile.gettempdir()  # it tries folders at its first call
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as name:

        def make(kind):
            shutil.rmtree(f"{name}/computer", ignore_errors=True)
            return kind(pathlib.Path(name) / "computer", monkeypatch)

        yield make


def states(make, kind, first, wanted):
    """The states before and after an undisturbed run, and that without anything of ours."""
    place = make(kind)
    untouched = place.state()
    assert not place.apply(first).get("failed")
    before = place.state()
    assert not place.apply(wanted).get("failed")
    return before, place.state(), untouched


def mend(place, wanted, after, untouched, told):
    """Let the next runs mend what is left, and see that they do."""
    ended = place.apply(wanted)
    assert not ended.get("failed") and place.state() == after, (told, ended)
    if not isinstance(place, Key):
        ended = place.apply(place.nothing)
        assert not ended.get("failed") and place.state() == untouched, (told, ended)
    left = [
        str(path) for path in place.folder.rglob("*") if ".rosfleet-new" in path.name or path.name in ("lock", "run")
    ]
    assert left == [], told


@pytest.mark.slow
@pytest.mark.parametrize("kind", PLACES)
def test_a_call_that_fails_leaves_the_old_or_the_new_state(make, kind):
    for number, (first, wanted) in enumerate(kind.plans):
        before, after, untouched = states(make, kind, first, wanted)
        for step in itertools.count():
            place = make(kind)
            place.apply(first)
            with Fault(step, random.Random(f"{number} {step}").choice(ERRORS)) as fault:
                ended = place.apply(wanted)
            if not fault.told:
                break
            told = f"{os.strerror(fault.error)} at {step}: {fault.told}"
            if not ended.get("failed"):
                assert place.state() == after, told
            elif ended["msg"].find("rollback-sysctl/state.json") == -1:  # else the machine takes it back in time
                assert place.state() == before, (told, ended["msg"])
            if ended.get("failed"):
                assert any(word in ended["msg"] for word in ("/", "net.ipv4")) and "A file" not in ended["msg"], (
                    told,
                    ended["msg"],
                )
            mend(place, wanted, after, untouched, told)
        assert step > 5


# Kills of the other modules are tried beside them.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "ends"),
    [(kind, False) for kind in (Files, Sysctl, Key)]
    + [pytest.param(kind, False, marks=pytest.mark.costly) for kind in (Hosts, MountedHosts, SysctlOnTrial, Tunnel)]
    + [pytest.param(kind, True, marks=pytest.mark.costly) for kind in (SysctlOnTrial, Tunnel)]
    + [(Key, True)],
)
def test_a_disk_that_fails_from_a_call_on_is_mended_later(make, kind, ends):
    """All later calls fail as well, also those of the undo; or the process ends there."""
    for number, (first, wanted) in enumerate(kind.plans):
        _before, after, untouched = states(make, kind, first, wanted)
        for step in itertools.count():
            place = make(kind)
            place.apply(first)
            fault = Fault(step, KILL if ends else random.Random(f"{number} {step}").choice(ERRORS), lasting=True)
            if ends:
                fault.told = "killed" if die(fault, place.apply, wanted) else ""
            else:
                with fault:
                    place.apply(wanted)
            if not fault.told:
                break
            # Opening a file of this /proc empties it, and the kernel's stays.
            if isinstance(place, Sysctl) and not all(
                path.read_text() for path in (place.folder / "proc/net/ipv4").iterdir()
            ):
                continue
            mend(place, wanted, after, untouched, f"{fault.error} from {step} on: {fault.told}")


class Loose:
    """The removals that a loss of power may still undo: fsync(2) of their folder has not come since."""

    def __init__(self, place, monkeypatch):
        self.place, self.removed, self.forgotten = place, set(), []
        self.unlink, self.fsync, self.rename = os.unlink, os.fsync, os.rename
        for name in ("unlink", "fsync", "rename"):
            monkeypatch.setattr(os, name, getattr(self, f"_{name}"))

    def _look_at_record(self, path):
        """A record is about to change: what it forgets has to be gone for good."""
        if path.startswith(self.place.records) and path.endswith(".json"):
            self.forgotten += sorted(self.removed)

    def _unlink(self, path):
        self._look_at_record(path)
        self.unlink(path)
        passing = path.startswith(f"{self.place.folder}/run") or ".rosfleet-new" in path or path.endswith("/lock")
        self.removed |= set() if passing else {path}

    def _rename(self, source, target):
        self._look_at_record(target)
        self.rename(source, target)

    def _fsync(self, descriptor):
        self.fsync(descriptor)
        folder = os.readlink(f"/proc/self/fd/{descriptor}")
        self.removed = {path for path in self.removed if os.path.dirname(path) != folder}


@pytest.mark.slow
@pytest.mark.parametrize("kind", PLACES)
def test_a_loss_of_power_brings_nothing_back_that_no_record_knows(make, kind):
    """Also in the undo of a run that fails at any call, and after the end."""
    for first, wanted in kind.plans:
        for step in itertools.count():
            place = make(kind)
            place.apply(first)
            with pytest.MonkeyPatch.context() as patch:
                loose = Loose(place, patch)
                with Fault(step, errno.ENOSPC) as fault:
                    ended = place.apply(wanted)
            unsynced = re.match(rf"fsync |open .* {os.O_RDONLY | os.O_DIRECTORY}\)$", fault.told)  # that is what failed
            assert unsynced or (loose.forgotten, loose.removed) == ([], set()), (fault.told, ended)
            if not fault.told:
                break
