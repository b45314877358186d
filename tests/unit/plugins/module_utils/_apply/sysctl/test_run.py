# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The module sysctl: the module as a process on folders, and on the kernel in a network namespace."""

import errno
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import boot
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import run as sysctl
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl.plan import HEADER, settings_of
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions
from processes import with_paths

from tests.unit import module_server

COLLECTION = pathlib.Path(sysctl.__file__).parents[4]
MODULE = "sysctl"
NETNS = ["ip", "netns", "exec"]
DROP_IN = "/etc/sysctl.d/90-rosfleet-multimaster.conf"
FORWARD, BROADCASTS = "net/ipv4/ip_forward", "net/ipv4/icmp_echo_ignore_broadcasts"
ETH0, LO = "net/ipv4/conf/eth0/forwarding", "net/ipv4/conf/lo/forwarding"
REDIRECTS = "net/ipv4/conf/all/accept_redirects"

as_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root for a network namespace")


# The module as a process, on folders


class Machine:
    """A machine of folders: configuration files, kernel values and records."""

    def __init__(self, folder, prefix=(), proc=None):
        self.folder, self.prefix = folder, list(prefix)
        self.root, self.records = folder / "root", folder / "var/lib/rosfleet-multimaster"
        self.proc = pathlib.Path(proc or folder / "proc")
        (self.root / "sbin").mkdir(parents=True)
        (self.root / "sbin/init").symlink_to("/lib/systemd/systemd")
        self.records.parent.mkdir(parents=True)
        self.drop_in = self.root / DROP_IN[1:]

    def hold(self, **values):
        for name, value in values.items():
            path = self.proc / "net/ipv4" / name.replace("__", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(value + "\n")
        return self

    def value(self, name):
        return (self.proc / "net/ipv4" / name).read_text().strip()

    def write(self, path, text):
        place = self.root / path.lstrip("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)

    def options(self, settings, **options):
        places = {"root": str(self.root), "proc": str(self.proc), "records": str(self.records)}
        return {"settings": settings, "drop_in": DROP_IN, "on_conflict": "fail", **places, **options}

    def run(self, settings, check=False, **options):
        arguments = {**self.options(settings, **options), "_ansible_check_mode": check, "_ansible_diff": True}
        if self.prefix[:-1] in ([], NETNS):
            done = module_server.run(MODULE, arguments, "/run/netns/" + self.prefix[-1] if self.prefix else "")
        else:
            done = self.process(arguments)
        assert done.stdout, done.stderr
        result = json.loads(done.stdout)
        assert bool(result.get("failed")) == bool(done.returncode), result
        return result

    def process(self, arguments):
        """The module as a process behind the prefix."""
        file = self.folder / "args.json"
        file.write_text(json.dumps({"ANSIBLE_MODULE_ARGS": arguments}))
        command = [*self.prefix, *module_server.command(MODULE), str(file)]
        environment = {**os.environ, "PYTHONPATH": str(COLLECTION.parents[2])}
        return subprocess.run(command, check=False, capture_output=True, text=True, env=environment, timeout=60)

    def state(self):
        """Everything that a run may change."""
        places = [self.root, self.records.parent] + ([self.proc] if self.proc.is_relative_to(self.folder) else [])
        found = {}
        for place in places:
            for path in sorted(place.rglob("*")):
                found[str(path.relative_to(self.folder))] = path.read_bytes() if path.is_file() else None
        return found


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path).hold(ip_forward="0", icmp_echo_ignore_broadcasts="1")


REPORT = [{"name": "net.ipv4.icmp_echo_ignore_broadcasts", "value": "0"}, {"name": "net/ipv4/ip_forward", "value": "1"}]


def test_check_apply_again_and_back(machine):
    untouched = machine.state()
    checked = machine.run(REPORT, check=True)
    assert machine.state() == untouched
    applied = machine.run(REPORT)
    for result in (checked, applied):
        assert result["changed"]
        assert [item["state"] for item in result["settings"]] == ["changed", "changed"]
        assert result["settings"][0]["name"] == "net.ipv4.ip_forward"
        assert (result["settings"][0]["runtime_before"], result["settings"][0]["runtime_after"]) == ("0", "1")
        assert result["settings"][0]["boot_value"] == "1"
        assert result["settings"][0]["boot_file"] == DROP_IN
        assert result["msg"] == "2 of 2 kernel settings changed."
    assert checked["diff"] == applied["diff"]
    assert machine.drop_in.read_text() == (
        HEADER + "net.ipv4.ip_forward = 1\nnet.ipv4.icmp_echo_ignore_broadcasts = 0\n"
    )
    assert machine.drop_in.stat().st_mode & 0o777 == 0o644
    assert (machine.value("ip_forward"), machine.value("icmp_echo_ignore_broadcasts")) == ("1", "0")

    applied_state = machine.state()
    again = machine.run(REPORT)
    assert not again["changed"]
    assert again["diff"] == []
    assert {item["state"] for item in again["settings"]} == {"ok"}
    assert machine.state() == applied_state

    back = machine.run([])
    assert back["changed"]
    assert {item["state"] for item in back["taken_back"]} == {"restored"}
    assert machine.state() == untouched  # also the folder sysctl.d, which was made for the drop-in
    assert not machine.run([])["changed"]


def test_diff_shows_the_file_and_the_values(machine):
    first, second = machine.run(REPORT, check=True)["diff"]
    assert (first["before"], first["before_header"]) == ("", DROP_IN + " (absent)")
    assert "net.ipv4.ip_forward = 1\n" in first["after"]
    assert second["before"] == "net.ipv4.icmp_echo_ignore_broadcasts = 1\nnet.ipv4.ip_forward = 0\n"
    assert second["after"] == "net.ipv4.icmp_echo_ignore_broadcasts = 0\nnet.ipv4.ip_forward = 1\n"


def test_diff_shows_permissions_that_come_back(machine):
    machine.run(REPORT)
    machine.drop_in.chmod(0o666)
    checked = machine.run(REPORT, check=True)["diff"]
    assert [(one["before"], one["after"]) for one in checked] == [("mode 0666\n", "mode 0644\n")]
    assert machine.run(REPORT)["diff"] == checked
    assert not machine.run(REPORT)["changed"]


def test_what_is_changed_by_hand_comes_back(machine):
    machine.run(REPORT)
    good = machine.state()
    machine.hold(ip_forward="0")
    machine.drop_in.write_text(HEADER + "net.ipv4.ip_forward = 0\n")
    result = machine.run(REPORT)
    assert [(item["name"], item["changed"]) for item in result["settings"]] == [
        ("net.ipv4.ip_forward", True),
        ("net.ipv4.icmp_echo_ignore_broadcasts", True),
    ]
    assert machine.state() == good


def test_an_item_that_is_no_longer_listed_is_taken_back(machine):
    machine.run(REPORT)
    result = machine.run(REPORT[1:])
    assert [(item["name"], item["state"]) for item in result["taken_back"]] == [
        ("net.ipv4.icmp_echo_ignore_broadcasts", "restored")
    ]
    assert "net.ipv4.icmp_echo_ignore_broadcasts is 1 again." in result["msg"]
    assert machine.drop_in.read_text() == HEADER + "net.ipv4.ip_forward = 1\n"
    assert (machine.value("ip_forward"), machine.value("icmp_echo_ignore_broadcasts")) == ("1", "1")


def test_a_value_of_somebody_else_is_left_and_named(machine):
    machine.run(REPORT)
    machine.hold(ip_forward="2")
    result = machine.run([])
    assert machine.value("ip_forward") == "2"
    said = "net.ipv4.ip_forward is left at 2: it was changed by hand or another program since this module set 1."
    assert said in result["msg"]
    assert said in json.dumps(result["warnings"])
    assert not machine.drop_in.exists()
    assert not machine.records.exists()


def test_a_conflict_fails_before_anything_changes(machine):
    machine.write("/etc/sysctl.d/99-site.conf", "# site\nnet/ipv4/ip_forward=0\n")
    untouched = machine.state()
    result = machine.run(REPORT)
    assert result["failed"]
    assert mentions(
        result["msg"], "net.ipv4.ip_forward", "/etc/sysctl.d/99-site.conf", "2", "0", "1", "on_conflict", DROP_IN
    )
    assert result["settings"][0]["conflict"] == {
        "file": "/etc/sysctl.d/99-site.conf",
        "line": 2,
        "value": "0",
        "masks": False,
    }
    assert result["settings"][1]["conflict"] is None
    assert machine.state() == untouched
    assert machine.run(REPORT, check=True)["failed"]


def test_a_conflict_can_be_reported_instead(machine):
    machine.write("/etc/sysctl.d/99-site.conf", "net/ipv4/ip_forward=0\n")
    result = machine.run(REPORT, on_conflict="report")
    assert result["changed"]
    assert machine.value("ip_forward") == "1"
    assert len(result["conflicts"]) == 1
    assert result["conflicts"][0] in json.dumps(result["warnings"])
    assert result["settings"][0]["boot_value"] == "0"
    assert not machine.run(REPORT, on_conflict="report")["changed"]


@pytest.mark.parametrize("text", ["1 # pass packets on", "0x1", "01", "1 2"])
def test_a_value_of_others_is_compared_as_the_kernel_reads_it(machine, text):
    machine.write("/etc/sysctl.d/99-own.conf", f"net.ipv4.ip_forward = {text}\n")
    result = machine.run(REPORT)
    assert result["settings"][0]["boot_value"] == "1" and not result["conflicts"], result
    assert not machine.run(REPORT)["changed"]


@pytest.mark.parametrize("text", ["0 # 1", "1# pass packets on", "1;", "+1"])
def test_a_value_that_the_kernel_reads_in_another_way_is_a_conflict(machine, text):
    machine.write("/etc/sysctl.d/99-own.conf", f"net.ipv4.ip_forward = {text}\n")
    assert machine.run(REPORT)["failed"]


ARP = "net.ipv4.conf.all.arp_ignore"


@pytest.mark.parametrize("file", ["/etc/sysctl.d/10-own.conf", "/etc/sysctl.d/99-own.conf"])
def test_a_value_of_somebody_else_that_is_enough_stays(machine, file):
    machine.hold(conf__all__arp_ignore="1").write(file, f"{ARP} = 1\n")
    wanted = [{"name": ARP, "value": "3", "enough": ["1", 2, "8"]}]
    untouched = machine.state()
    result = machine.run(wanted)
    assert result["settings"][0]["value"] == result["settings"][0]["boot_value"] == "1"
    assert machine.value("conf/all/arp_ignore") == "1" and not result["conflicts"]
    assert not machine.run(wanted)["changed"]
    machine.write(file, f"{ARP} = 8\n")
    assert machine.run(wanted)["settings"][0]["value"] == machine.value("conf/all/arp_ignore") == "8"
    machine.write(file, f"{ARP} = 1\n")
    machine.run([])
    assert machine.state() == untouched


def test_a_value_of_others_that_is_not_enough_is_a_conflict(machine):
    machine.hold(conf__all__arp_ignore="0").write("/etc/sysctl.d/99-own.conf", f"{ARP} = 0\n")
    assert "expected 3" in machine.run([{"name": ARP, "value": "3", "enough": ["1"]}])["msg"]
    machine.write("/etc/sysctl.d/99-own.conf", "")
    assert machine.run([{"name": ARP, "value": "3", "enough": ["1"]}])["settings"][0]["value"] == "3"
    assert machine.drop_in.read_text().endswith(f"{ARP} = 3\n")


def test_a_masked_service_is_a_conflict(machine):
    (machine.root / "etc/systemd/system").mkdir(parents=True)
    (machine.root / "etc/systemd/system/systemd-sysctl.service").symlink_to("/dev/null")
    result = machine.run(REPORT)
    assert mentions(result["msg"], "/etc/systemd/system/systemd-sysctl.service", DROP_IN)
    assert result["settings"][0]["conflict"]["masks"]


def test_an_excluded_key_is_a_conflict_with_the_excluding_file(machine):
    machine.write("/etc/sysctl.d/95-x.conf", "\n-net.ipv4.ip_forward\n")
    result = machine.run(REPORT)
    conflict = result["settings"][0]["conflict"]
    assert (conflict["file"], conflict["line"], conflict["value"]) == ("/etc/sysctl.d/95-x.conf", 2, None)
    assert "/etc/sysctl.d/95-x.conf line 2" in result["msg"]


@pytest.mark.parametrize("content", ["net.ipv4.ip_forward = 1\n", "", None])
def test_a_foreign_file_in_our_place_is_refused(machine, content):
    machine.write(DROP_IN, content or "")
    if content is None:
        machine.drop_in.unlink()
        machine.drop_in.symlink_to("/dev/null")
    untouched = machine.state()
    result = machine.run(REPORT)
    assert result["msg"].startswith("drop_in: %s is there and not ours" % DROP_IN)
    assert machine.state() == untouched


RULES = "/etc/udev/rules.d/90-rosfleet-multimaster.rules"
LATE = {"name": "net.netfilter.nf_conntrack_max", "value": "70000", "ignore_missing": True}


def test_a_key_of_a_module_is_set_when_the_module_comes(machine):
    machine.write("/etc/udev/rules.d/70-own.rules", "")
    untouched = machine.state()
    checked = machine.run([*REPORT, LATE], check=True)
    applied = machine.run([*REPORT, LATE])
    assert checked["diff"] == applied["diff"] and machine.drop_in.read_text().count("nf_conntrack_max") == 1
    lines = (machine.root / RULES[1:]).read_text().splitlines()
    assert lines[1:] == [
        'ACTION=="add", SUBSYSTEM=="module", KERNEL=="nf_conntrack", '
        'RUN+="/lib/systemd/systemd-sysctl --prefix=/net/netfilter/nf_conntrack_max"'
    ]
    assert not machine.run([*REPORT, LATE])["changed"]
    (machine.root / RULES[1:]).unlink()
    assert machine.run([*REPORT, LATE])["changed"] and (machine.root / RULES[1:]).exists()
    machine.run(REPORT)
    assert not (machine.root / RULES[1:]).exists()
    machine.run([])
    assert machine.state() == untouched


def test_rules_of_somebody_else_in_our_place_are_refused_where_they_are_in_the_way(machine):
    machine.write(RULES, "# mine\n")
    before = machine.state()
    failed = machine.run([LATE])
    assert mentions(failed["msg"], RULES, "not ours")
    assert machine.state() == before
    machine.run(REPORT)
    machine.run([])
    assert machine.state() == before


def test_without_udev_there_are_no_rules(machine):
    machine.run([LATE])
    assert not (machine.root / RULES[1:]).exists()


def test_a_missing_key_is_named_before_anything_changes(machine):
    untouched = machine.state()
    result = machine.run([*REPORT, {"name": "net.ipv4.conf.wlan0.rp_filter", "value": "2"}])
    assert [item["state"] for item in result["settings"]] == ["changed", "changed", "missing"]
    assert result["msg"].startswith("net.ipv4.conf.wlan0.rp_filter: this kernel has no ")
    assert machine.state() == untouched


def test_a_folder_is_no_key(machine):
    machine.hold(conf__eth0__rp_filter="0")
    assert "missing" in [
        item["state"] for item in machine.run([{"name": "net.ipv4.conf.eth0", "value": "1"}])["settings"]
    ]


def test_a_new_name_of_the_drop_in_moves_it(machine):
    machine.run(REPORT)
    other = "/etc/sysctl.d/95-other.conf"
    result = machine.run(REPORT, drop_in=other)
    assert result["changed"]
    assert not machine.drop_in.exists()
    assert (machine.root / other[1:]).exists()
    machine.run([])  # knows from the record where the drop-in is
    assert not (machine.root / other[1:]).exists()
    assert not machine.records.exists()


def test_what_a_killed_run_removed_is_gone_for_good_before_the_record_forgets_it(machine, synced):
    machine.write(RULES, "")
    machine.write("/etc/sysctl.d/10-other.conf", "")
    machine.run(REPORT)
    machine.drop_in.unlink()
    (machine.root / RULES[1:]).unlink()
    synced.clear()
    sysctl.SysctlRun(machine.options([])).apply()
    folders = [str(path.parent) for path in (machine.drop_in, machine.root / RULES[1:])]
    assert synced == [*folders, str(machine.records)]


@pytest.mark.parametrize("option", ["root", "proc", "records"])
def test_a_relative_folder_is_named(option):
    options = dict({"settings": [], "drop_in": DROP_IN, "root": "/r", "proc": "/p", "records": "/d"}, **{option: "x"})
    with pytest.raises(Problem, match=option + " is 'x', expected an absolute path"):
        sysctl.SysctlRun(options)


def test_a_record_of_another_shape_is_named(machine):
    machine.records.mkdir()
    (machine.records / "sysctl.json").write_text('{"settings": {"net/ipv4/ip_forward": {}}}')
    message = machine.run(REPORT)["msg"]
    assert mentions(message, "KeyError") and "sysctl.json" in message


@as_root
def test_a_full_disk_leaves_the_machine_as_it_was(tmp_path):
    """The folder of the drop-in is a file system without room, mounted in a mount namespace."""
    folder = tmp_path / "root/etc/sysctl.d"
    script = 'mount -t tmpfs -o nr_inodes=1 none "%s" && exec "$@"' % folder
    machine = Machine(tmp_path, ["unshare", "--mount", "sh", "-c", script, "sh"])
    machine.hold(ip_forward="0", icmp_echo_ignore_broadcasts="1")
    folder.mkdir(parents=True)
    untouched = machine.state()
    result = machine.run(REPORT)
    assert "No space left on device" in result["msg"]
    assert result["msg"].endswith("Everything is as it was before.")
    assert machine.state() == untouched


def killed_at(step, options):
    """Run the module in a child that gets SIGKILL instead of its `step`-th call that changes something; False when it
    ended before."""
    child = os.fork()
    if child == 0:
        calls, real_write = iter(range(step)), os.write

        def dying(real):
            def call(*args, **kwargs):
                # The kernel takes a value whole: nothing comes between the opening and the writing of such a file.
                value = real is real_write and "/proc/net/" in os.readlink("/proc/self/fd/%d" % args[0])
                if not value and next(calls, None) is None:
                    os.kill(os.getpid(), signal.SIGKILL)
                return real(*args, **kwargs)

            return call

        for name in ("open", "write", "rename", "unlink", "mkdir", "rmdir", "fsync"):
            setattr(os, name, dying(getattr(os, name)))
        try:
            run = sysctl.SysctlRun(options)
            run.apply()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


@pytest.mark.slow
@pytest.mark.parametrize("wanted", [REPORT, REPORT[1:], [], [{"name": "net.ipv4.ip_forward", "value": "2"}]])
def test_kill_at_any_moment_leaves_what_the_next_run_mends(tmp_path, wanted):
    """From a first state of ours to `wanted`, killed at every step, then mended, then taken back: as it was."""
    for first in ([], REPORT):
        step = 0
        while True:
            machine = Machine(tmp_path / ("%d-%d" % (len(first), step)))
            machine.hold(ip_forward="0", icmp_echo_ignore_broadcasts="1")
            untouched = machine.state()
            sysctl.SysctlRun(machine.options(first)).apply()
            killed = killed_at(step, machine.options(wanted))
            sysctl.SysctlRun(machine.options(wanted)).apply()
            for setting in settings_of(wanted):
                assert (machine.proc / setting.key).read_text().strip() == setting.value
            assert not sysctl.SysctlRun(machine.options(wanted)).changed
            sysctl.SysctlRun(machine.options([])).apply()
            assert machine.state() == untouched, step
            if not killed:
                break
            step += 1
        assert step > 10 or wanted == first


# What the list may say


def test_booleans_and_numbers_are_values(machine):
    result = machine.run([{"name": "net.ipv4.ip_forward", "value": True}, {"name": BROADCASTS, "value": 0}])
    assert [item["value"] for item in result["settings"]] == ["1", "0"]
    assert (machine.value("ip_forward"), machine.value("icmp_echo_ignore_broadcasts")) == ("1", "0")
    assert not machine.run([{"name": "net.ipv4.ip_forward", "value": "True"}, {"name": BROADCASTS, "value": "False"}])[
        "changed"
    ]
    assert mentions(machine.run([{"name": "net.ipv4.ip_forward", "value": [1]}])["msg"], "1", "boolean")


def test_a_missing_key_may_be_missing(machine):
    untouched = machine.state()
    wanted = [*REPORT, {"name": "net.ipv4.conf.wlan0.rp_filter", "value": 2, "ignore_missing": True}]
    for result in (machine.run(wanted, check=True), machine.run(wanted)):
        assert result["changed"]
        assert [(item["state"], item["problem"]) for item in result["settings"]][2] == ("missing", None)
    assert machine.drop_in.read_text().splitlines()[-1] == "-net.ipv4.conf.wlan0.rp_filter = 2"
    again = machine.run(wanted)
    assert not again["changed"] and not any(item["changed"] for item in again["settings"])
    machine.hold(conf__wlan0__rp_filter="0")  # the interface is there now
    assert [item["state"] for item in machine.run(wanted)["settings"]] == ["ok", "ok", "changed"]
    assert machine.value("conf/wlan0/rp_filter") == "2"
    machine.run([])
    assert machine.value("conf/wlan0/rp_filter") == "0"
    shutil.rmtree(machine.proc / "net/ipv4/conf")
    assert machine.state() == untouched


def test_two_ways_to_say_one_limit_are_a_contradiction(machine):
    for name, value in (("dirty_bytes", "0"), ("dirty_ratio", "20")):
        (machine.proc / "vm").mkdir(exist_ok=True)
        (machine.proc / "vm" / name).write_text(value + "\n")
    untouched = machine.state()
    for check in (True, False):
        result = machine.run(
            [{"name": "vm.dirty_bytes", "value": 1000000}, {"name": "vm.dirty_ratio", "value": 30}], check=check
        )
        assert mentions(result["msg"], "vm.dirty_bytes", "1000000", "vm.dirty_ratio", "30", "0")
    assert machine.state() == untouched


def test_the_mode_of_a_drop_in_that_goes_is_as_before(machine, monkeypatch):
    machine.run(REPORT)
    machine.drop_in.chmod(0o600)
    run = sysctl.SysctlRun(machine.options([]))

    def remove(path):
        raise OSError(errno.EPERM, "Operation not permitted", path)

    monkeypatch.setattr(sysctl.atomic, "remove_for_good", remove)
    with pytest.raises(Problem, match="Everything is as it was before."):
        run.apply()
    assert machine.drop_in.stat().st_mode & 0o777 == 0o600


def test_a_pipe_among_the_files_is_named(machine):
    (machine.root / "etc/sysctl.d").mkdir(parents=True)
    os.mkfifo(machine.root / "etc/sysctl.d/50-pipe.conf")
    message = machine.run(REPORT)["msg"]
    assert mentions(message, "/etc/sysctl.d/50-pipe.conf", "FIFO") and "move that away" in message


def test_a_link_to_nothing_hides_a_file(machine):
    (machine.root / "dev").mkdir()
    (machine.root / "dev/null").symlink_to("/dev/zero")  # a device, as on a machine
    (machine.root / "etc/sysctl.d").mkdir(parents=True)
    (machine.root / "etc/sysctl.d/99-x.conf").symlink_to("/dev/null")
    machine.write("/usr/lib/sysctl.d/99-x.conf", "net.ipv4.ip_forward = 0\n")
    assert machine.run(REPORT)["changed"]


def test_a_link_in_our_place_is_named_as_one(machine):
    machine.run(REPORT)
    text = machine.drop_in.read_text()
    machine.drop_in.unlink()
    machine.write("/etc/other", text)
    machine.drop_in.symlink_to("/etc/other")
    assert mentions(machine.run(REPORT)["msg"], "regular", "writes")


# The dead-man's switch: the run time, the confirmation, the boot part


STEPS = [
    ([], REPORT),
    (REPORT, REPORT[1:]),
    (REPORT, []),
    (REPORT[1:], [{"name": "net.ipv4.ip_forward", "value": "2"}]),
]


@pytest.mark.parametrize(("first", "wanted"), STEPS)
def test_run_time_first_then_the_rest_is_what_one_run_does(tmp_path, first, wanted):
    at_once, in_two = (Machine(tmp_path / name) for name in ("at_once", "in_two"))
    for machine in (at_once, in_two):
        machine.hold(ip_forward="0", icmp_echo_ignore_broadcasts="1")
        sysctl.SysctlRun(machine.options(first)).apply()
    untouched = in_two.state()
    sysctl.SysctlRun(at_once.options(wanted)).apply()

    one = sysctl.SysctlRun(in_two.options(wanted))
    assert one.runtime_changes
    undo, memory = one.undo_steps(), json.loads(json.dumps(one.memory))
    one.apply_runtime()
    values = {path for path, content in in_two.state().items() if content != untouched[path]}
    assert values and all(path.startswith("proc/") for path in values)  # no record, no file
    for command in undo:
        subprocess.run(command, check=True)
    assert in_two.state() == untouched

    sysctl.SysctlRun(in_two.options(wanted)).apply_runtime()
    two = sysctl.SysctlRun(in_two.options(wanted), memory)
    assert (two.runtime_changes, two.changed) == (False, True)
    two.apply()
    assert {
        path: content and content.replace(b"in_two", b"at_once") for path, content in in_two.state().items()
    } == at_once.state()
    assert not sysctl.SysctlRun(in_two.options(wanted)).changed
    sysctl.SysctlRun(in_two.options([])).apply()
    assert (in_two.value("ip_forward"), in_two.value("icmp_echo_ignore_broadcasts")) == ("0", "1")
    assert not in_two.records.exists()


def test_a_boot_part_alone_needs_no_switch(machine):
    sysctl.SysctlRun(machine.options(REPORT)).apply()
    machine.drop_in.unlink()
    run = sysctl.SysctlRun(machine.options(REPORT))
    assert (run.runtime_changes, run.changed) == (False, True)


def test_a_run_time_that_is_refused_half_way_is_as_before(machine, monkeypatch):
    untouched = machine.state()
    run = sysctl.SysctlRun(machine.options(REPORT))
    real, refused = run.kernel.write, iter([False, True])

    def write(key, value):
        if next(refused, False):
            raise OSError(errno.EINVAL, "Invalid argument")
        real(key, value)

    monkeypatch.setattr(run.kernel, "write", write)
    with pytest.raises(Problem, match="the kernel refuses the value .* Everything is as it was before."):
        run.apply_runtime()
    assert machine.state() == untouched


def test_a_value_that_cannot_be_put_back_stays_in_the_record(machine, monkeypatch):
    """Else the next run takes our value for somebody else's, and the value from before is lost."""
    run = sysctl.SysctlRun(machine.options(REPORT))
    real, broken = run.kernel.write, iter([False])

    def write(key, value):
        if next(broken, True):
            raise OSError(errno.EIO, "Input/output error")
        real(key, value)

    monkeypatch.setattr(run.kernel, "write", write)
    with pytest.raises(Problem, match=r"Not put back: .*/ip_forward \(Input/output error\)\.$"):
        run.apply()
    assert machine.value("ip_forward") == "1"
    assert sysctl.SysctlRun(machine.options([])).plan.removals[1]["state"] == "restored"
    sysctl.SysctlRun(machine.options([])).apply()
    assert (machine.value("ip_forward"), machine.records.exists()) == ("0", False)


@pytest.mark.root
def test_the_switch_cannot_be_armed_and_nothing_changes(machine):
    if os.path.isdir("/run/systemd/system"):
        pytest.skip("systemd runs here")
    untouched = machine.state()
    result = machine.run(REPORT, confirm_within=5, confirmation="t")
    assert result["failed"] and result["msg"].startswith("confirm_within: found no way to start the timer")
    assert machine.state() == untouched
    assert not os.path.exists("/run/rosfleet-multimaster/rollback-sysctl")
    assert machine.run(REPORT, check=True, confirm_within=5, confirmation="t")["changed"]


# On the kernel


@pytest.fixture
def namespace(tmp_path):
    """A machine of folders with the real kernel of a fresh network namespace."""
    name = "rosfleet-sysctl-%d" % os.getpid()
    enter = [*NETNS, name]
    before = {key: pathlib.Path("/proc/sys", key).read_text() for key in (FORWARD, BROADCASTS)}
    subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        subprocess.run([*enter, "ip", "link", "add", "eth0", "type", "bridge"], check=True)
        machine = Machine(tmp_path, enter, "/proc/sys")

        def held(key, value=None):
            program = 'echo "$2" >"/proc/sys/$1"' if value is not None else 'cat "/proc/sys/$1"'
            command = [*enter, "sh", "-c", program, "sh", key, str(value)]
            return subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout.decode().strip()

        machine.held = held
        held(FORWARD, 1)  # whatever the namespace began with, forwarding is off and its neighbours are as after a boot
        held(FORWARD, 0)
        held(BROADCASTS, 1)
        yield machine
    finally:
        subprocess.run(["ip", "netns", "delete", name], check=True)
    assert {key: pathlib.Path("/proc/sys", key).read_text() for key in before} == before, "the test changed the host"


@as_root
def test_kernel_apply_again_and_back(namespace):
    keys = [FORWARD, BROADCASTS, ETH0, LO, REDIRECTS, "net/ipv4/conf/default/forwarding"]
    namespace.held(REDIRECTS, 0)  # somebody's own choice, which turning forwarding off would undo
    before = {key: namespace.held(key) for key in keys}
    assert (before[FORWARD], before[BROADCASTS]) == ("0", "1")
    assert namespace.run(REPORT, check=True)["changed"]
    assert {key: namespace.held(key) for key in keys} == before
    assert namespace.run(REPORT)["changed"]
    assert (namespace.held(FORWARD), namespace.held(BROADCASTS), namespace.held(ETH0)) == ("1", "0", "1")
    assert not namespace.run(REPORT)["changed"]
    namespace.held(BROADCASTS, 1)
    assert [item["changed"] for item in namespace.run(REPORT)["settings"]] == [False, True]
    assert namespace.held(BROADCASTS) == "0"
    assert namespace.run([])["changed"]
    assert {key: namespace.held(key) for key in keys} == before


READ = [
    "1 # on",
    "1# on",
    "1;on",
    "1 2",
    "0x1",
    "0X1F",
    "01",
    "010",
    "08",
    "+1",
    " 1 ",
    "1x",
    "'1'",
    "1,2",
    "0b1",
    "-1",
    "1.0",
    "0x",
    "-0x2",
]


@as_root
@pytest.mark.parametrize("text", READ)
def test_the_kernel_reads_a_value_as_it_is_foretold(namespace, text):
    """Also with the remark of a file: sysctl(8) and systemd-sysctl write all that stands behind the `=`."""
    namespace.held(FORWARD, 7)
    foretold = boot.read_value(text, "7")
    try:
        namespace.held(FORWARD, text)
        held = namespace.held(FORWARD)
    except subprocess.CalledProcessError:
        held = boot.normal(text)  # refused: it is compared as it stands there
    assert foretold == held


# name, value, the words that say what is wrong
WRONG = [
    ("ip_local_reserved_ports", "8080,8081", "the kernel was given 8080,8081 and holds"),
    ("ip_local_port_range", "60999 40000", "the kernel refuses the value 60999 40000 (Invalid argument)"),
    ("conf.eth0.rp_filter", "3000000000", "the kernel refuses the value 3000000000 (Invalid argument)"),
    ("tcp_retries1", "many", "the kernel refuses the value many (Invalid argument)"),
    ("tcp_retries1", "256", "the kernel refuses the value 256 (Invalid argument)"),
]


@as_root
@pytest.mark.parametrize(("name", "value", "said"), WRONG)
def test_check_mode_asks_the_kernel_what_it_makes_of_a_value(namespace, name, value, said):
    settings = [{"name": f"net.ipv4.{name}", "value": value}]
    untouched, held = namespace.state(), namespace.held(f"net.ipv4.{name}".replace(".", "/"))
    messages = [namespace.run(settings, check=check)["msg"] for check in (True, False)]
    assert [said in message for message in messages] == [True, True], messages
    assert (namespace.state(), namespace.held(f"net.ipv4.{name}".replace(".", "/"))) == (untouched, held)


@as_root
def test_check_mode_takes_dependent_values_as_the_run_does(namespace):
    namespace.held("net/ipv4/ip_unprivileged_port_start", 80)
    settings = [{"name": "net.ipv4.ip_local_port_range", "value": "100 200"}]
    assert [namespace.run(settings, check=check).get("failed") for check in (True, False)] == [None, None]
    namespace.run([])


@as_root
def test_a_value_that_the_kernel_does_not_know_is_no_missing_key(namespace):
    settings = [{"name": "net.ipv4.tcp_congestion_control", "value": "nosuch"}]
    checked = namespace.run(settings, check=True)
    assert mentions(json.dumps(checked["warnings"]), "net.ipv4.tcp_congestion_control", "nosuch")
    failed = namespace.run(settings)
    assert mentions(failed["msg"], "nosuch", "directory")
    assert [item["state"] for item in failed["settings"]] == ["invalid"]


@pytest.mark.slow
@as_root
@pytest.mark.parametrize("seed", range(3))
def test_what_check_mode_says_of_drawn_values_comes_true(namespace, seed):
    chance = random.Random(seed)
    names = [
        "conf.eth0.rp_filter",
        "conf.lo.arp_ignore",
        "ip_default_ttl",
        "tcp_retries2",
        "ip_local_port_range",
        "tcp_rmem",
    ]
    for _time in range(12):
        numbers = [
            str(chance.choice([-1, 0, 1, 64, 255, 300, 40000, 2**31, 2**40])) for _n in range(chance.randrange(1, 4))
        ]
        settings = [{"name": f"net.ipv4.{chance.choice(names)}", "value": chance.choice([" ", "  "]).join(numbers)}]
        checked, done = (namespace.run(settings, check=check) for check in (True, False))
        assert (checked.get("failed"), checked.get("changed")) == (done.get("failed"), done.get("changed")), (
            settings,
            checked,
            done,
        )
    namespace.run([])


@as_root
@pytest.mark.parametrize("check", [True, False])
def test_root_without_a_capability_is_told_so(namespace, check):
    if shutil.which("setpriv") is None:
        pytest.skip("needs setpriv")
    namespace.prefix += ["setpriv", "--bounding-set=-net_admin", "--inh-caps=-net_admin"]
    failed = namespace.run([REPORT[1]], check=check)
    assert "this process is without the capability NET_ADMIN" in failed["msg"]


@as_root
@pytest.mark.parametrize("check", [True, False])
def test_a_locked_drop_in_is_said_before_anything_changes(machine, check):
    machine.run(REPORT)
    locked = subprocess.run(["chattr", "+i", machine.drop_in], check=False, capture_output=True)
    if locked.returncode:
        pytest.skip("no flags here")
    try:
        assert f"run 'chattr -i {machine.drop_in}'" in machine.run(REPORT[:1], check=check)["msg"]
    finally:
        subprocess.run(["chattr", "-i", machine.drop_in], check=True)


@pytest.mark.slow
@as_root
@pytest.mark.parametrize("seed", range(8))
def test_two_runs_at_once_leave_no_value_without_an_owner(namespace, seed):
    chance = random.Random(seed)
    names = [f"net.ipv4.conf.eth0.{name}" for name in ("arp_announce", "arp_ignore", "log_martians", "medium_id")]
    before = {name: namespace.held(name.replace(".", "/")) for name in names}
    untouched = namespace.state()
    for _round in range(3):
        lists = [[{"name": name, "value": "1"} for name in chance.sample(names, 2)] for _run in range(2)]
        many = [{**namespace.options(settings), "_ansible_check_mode": False} for settings in lists]
        ended = module_server.at_once(MODULE, many, "/run/netns/" + namespace.prefix[-1], [chance.random() * 0.1])
        assert [done.returncode for done in ended] == [0, 0], ended
        there = {name for name in names if namespace.held(name.replace(".", "/")) != before[name]}
        last = [{setting["name"] for setting in settings} for settings in lists]
        assert there in last
        assert all((f"{name} = 1" in namespace.drop_in.read_text()) == (name in there) for name in names)
    namespace.run([])
    assert {name: namespace.held(name.replace(".", "/")) for name in names} == before
    assert namespace.state() == untouched


@as_root
def test_kernel_undo_commands_bring_everything_back(namespace):
    """Also what somebody has set apart, which the kernel overwrites when forwarding is turned off again."""
    keys = [FORWARD, BROADCASTS, ETH0, LO, REDIRECTS, "net/ipv4/conf/default/forwarding"]
    namespace.held(ETH0, 1)
    namespace.held(REDIRECTS, 0)
    before = {key: namespace.held(key) for key in keys}
    program = (
        "import json, subprocess, sys\n"
        "from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl.run import SysctlRun\n"
        "run = SysctlRun(json.loads(sys.argv[1]))\nundo = run.undo_steps()\nrun.apply_runtime()\n"
        "print(open('/proc/sys/net/ipv4/ip_forward').read())\n"
        "for command in undo:\n    subprocess.run(command, check=True)\n"
    )
    command = [*namespace.prefix, sys.executable, "-c", program, json.dumps(namespace.options(REPORT))]
    environment = with_paths()
    assert subprocess.run(command, check=True, stdout=subprocess.PIPE, env=environment).stdout.strip() == b"1"
    assert {key: namespace.held(key) for key in keys} == before


# In the namespace: every key of `all` and `default`, and what it changes beside it.
EVERY_KEY = """
import glob, json, os
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import kernel

proc = kernel.Kernel()
keys = [path[10:] for path in sorted(glob.glob("/proc/sys/net/ipv[46]/conf/*/*")) + ["/proc/sys/net/ipv4/ip_forward"]]


def values():
    found = {}
    for key in keys:
        try:
            found[key] = proc.read(key)
        except OSError:  # a secret that nobody has set, and what can only be written
            pass
    return found


wrong, tried, others = [], 0, 0
start = before = values()
for key in start:
    if key.split("/")[3:4] not in (["all"], ["default"]) and not key.endswith("ip_forward"):
        continue
    for value in {"0": "10", "1": "01"}.get(start[key], "01" + start[key]):
        try:
            proc.write(key, value)
        except OSError:
            continue
        found = values()
        expected = {**before, **kernel.find_side_effects(key, value, before), key: found[key]}  # times are rounded
        tried, others = tried + 1, others + sum(found[other] != before[other] for other in found if other != key)
        wrong += [(key, value, other, found[other], expected[other]) for other in found if found[other] != expected[other]]
        before = found
    if before != start:
        proc.settle({other: start[other] for other in kernel.changes_others_first(start) if other in before})
        before = values()
        assert before == start, key
print(json.dumps([tried, others, wrong]))
"""


def in_namespace(namespace, program, *arguments):
    """Run a Python program in a network namespace; return what it prints as JSON."""
    environment = with_paths()
    command = [*namespace.prefix, sys.executable, "-c", program, *arguments]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, env=environment).stdout)


