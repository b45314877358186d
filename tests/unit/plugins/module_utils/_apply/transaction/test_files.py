# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Files that are ours whole: the real module functions on folders of the test."""

import json
import os
import random
import signal
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic, transaction
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import files as files_module
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from hypothesis import given
from hypothesis import strategies as st


class Place:
    """A folder that stands for the machine, and the bundles on it."""

    def __init__(self, folder):
        self.folder = folder
        self.root = folder / "root"
        self.root.mkdir()
        self.records = folder / "memory" / "records"

    def path(self, name):
        return str(self.root / name)

    def steps(self, files, bundle="b"):
        """Everything that the module does before it applies: (planned, the steps of its change)."""
        entries = [
            {"path": self.path(name), "content": content, "mode": mode} for name, (content, mode) in files.items()
        ]
        planned = files_module.FileBundle("files", bundle, str(self.records), entries).make_plan()
        return planned, planned.steps_around()

    def run(self, bundle="b", **files):
        """One run of the module with files of mode 0644, name=content."""
        return self.run_modes({name.replace("__", "/"): (text, "0644") for name, text in files.items()}, bundle)

    def run_modes(self, files, bundle="b"):
        planned, steps = self.steps(files, bundle)
        transaction.carry_out(steps)
        return planned

    def tree(self):
        """Everything below the root: path -> (mode, content), None for a folder."""
        found = {}
        for folder, folders, names in os.walk(self.root):
            for name in folders + names:
                path = os.path.join(folder, name)
                if os.path.islink(path):
                    content = os.readlink(path)
                else:
                    content = None if os.path.isdir(path) else open(path).read()
                found[os.path.relpath(path, self.root)] = (os.lstat(path).st_mode & 0o777, content)
        return found


@pytest.fixture(name="place")
def _place(tmp_path):
    return Place(tmp_path)


def states(planned):
    return [item.state for item in planned.items]


def test_files_come_and_go_with_their_folders(place):
    first = place.run(etc__x__a="A", etc__x__y__b="B")
    assert states(first) == ["written", "written"]
    assert [os.path.relpath(path, place.root) for path in first.folders.made] == ["etc", "etc/x", "etc/x/y"]
    assert place.tree()["etc/x/y/b"] == (0o644, "B")
    second = place.run(etc__x__a="A", etc__x__y__b="B")
    assert states(second) == ["unchanged", "unchanged"] and not second.changed
    third = place.run(etc__x__a="A2")
    assert states(third) == ["written"]
    assert third.removals == [place.path("etc/x/y/b")] and third.folders.removed == [place.path("etc/x/y")]
    assert sorted(place.tree()) == ["etc", "etc/x", "etc/x/a"]
    place.run()
    assert place.tree() == {} and not place.records.exists()


def test_an_unchanged_run_writes_nothing(place):
    place.run(etc__a="A")
    record = place.records / "files-b.json"
    before = [os.stat(path).st_mtime_ns for path in (place.path("etc/a"), record, place.path("etc"))]
    place.run(etc__a="A")
    assert [os.stat(path).st_mtime_ns for path in (place.path("etc/a"), record, place.path("etc"))] == before


def test_only_empty_folders_that_we_made_go(place):
    os.mkdir(place.path("theirs"))
    place.run(theirs__a="A", ours__b="B", ours__deep__c="C")
    (place.root / "ours" / "stranger").write_text("s")
    planned = place.run()
    assert sorted(place.tree()) == ["ours", "ours/stranger", "theirs"]
    assert "ours stays" in " ".join(planned.notes)
    assert not place.records.exists()
    assert not place.run().changed


as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder to somebody else")


def snapshot(folder):
    """Everything below a folder, with its time of change."""
    return {path: (path.lstat().st_mtime_ns, path.lstat().st_ino) for path in [folder, *folder.rglob("*")]}


