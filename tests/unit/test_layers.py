# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The house: which folder may import which, in all three trees; where a file's test stands; where sockets and ROS are.

ROOMS is what the pages say: a README in each tree, and that of the role which brings the nodes.
"""

import ast
import functools
import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).parents[2]
MODULE_UTILS = "plugins/module_utils"
PLUGIN_UTILS = "plugins/plugin_utils"
NODES = "roles/nodes/files/python/rosfleet_multimaster"


def read_tables(page):
    """The tables of rooms in a page: room -> the rooms that it may import, beside itself. "" is a folder's own files."""
    tables, rows = [], None
    for line in (ROOT / page).read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else None
        if cells == ["room", "content", "imports"]:
            rows = {}
            tables.append(rows)
        elif cells is None:
            rows = None
        elif rows is not None and not set(line) <= set("|-"):
            name, _content, imported = cells
            rows[name.strip("`") if name.startswith("`") else ""] = set(re.findall(r"`(\w+)`", imported))
    return tables


def read_features(page):
    """The table of the files of features in a page: file -> the room that it belongs to."""
    lines = (ROOT / page).read_text(encoding="utf-8").partition("| file of a feature |")[2].partition("\n\n")[0]
    rows = [line.strip("|").split("|") for line in lines.splitlines()[2:]]
    return {file: room.strip(" `") for files, room, _content in rows for file in re.findall(r"`(\w+)`", files)}


_robot, _apply, _probe = read_tables(f"{MODULE_UTILS}/README.md")
_controller, _verify = read_tables(f"{PLUGIN_UTILS}/README.md")
(_nodes,) = read_tables("roles/nodes/README.md")
#: folder -> room in it -> the rooms that it may import
ROOMS = {
    MODULE_UTILS: _robot,
    f"{MODULE_UTILS}/_apply": _apply,
    f"{MODULE_UTILS}/_probe": _probe,
    PLUGIN_UTILS: _controller,
    f"{PLUGIN_UTILS}/_verify": _verify,
    NODES: _nodes,
}
FEATURES = "_features"
#: tree -> file of an optional feature -> its room
FEATURE_FILES = {tree: read_features(f"{tree}/README.md") for tree in (MODULE_UTILS, PLUGIN_UTILS)}
MOST_FILES = 15  # beside each other
COLLECTION = "ansible_collections.rosfleet.multimaster."

INPUT_AND_OUTPUT = set(
    """
    socket socketserver select selectors http xmlrpc subprocess signal os sys logging
    time datetime threading queue asyncio concurrent multiprocessing random secrets uuid
    """.split()
)
ROS = set(
    "rospy rosgraph rosmaster roslib rospkg genpy std_msgs std_srvs diagnostic_msgs fkie_multimaster_msgs".split()
)


def sources(tree):
    """The Python files of a tree."""
    return sorted((ROOT / tree).rglob("*.py"))


def package_of(path):
    """The package in which a file lies: of the nodes, or of the collection."""
    if path.is_relative_to(ROOT / NODES):
        return ("rosfleet_multimaster", *path.parent.relative_to(ROOT / NODES).parts)
    return ("ansible_collections", "rosfleet", "multimaster", *path.parent.relative_to(ROOT).parts)


@functools.cache
def imports(path):
    """The modules that a file imports, by their full names."""
    package, found = package_of(path), set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = package[: len(package) + 1 - node.level]
                base = ".".join([*parts, *([node.module] if node.module else [])])
            found |= {base} | {f"{base}.{alias.name}" for alias in node.names}
    return found


def rooms_of(tree, path):
    """The room of a file, and the rooms of its tree that it imports."""
    folder = ROOT / tree
    prefix = "rosfleet_multimaster" if tree == NODES else COLLECTION + tree.replace("/", ".")
    own = path.relative_to(folder).parts
    files = FEATURE_FILES.get(tree, {})
    inside = [name[len(prefix) + 1 :].split(".") for name in imports(path) if name.startswith(prefix + ".")]
    named = {name[0] for name in inside if name[0] != FEATURES}
    featured = {part for name in inside if name[0] == FEATURES for part in name[1:] if part in files}
    if own[0] == FEATURES:
        own = (files.get(path.stem, path.stem), path.name)
    rooms = {files[part] for part in featured} | {
        name if (folder / name).is_dir() else ""
        for name in named
        if (folder / name).is_dir() or (folder / f"{name}.py").exists()
    }
    return (own[0] if len(own) > 1 else ""), rooms


CASES = [(tree, path) for tree in ROOMS for path in sources(tree)]
IDS = [str(path.relative_to(ROOT)) for _tree, path in CASES]


@pytest.mark.slow
@pytest.mark.parametrize(("tree", "path"), CASES, ids=IDS)
def test_a_room_imports_only_what_stands_below_it(tree, path):
    room, imported = rooms_of(tree, path)
    if path.name == "__init__.py" and room in ("", "__init__"):
        return
    assert room in ROOMS[tree], f"{room} is a folder that this table does not know"
    assert imported <= ROOMS[tree][room] | {room}