@pytest.mark.costly
@as_root
def test_kernel_does_beside_every_key_what_the_table_says(namespace):
    subprocess.run([*namespace.prefix, "ip", "link", "add", "eth1", "type", "bridge"], check=True)
    namespace.held("net/ipv4/conf/eth1/rp_filter", 7)  # set apart, once and for all
    tried, others, wrong = in_namespace(namespace, EVERY_KEY)
    assert wrong == []
    assert tried > 150 and others > 150


RP_FILTER = [
    {"name": "net.ipv4.conf.eth0.rp_filter", "value": 0},
    {"name": "net.ipv4.conf.default.rp_filter", "value": 2},
]


@pytest.mark.slow
@as_root
@pytest.mark.parametrize("by_hand", [False, True])
def test_kernel_default_of_all_interfaces_but_one(namespace, by_hand):
    keys = [f"net/ipv4/conf/{name}/rp_filter" for name in ("default", "eth0", "lo")]
    if by_hand:
        namespace.held(keys[2], 1)
    before = [namespace.held(key) for key in keys]
    assert [item["state"] for item in namespace.run(RP_FILTER, check=True)["settings"]] == ["changed", "changed"]
    result = namespace.run(RP_FILTER)
    assert result["changed"], result
    assert [namespace.held(key) for key in keys] == ["2", "0", "1" if by_hand else "2"]
    assert namespace.drop_in.read_text().splitlines()[1:] == [
        "net.ipv4.conf.default.rp_filter = 2",
        "net.ipv4.conf.eth0.rp_filter = 0",
    ]
    assert not namespace.run(RP_FILTER)["changed"]
    assert namespace.run([])["changed"]
    assert [namespace.held(key) for key in keys] == before