@as_root
@pytest.mark.parametrize("theirs", ["home/prefix/etc", "home"])
@pytest.mark.parametrize("wanted", [{}, {"etc__other": "B"}])
def test_nothing_is_removed_by_a_path_that_others_can_change(place, theirs, wanted):
    """The owner of the folder above puts a link in the place of ours, which leads to a file of root's with the same name."""
    place.run(home__prefix__etc__hook="A", etc__other="B")
    (place.root / "secret").mkdir()
    (place.root / "secret/hook").write_text("root's")
    os.chown(place.path(theirs), 65534, 65534)
    os.rename(place.path("home/prefix/etc"), place.path("home/prefix/away"))
    os.symlink(place.path("secret"), place.path("home/prefix/etc"))
    os.chown(place.path("home"), 65534, 65534)
    before = snapshot(place.root / "home"), snapshot(place.root / "secret")
    planned, _steps = place.steps({"etc/other": ("B", "0644")} if wanted else {})
    assert "root's" not in json.dumps(planned.differences())
    planned = place.run(**wanted)
    assert (snapshot(place.root / "home"), snapshot(place.root / "secret")) == before
    said = f"home/prefix/etc/hook was ours and stays, since {place.path('home')} belongs to nobody; expected"
    assert said in " ".join(planned.notes)
    again = place.run(**wanted)
    assert again.notes == [] and place.path("etc/other") in again.after["files"] or not wanted


@as_root
def test_nothing_is_written_where_others_can_redirect_it(place):
    os.mkdir(place.path("home"))
    os.chown(place.path("home"), 65534, 65534)
    with pytest.raises(
        Problem, match="home/prefix/hook is not written, since .*home belongs to nobody; expected folders"
    ):
        place.run(home__prefix__hook="A", etc__a="A")
    assert sorted(place.tree()) == ["home"] and not place.records.exists()


@as_root
def test_a_group_to_which_root_gave_the_right_is_trusted(place):
    """Debian gives /usr/local to the group staff."""
    os.mkdir(place.path("local"))
    os.chmod(place.path("local"), 0o2775)
    os.chown(place.path("local"), 0, 65534)
    place.run(local__lib__a="A")
    place.run()
    assert sorted(place.tree()) == ["local"]


def test_byte_code_goes_with_its_source(place):
    place.run_modes({"lib/p/a.py": ("a", "0644"), "lib/p/b.py": ("b", "0644")})
    cache = place.root / "lib" / "p" / "__pycache__"
    cache.mkdir()
    for name in ("a.cpython-311.pyc", "b.cpython-311.pyc", "a.cpython-36.opt-1.pyc", "a.cpython-311.pyc.140213"):
        (cache / name).touch()
    assert not place.steps({"lib/p/a.py": ("a", "0644"), "lib/p/b.py": ("b", "0644")})[0].changed
    place.run_modes({"lib/p/b.py": ("b", "0644")})
    assert sorted(os.listdir(cache)) == ["b.cpython-311.pyc"]
    planned = place.run()
    assert place.tree() == {}
    assert [os.path.relpath(path, place.root) for path in planned.folders.removed] == [
        "lib/p/__pycache__",
        "lib/p",
        "lib",
    ]


def test_byte_code_of_others_stays(place):
    place.run_modes({"lib/a.py": ("a", "0644")})
    (place.root / "lib" / "theirs.py").write_text("t")
    cache = place.root / "lib" / "__pycache__"
    cache.mkdir()
    (cache / "theirs.cpython-311.pyc").touch()
    place.run()
    assert sorted(place.tree()) == ["lib", "lib/__pycache__", "lib/__pycache__/theirs.cpython-311.pyc", "lib/theirs.py"]


@pytest.mark.parametrize("order", [("b1", "b2"), ("b2", "b1")])
def test_a_folder_of_two_bundles_goes_with_the_last(place, order):
    place.run("b1", etc__x__a="A")
    place.run("b2", etc__x__b="B")
    place.run(order[0])
    assert os.path.isdir(place.path("etc/x"))
    place.run(order[1])
    assert place.tree() == {} and not place.records.exists()


def test_a_foreign_file_that_is_right_stays_foreign(place):
    (place.root / "f").write_text("F")
    os.chmod(place.path("f"), 0o644)
    planned = place.run(f="F")
    assert states(planned) == ["foreign"] and not planned.changed
    assert "not ours" in planned.notes[0]
    place.run()
    assert place.tree() == {"f": (0o644, "F")}


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda path: path.write_text("other"), "a file of 5 bytes with mode 0644"),
        (lambda path: (path.write_text("F"), path.chmod(0o600)), "a file of 1 bytes with mode 0600"),
        (lambda path: path.symlink_to("/dev/null"), "a symbolic link to /dev/null"),
        (lambda path: path.mkdir(), "a folder"),
        (os.mkfifo, "a device, pipe or socket"),
    ],
)
def test_what_is_not_ours_is_a_sentence_before_any_change(place, make, said):
    make(place.root / "f")
    before = place.tree() if not said.startswith("a device") else None
    with pytest.raises(Problem) as caught:
        place.run(a="A", f="F")
    assert place.path("f") in str(caught.value) and said in str(caught.value) and "move it away" in str(caught.value)
    assert not os.path.exists(place.path("a")) and not place.records.exists()
    assert before is None or place.tree() == before


