# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The figures of the code, and the limits of a function."""

import ast
import textwrap

import pytest

from tools import house

UTILS = "plugins/module_utils"
NAME = house.COLLECTION + "plugins.module_utils."


def write(root, **files):
    """Files of module_utils: `folder__name` is folder/name.py."""
    for name, text in files.items():
        path = root / UTILS / (name.replace("__", "/") + ".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def test_in_a_flat_tree_each_file_is_a_room(tmp_path):
    write(
        tmp_path,
        top=f"from {NAME}middle import a\nfrom {NAME[:-1]} import bottom\nimport os\n",
        middle=f"import {NAME}bottom\n",
        bottom="X = 1\n",
    )
    (tmp_path / UTILS / "__init__.py").write_text("")
    picture = house.picture(tmp_path, UTILS)
    assert picture.rooms == {"top", "middle", "bottom"}
    assert picture.arrows == {("top", "middle"), ("top", "bottom"), ("middle", "bottom")}
    assert picture.floors == 3


def test_folders_are_rooms_and_what_stands_beside_them_is_one(tmp_path):
    write(
        tmp_path,
        first=f"from {NAME}folder import one\n",
        second=f"from {NAME}folder.two import a\n",
        folder__one=f"from {NAME}folder import two\n",
        folder__two="X = 1\n",
        folder____init__="",
    )
    picture = house.picture(tmp_path, UTILS)
    assert (picture.rooms, picture.arrows, picture.floors) == ({".", "folder"}, {(".", "folder")}, 2)


def test_the_nodes_import_each_other_by_relative_names(tmp_path):
    folder = tmp_path / house.NODES
    (folder / "core").mkdir(parents=True)
    (folder / "edge").mkdir()
    (folder / "core" / "a.py").write_text("from .b import X\n")
    (folder / "core" / "b.py").write_text("X = 1\n")
    (folder / "edge" / "c.py").write_text("from ..core.a import X\nfrom ..core import b\n")
    (folder / "program.py").write_text("from .edge.c import X\nfrom . import core\n")
    picture = house.picture(tmp_path, house.NODES)
    assert picture.arrows == {("edge", "core"), (".", "edge"), (".", "core")}
    assert picture.floors == 3


def test_a_circle_of_imports_has_no_floors(tmp_path):
    write(tmp_path, one=f"import {NAME}two\n", two=f"import {NAME}one\n")
    with pytest.raises(ValueError, match="circle"):
        house.picture(tmp_path, UTILS).floors  # noqa: B018


def function(text):
    return ast.parse(textwrap.dedent(text)).body[0]


@pytest.mark.parametrize(
    ("body", "ways"),
    [
        ("pass", 1),
        ("if a: b\n    elif c: d\n    else: e", 3),
        ("for a in b: c\n    else: d", 3),
        ("while a and b or c: d", 4),
        ("return [a for a in b if c if d]", 4),
        ("return a if b else c", 2),
        ("try: a\n    except B: c\n    except D: e", 3),
        ("assert a", 2),
        ("def inner():\n        if a: b", 2),
    ],
)
def test_complexity(body, ways):
    assert house.complexity(function(f"def f():\n    {body}")) == ways


def test_length():
    assert house.length(function("@decorator\ndef f(\n    a,\n):\n    return a\n")) == 4


def test_type_comments_are_not_the_word_in_a_text():
    text = 'x = []  # type: list\n# type: (int) -> int\ny = 1  # type: ignore[code]\nz = "# type: no"\n# types\n'
    assert house.type_comments(text) == 2


def test_string_keys():
    text = 'a["x"]; b.get("y", 0)["z"]; c[0]; d.get(e); f["w"] = 1; case.plan["p"]["q"]'
    assert sorted(house.string_keys(ast.parse(text))) == ["a", "b", "b", "case.plan", "case.plan"]


def test_the_figures_of_a_checkout(tmp_path):
    write(tmp_path, a='def f():\n    """Whether it is."""\n', b='"""A file."""\n')
    path = tmp_path / "plugins" / "action" / "door.py"
    path.parent.mkdir()
    path.write_text(
        'def g(plan):\n    return plan["x"], plan.get("y"), other["z"]\n' + "\n" * 60 + "x = 1  # type: int\n"
    )
    found = house.figures(tmp_path)
    assert found["functions"] == 2
    assert found["functions of more than 50 lines"] == 0
    assert found["string keys in the controller's part"] == 3
    assert found["string keys of plans"] == 2
    assert found["type comments"] == 1
    assert found["docstrings that begin with What, Whether, Whose"] == 1


@pytest.mark.slow
def test_no_function_is_too_long_or_too_complex():
    assert not {name for _path, name, _lines, _ways in house.offenders(house.ROOT)}


def test_lines_are_counted_without_documentation_and_blanks():
    text = '''
        """A file."""

        DOCUMENTATION = r"""
        module: x
        """
        # a comment
        TABLE = """
        two
        """


        def f(a,
              b):
            """Two
            lines."""
            return a  # one line
        '''
    assert house.lines(textwrap.dedent(text)) == 3 + 3