@as_root
@pytest.mark.parametrize("name", ["disable_ipv6", "addr_gen_mode", "ignore_routes_with_linkdown"])
def test_kernel_failure_brings_back_what_was_changed_beside(namespace, name):
    """Somebody has set one interface apart; `all` changes it, and then another setting is refused."""
    keys = [f"net/ipv6/conf/{interface}/{name}" for interface in ("all", "default", "eth0", "lo")]
    if subprocess.run([*namespace.prefix, "test", "-e", "/proc/sys/" + keys[0]], check=False).returncode:
        pytest.skip("no IPv6 here")
    namespace.held(keys[2], 1)
    namespace.held(keys[0], 1)
    namespace.held(keys[0], 0)
    namespace.held(keys[2], 1)
    before = [namespace.held(key) for key in keys]
    assert before == ["0", "0", "1", "0"]
    untouched = namespace.state()
    refused = {"name": "net.ipv4.ip_local_port_range", "value": "9 1"}
    result = namespace.run([{"name": keys[0], "value": "1"}, refused])
    assert result["failed"]
    assert [(item["state"], item["runtime_after"]) for item in result["settings"]] == [
        ("changed", "0"),
        ("invalid", "32768 60999"),
    ]
    assert result["settings"][1]["problem"] in result["msg"]
    assert [namespace.held(key) for key in keys] == before
    assert namespace.state() == untouched
    said = "addresses and routes of IPv6 that the kernel removed with" in result["msg"]
    assert said == (name == "disable_ipv6") and ("Everything is as it was before." in result["msg"]) != said