def test_a_file_where_a_folder_is_needed_is_a_sentence(place):
    (place.root / "f").write_text("F")
    with pytest.raises(Problem, match=r"f is a file, expected a folder"):
        place.run(f__deep__a="A")


@pytest.mark.parametrize(
    "change",
    [
        lambda path: path.write_text("mine"),
        lambda path: path.chmod(0o600),
        lambda path: path.unlink(),
        lambda path: (path.unlink(), path.symlink_to("/dev/null")),
    ],
)
def test_a_file_edited_by_hand_is_put_back(place, change):
    place.run(etc__a="A", etc__b="B")
    change(place.root / "etc" / "a")
    planned, steps = place.steps({"etc/a": ("A", "0644"), "etc/b": ("B", "0644")})
    assert states(planned) == ["edited", "unchanged"] and "by hand" in planned.notes[0]
    entry = planned.differences()[0]
    assert entry["before"] != entry["after"]
    transaction.carry_out(steps)
    assert place.tree()["etc/a"] == (0o644, "A")
    place.run()
    assert place.tree() == {}


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_file_of_ours_that_was_given_away_is_put_back(place):
    place.run(a="A")
    os.chown(place.path("a"), 1, 1)
    assert states(place.run(a="A")) == ["edited"]
    assert os.stat(place.path("a")).st_uid == 0


def test_an_edited_file_that_goes_is_told(place):
    place.run(a="A")
    (place.root / "a").write_text("mine")
    planned = place.run()
    assert place.tree() == {} and "changed by hand" in planned.notes[0]


def test_a_failure_puts_everything_back(place):
    place.run(etc__a="A", etc__old="OLD")
    os.chmod(place.path("etc/a"), 0o640)
    before, memory = place.tree(), (place.records / "files-b.json").read_text()
    # A name that leaves no room for the neighbour that is renamed: a file system may refuse any write.
    impossible = "new/" + "c" * 250
    _planned, steps = place.steps({"etc/a": ("A2", "0644"), "new/b": ("B", "0644"), impossible: ("C", "0755")})
    seen = []
    with pytest.raises(transaction.StepFailure, match="File name too long") as caught:
        transaction.carry_out([*steps[:-3], transaction.Step("look", lambda: seen.append(place.tree())), *steps[-3:]])
    assert "new/b" in seen[0] and "etc/old" not in seen[0]
    assert caught.value.left == []
    assert place.tree() == before and (place.records / "files-b.json").read_text() == memory


def test_a_path_that_cannot_be_put_back_is_named_and_recorded(place, monkeypatch):
    place.run(a="A")
    _planned, steps = place.steps({"a": ("A2", "0644")})
    transaction.carry_out(steps[:-1])

    def readonly(path, *_rest):
        raise OSError(30, "Read-only file system", path)

    monkeypatch.setattr(atomic, "write_by_rename", readonly)
    left = transaction.undo(steps[:-1])
    monkeypatch.undo()
    assert len(left) == 1 and place.path("a") in left[0] and "Read-only" in left[0]
    assert states(place.run(a="A3")) == ["written"]


def test_a_path_that_was_only_intended_is_not_ours(place):
    place.run(a="A")
    record = place.records / "files-b.json"
    memory = json.loads(record.read_text())
    memory["files"][place.path("b")] = {"writing": "0644 " + "0" * 64}
    record.write_text(json.dumps(memory))
    (place.root / "b").write_text("somebody's")
    with pytest.raises(Problem, match="did not write"):
        place.run(a="A", b="B")
    place.run()
    assert sorted(place.tree()) == ["b"]