@pytest.mark.parametrize("tree", ROOMS)
def test_no_arrow_goes_up(tree):
    below = {}
    for room, arrows in ROOMS[tree].items():  # the table is written from the ground up
        assert arrows - {room} <= set(below), f"{room} stands before what it imports"
        below[room] = arrows


def test_no_feature_imports_another():
    for tree in FEATURE_FILES:
        for path in sources(f"{tree}/{FEATURES}"):
            parts = path.relative_to(ROOT / tree / FEATURES).parts
            begin = f"{COLLECTION}{tree.replace('/', '.')}.{FEATURES}."
            named = {name[len(begin) :].split(".")[0] for name in imports(path) if name.startswith(begin)}
            assert len(parts) == 1 or named <= {parts[0]}, (path, named)


def test_the_core_of_the_controller_imports_no_feature():
    begin = f"{COLLECTION}{PLUGIN_UTILS.replace('/', '.')}.{FEATURES}"
    for path in sources(PLUGIN_UTILS):
        if path.relative_to(ROOT / PLUGIN_UTILS).parts[0] != FEATURES:
            assert not any(name.startswith(begin) for name in imports(path)), path


#: where actions share what needs Ansible's classes
ACTIONS_SHARE = {f"_robot_io/{name}.py" for name in ("robot_action", "confirmation", "trees", "refusal", "ssh")}


#: what the robots answer, and the files of the controller that read it
CONTRACT = f"{COLLECTION}{MODULE_UTILS.replace('/', '.')}._contract"
READERS = {"_robot_io/documentation.py"} | {
    f"_verify/observe/{name}.py" for name in ("contract", "observations", "outcomes", "packet_trace")
}


def test_the_controller_takes_the_contract_in_few_files():
    for path in sources(PLUGIN_UTILS):
        ours = path.relative_to(ROOT / PLUGIN_UTILS).as_posix()
        assert ours in READERS or not any(name.startswith(CONTRACT) for name in imports(path)), path


def test_the_halves_do_not_know_each_other():
    for path in sources(MODULE_UTILS) + sources("plugins/modules"):
        assert not any("plugin_utils" in name for name in imports(path)), path
    for path in sources(PLUGIN_UTILS):
        ours = path.relative_to(ROOT / PLUGIN_UTILS).as_posix()
        strange = {
            name
            for name in imports(path) - {CONTRACT.rpartition(".")[0]}
            if (not name.startswith(CONTRACT) and "module_utils" in name) or name.startswith("ansible.")
        }
        assert ours in ACTIONS_SHARE or not strange, (path, strange)


#: the files of the controller that take what the nodes have from the nodes
DOORS_TO_NODES = {"_inventory/filters.py", "_base/hosts.py", "_base/plain_text.py"}


def test_the_controller_takes_from_the_nodes_in_few_files():
    below = COLLECTION + NODES.replace("/", ".") + ".protocol"
    for path in sources(PLUGIN_UTILS):
        taken = {name for name in imports(path) if name.startswith(COLLECTION + "roles")}
        ours = path.relative_to(ROOT / PLUGIN_UTILS).as_posix()
        assert not taken or (ours in DOORS_TO_NODES and all(name.startswith(below) for name in taken)), (path, taken)


@pytest.mark.parametrize("tree", [PLUGIN_UTILS, MODULE_UTILS, NODES, "lab"])
def test_no_folder_is_a_heap(tree):
    folders = {path.parent for path in sources(tree)}
    counts = {folder.relative_to(ROOT).as_posix(): len(list(folder.glob("*.py"))) for folder in folders}
    assert max(counts.values()) <= MOST_FILES, counts


# The faces

#: all rooms, those inside of others first
FOLDERS = sorted((f"{tree}/{room}" for tree in ROOMS for room in ROOMS[tree] if room), key=len, reverse=True)


@functools.cache
def room_around(path):
    """The innermost room in which a file is; "" for what is above the trees."""
    for tree, files in FEATURE_FILES.items():
        if path.is_relative_to(ROOT / tree / FEATURES):
            return f"{tree}/{files[path.stem]}" if path.stem in files else ""
    return next((room for room in FOLDERS if path.is_relative_to(ROOT / room)), "")


def read_face(folder):
    """The files of a room that others may import: `__all__` in its `__init__.py`."""
    lines = ast.parse((folder / "__init__.py").read_text(encoding="utf-8")).body
    faces = [line.value for line in lines if isinstance(line, ast.Assign) and line.targets[0].id == "__all__"]
    return set(ast.literal_eval(faces[0])) if faces else set()


def list_foreign_imports(path):
    """The imports of a file out of other rooms: (folder in which the file is not, file or folder or name in it)."""
    for name in imports(path):
        inside = name.replace("rosfleet_multimaster", COLLECTION + NODES.replace("/", "."), 1)
        if inside.startswith(COLLECTION):
            target = ROOT.joinpath(*inside[len(COLLECTION) :].split("."))
            room = room_around(target)
            if room and room != room_around(path):
                yield from (
                    (folder, place.name)
                    for place, folder in zip([target, *target.parents], target.parents)
                    if room_around(folder) and not path.is_relative_to(folder)
                )