@as_root
def test_kernel_also_changed_names_what_comes_back(namespace):
    keys = ["net/ipv6/conf/all/disable_ipv6", "net/ipv6/conf/eth0/disable_ipv6"]
    namespace.held(keys[0], 1)
    namespace.held(keys[1], 0)
    result = namespace.run([{"name": keys[0], "value": False}])
    assert result["also_changed"] == []  # it has what all interfaces get
    namespace.run([])
    assert [namespace.held(key) for key in keys] == ["1", "0"]
    namespace.held(keys[0], 0)
    namespace.held(keys[1], 1)
    result = namespace.run([{"name": "net.ipv6.conf.all.ignore_routes_with_linkdown", "value": True}])
    assert result["changed"] and namespace.held("net/ipv6/conf/eth0/ignore_routes_with_linkdown") == "1"


@as_root
def test_kernel_takes_back_in_the_reverse_order(namespace):
    """Each of the two is refused while the other has its present value."""
    ports, first = "net/ipv4/ip_local_port_range", "net/ipv4/ip_unprivileged_port_start"
    settings = [{"name": ports, "value": "40000 60000"}, {"name": first, "value": 35000}]
    before = [namespace.held(key) for key in (ports, first)]
    namespace.run(settings)
    assert [namespace.held(key).split() for key in (ports, first)] == [["40000", "60000"], ["35000"]]
    assert not namespace.run(settings)["changed"]
    namespace.run([])
    assert [namespace.held(key) for key in (ports, first)] == before
    low = [{"name": first, "value": 80}, {"name": ports, "value": "600 60000"}]
    namespace.run(low)
    namespace.run([])
    assert [namespace.held(key) for key in (ports, first)] == before
    refused = namespace.run([*low, {"name": "net.ipv4.tcp_rmem", "value": "x"}])
    assert "Everything is as it was before." in refused["msg"]
    assert [namespace.held(key) for key in (ports, first)] == before