@pytest.mark.slow
def test_killed_runs_are_mended_by_the_next(place):
    plans = [
        {f"d{number % 7}/{number}.py": (f"{version}" * 2000, "0644") for number in range(version * 5, 25 + version * 5)}
        for version in range(3)
    ] + [{}]
    chance = random.Random(1)
    killed = 0
    for _round in range(40):
        plan = chance.choice(plans)
        child = os.fork()
        if child == 0:
            try:
                place.run_modes(plan)
            finally:
                os._exit(0)
        time.sleep(chance.uniform(0, 0.03))
        os.kill(child, signal.SIGKILL)
        killed += os.WIFSIGNALED(os.waitpid(child, 0)[1])
        plan = chance.choice(plans)
        place.run_modes(plan)
        assert {name: found[1] for name, found in place.tree().items() if found[1] is not None} == {
            name: content for name, (content, _mode) in plan.items()
        }
        assert not place.steps(plan)[0].changed
    assert killed > 5
    place.run()
    assert place.tree() == {} and not place.records.exists()


@pytest.mark.slow
@given(
    st.lists(st.dictionaries(st.sampled_from(["a", "b", "d/a", "d/e/a", "d/e/b"]), st.sampled_from("xyz")), max_size=5)
)
def test_whatever_the_order_of_plans_nothing_is_left(tmp_path_factory, plans):
    place = Place(tmp_path_factory.mktemp("place"))
    for plan in plans:
        place.run_modes({name: (content, "0644") for name, content in plan.items()})
        assert {name: found[1] for name, found in place.tree().items() if found[1] is not None} == plan
    place.run()
    assert place.tree() == {} and not place.records.exists()


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ([{"path": "relative/x", "content": "", "mode": "0644"}], "relative/x"),
        ([{"path": "/a/../b", "content": "", "mode": "0644"}], "plain"),
        ([{"path": "/a/", "content": "", "mode": "0644"}], "plain"),
        ([{"path": "/a\0b", "content": "", "mode": "0644"}], "plain"),
        ([{"path": "/a", "content": "", "mode": 644}], "in quotes"),
        ([{"path": "/a", "content": "", "mode": "u=q"}], "symbolic mode such as"),
        (
            [{"path": "/a", "content": "", "mode": "0644", "owner": "nobody-here"}],
            "owner 'nobody-here' of /a is not known",
        ),
        ([{"path": "/a", "content": "", "mode": "0644", "group": "-1"}], "group '-1' of /a is not known"),
        ([{"path": "/a", "content": "", "mode": "0999"}], "0999"),
        ([{"path": "/a", "content": "", "mode": "0644"}] * 2, "twice"),
        ([{"path": "/a/b", "content": "", "mode": "0644"}, {"path": "/a", "content": "", "mode": "0644"}], "folder of"),
    ],
)
def test_bad_files_are_sentences(files, said):
    with pytest.raises(Problem, match=said):
        files_module.parse_files(files)


@pytest.mark.parametrize("label", ["", "../x", "a/b", ".", "x" * 65])
def test_a_bundle_is_a_plain_label(label, tmp_path):
    with pytest.raises(Problem, match="label"):
        files_module.record_of("files", label, str(tmp_path))


def test_the_folder_of_records_is_absolute():
    with pytest.raises(Problem, match="records is 'here', expected an absolute path"):
        files_module.record_of("files", "x", "here")


def test_the_digest_tells_any_change_and_no_order():
    def digest(*files):
        return files_module.digest(
            files_module.parse_files(dict(zip(("path", "content", "mode"), file)) for file in files)
        )

    a, b = ("/a", "A", "0644"), ("/b", "B", "0644")
    assert digest(a, b) == digest(b, a)
    assert len({digest(a, b), digest(a), digest(("/a", "A", "0755"), b), digest(("/a", "X", "0644"), b)}) == 4


def test_the_difference_counts_code_and_shows_the_rest(place):
    place.run_modes({"lib/same.py": ("s", "0644"), "lib/other.py": ("12345", "0644"), "lib/old.py": ("old", "0644")})
    wanted = {"lib/same.py": "s", "lib/other.py": "import this", "lib/new.py": "", "etc/a": "A"}
    planned, _steps = place.steps({name: (text, "0644") for name, text in wanted.items()})
    entries = planned.differences([place.path("lib") + "/", place.path("untouched")])
    shown, counted = entries
    assert (shown["after_header"], shown["after"]) == (place.path("etc/a"), "A")
    assert counted["before_header"] == counted["after_header"] == f"files below {place.path('lib')} that change"
    assert counted["before"] == "2 files, 8 bytes\n"
    assert counted["after"] == "2 files, 11 bytes: 1 new, 1 changed, 1 removed\n"