@pytest.mark.slow
def test_the_face_of_a_room_is_what_others_import():
    used, private = {}, set()
    for path in [*sources("plugins"), *sources(NODES)]:
        for folder, name in list_foreign_imports(path):
            if folder.is_dir():
                used.setdefault(folder, set()).add(name)
            elif name.startswith("_"):
                private.add((path, folder, name))
    trees = (MODULE_UTILS, PLUGIN_UTILS, NODES)
    faces = {path.parent: read_face(path.parent) for tree in trees for path in sources(tree) if path.stem == "__init__"}
    wrong = {
        str(folder.relative_to(ROOT)): (sorted(faces.get(folder, set())), sorted(used.get(folder, set())))
        for folder in {*faces, *used}
        if faces.get(folder, set()) != used.get(folder, set())
    }
    assert (wrong, private) == ({}, set()), "folder: what its __all__ has, and what others import"


# The nodes


#: the format of XML-RPC is in a module of Python that has servers and clients, too
FORMATS = {"protocol/xml_rpc.py": {"xmlrpc"}, "roscore/core/store_format.py": {"xmlrpc"}}


def in_the_nodes(path):
    """The path of a file in the tree of the nodes."""
    return path.relative_to(ROOT / NODES).as_posix()


def is_pure(name):
    """True where there is no I/O: in `protocol` and in each folder `core`."""
    folders = name.split("/")[:-1]
    return folders[:1] == ["protocol"] or "core" in folders


@pytest.mark.parametrize("path", [path for path in sources(NODES) if is_pure(in_the_nodes(path))], ids=in_the_nodes)
def test_protocol_and_core_have_no_io_and_no_ros(path):
    found = imports(path)
    allowed = FORMATS.get(in_the_nodes(path), set())
    assert not {name.split(".")[0] for name in found} & (INPUT_AND_OUTPUT | ROS) - allowed
    ours = [
        name.partition(".")[2].replace(".", "/") + ".py" for name in found if name.startswith("rosfleet_multimaster.")
    ]
    used = [name for name in ours if (ROOT / NODES / name).exists()]
    assert all(map(is_pure, used)), used


@pytest.mark.parametrize("path", sources(NODES), ids=lambda path: path.stem)
def test_ros_has_three_files(path):
    """One for nodes, one for the roscore, and one for messages that a robot may not have."""
    if in_the_nodes(path) not in (
        "edge/ros.py",
        "roscore/master.py",
        "edge/diagnostic_classes.py",
    ):
        assert not {name.split(".")[0] for name in imports(path)} & ROS


@pytest.mark.parametrize("path", sources(NODES), ids=lambda path: path.stem)
def test_no_setting_of_the_process_is_changed(path):
    text = path.read_text(encoding="utf-8")
    assert "setdefaulttimeout" not in text and not text.startswith("#!")
    ast.parse(text, feature_version=(3, 8))


# The tests

MIRRORED = {
    "tests/unit/plugins": "plugins",
    **{f"tests/unit/nodes/{room}": f"{NODES}/{room}" for room in ROOMS[NODES] if room},
}


@pytest.mark.parametrize("tests", MIRRORED)
def test_a_test_stands_at_the_path_of_its_file(tests):
    for path in sorted((ROOT / tests).rglob("test_*.py")):
        folder = ROOT / MIRRORED[tests] / path.parent.relative_to(ROOT / tests)
        name = path.stem[len("test_") :]
        assert (folder / f"{name}.py").exists() or (folder / name).is_dir(), f"{path} tests no file"


#: what may change where Python looks for modules -> why pytest.ini cannot say it
OWN_PATHS = {
    **dict.fromkeys(
        """
        lab/rehearsals/cast.py tests/bench/network/relay.py tests/bench/network/draw.py tests/bench/network/network.py
        tests/bench/network/roaming.py tests/bench/network/tunnel.py tests/bench/roscore/stores.py tests/bench/site/growth.py
        tests/bench/site/hosts.py tests/bench/site/site.py tests/faults/judge_again.py tests/faults/run.py tests/matrix/controllers.py
        tools/docsite/build.py tools/pictures/__main__.py tools/readme.py tools/references.py
        """.split(),
        "a program that is run by its path, without pytest",
    ),
    **dict.fromkeys(
        """
        tests/bench/network/programs/simulated.py tests/machines/test_alone.py tests/systems/test_metrics.py tests/systems/test_sandbox.py
        """.split(),
        "runs on a robot of the lab, with the nodes as they are installed there",
    ),
    "plugins/plugin_utils/_plan/units.py": "a unit of a robot, by `python3 -I`, which reads no environment",
    "tests/unit/nodes/test_end_connections.py": "the process of that unit",
}


def test_import_paths_are_in_one_place():
    changes = re.compile(r"\bsys\.path(\.insert|\.append|\.extend|\[:0\] =| \+=)|site\.addsitedir")
    files = [path for tree in ("lab", "plugins", "roles", "tests", "tools") for path in sources(tree)]
    found = {path.relative_to(ROOT).as_posix() for path in files if changes.search(path.read_text(encoding="utf-8"))}
    assert found == set(OWN_PATHS)