@as_root
def test_kernel_keeps_interfaces_that_are_set_apart(namespace):
    settings = [{"name": "net.ipv4.conf.eth0.forwarding", "value": "0"}, {"name": "net.ipv4.ip_forward", "value": "1"}]
    namespace.run(settings)
    assert (namespace.held(FORWARD), namespace.held(ETH0), namespace.held(LO)) == ("1", "0", "1")
    assert not namespace.run(settings)["changed"]


@as_root
@pytest.mark.parametrize("value", ["01", "many", "1 2", "", "0x1"])
def test_a_wrong_kernel_value_is_refused_in_check_mode_too(namespace, value):
    untouched = namespace.state()
    for check in (True, False):
        result = namespace.run([REPORT[1], {"name": BROADCASTS, "value": value}], check=check)
        assert result["failed"] and [item["state"] for item in result["settings"]] == ["changed", "invalid"]
        assert mentions(result["msg"], "net.ipv4.icmp_echo_ignore_broadcasts", value)
    assert namespace.state() == untouched


@as_root
def test_kernel_a_key_that_root_may_not_write_either(namespace):
    result = namespace.run([{"name": "net.ipv4.conf.eth0.mc_forwarding", "value": "1"}], check=True)
    assert result["settings"][0]["state"] == "denied"
    assert "not even root" in result["msg"] and "become" not in result["msg"]


@as_root
def test_kernel_several_numbers(namespace):
    key = "net/ipv4/ip_local_port_range"
    before = namespace.held(key)
    assert "\t" in before
    result = namespace.run([{"name": key, "value": " ".join(before.split())}])
    assert result["settings"][0]["runtime_before"] == result["settings"][0]["runtime_after"] == "32768 60999"
    namespace.run([{"name": key, "value": "33000  60000"}])
    assert namespace.held(key).split() == ["33000", "60000"]
    namespace.run([])
    assert namespace.held(key) == before


@as_root
def test_kernel_interface_with_a_dot(namespace):
    subprocess.run([*namespace.prefix, "ip", "link", "add", "eth0.100", "type", "bridge"], check=True)
    key = "net/ipv4/conf/eth0.100/rp_filter"
    namespace.run([{"name": "net.ipv4.conf.eth0/100.rp_filter", "value": "2"}])
    assert namespace.held(key) == "2"
    assert not namespace.run([{"name": key, "value": "2"}])["changed"]
    subprocess.run([*namespace.prefix, "ip", "link", "delete", "eth0.100"], check=True)
    result = namespace.run([])
    assert [item["state"] for item in result["taken_back"]] == ["missing"]
    assert not namespace.records.exists()


READ_ONLY = 'mount --bind /proc/sys /proc/sys && mount -o remount,ro,bind /proc/sys && exec "$@"'


@as_root
def test_kernel_read_only(namespace):
    namespace.prefix += ["unshare", "--mount", "sh", "-c", READ_ONLY, "sh"]
    untouched = namespace.state()
    result = namespace.run(REPORT)
    assert [item["state"] for item in result["settings"]] == ["read_only", "read_only"]
    assert mentions(result["msg"], "net.ipv4.ip_forward", "/proc/sys/net/ipv4/ip_forward")
    assert "holds 0, expected 1" in result["msg"]
    assert namespace.state() == untouched
    as_it_is = [{"name": "net.ipv4.ip_forward", "value": "0"}]
    assert namespace.run(as_it_is)["settings"][0]["state"] == "changed"  # the drop-in; the value needs no write
    assert not namespace.run(as_it_is)["changed"]


@as_root
def test_kernel_taking_back_that_is_refused_keeps_the_record(namespace):
    namespace.run(REPORT)
    applied = namespace.state()
    namespace.prefix += ["unshare", "--mount", "sh", "-c", READ_ONLY, "sh"]
    result = namespace.run([])
    assert "Taking back net.ipv4.ip_forward: " in result["msg"]
    assert namespace.state() == applied


@as_root
def test_kernel_denied(namespace):
    """Another user than root, in the same network namespace."""
    if shutil.which("setpriv") is None:
        pytest.skip("needs setpriv")
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        machine = Machine(pathlib.Path(folder) / "machine", namespace.prefix, "/proc/sys")
        machine.prefix += ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
        if subprocess.run([*machine.prefix, sys.executable, "-c", "import ansible"], check=False).returncode:
            pytest.skip("another user cannot run this Python")
        untouched = machine.state()
        result = machine.run(REPORT)
        assert [item["state"] for item in result["settings"]] == ["denied", "denied"]
        assert mentions(result["msg"], "net.ipv4.ip_forward", "65534", "/proc/sys/net/ipv4/ip_forward")
        assert machine.state() == untouched
