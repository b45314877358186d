# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""An object of the nodes is whole when it is made: its constructor names all attributes, and nothing is wired afterwards."""

import ast
import pathlib

import pytest

NODES = pathlib.Path(__file__).parents[3] / "roles/nodes/files/python/rosfleet_multimaster"
FILES = sorted(NODES.rglob("*.py"))
MOST_PARAMETERS = 9

#: class -> attributes of its base class, which is a library's
OF_LIBRARIES = {
    "edge/rpc_server.py:BoundedHandler": {"rfile", "close_connection", "_counted"},
    "edge/rpc_server.py:_Handler": {"close_connection", "protocol_version"},
    "edge/rpc_client.py:_Connection": {"response_class", "sock"},
    "roscore/door.py:Handler": {"close_connection"},
    "roscore/master.py:_Server": {"server_address", "socket"},
}


def methods(kind):
    return {node.name: node for node in kind.body if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))}


def classes(tree):
    return [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]


def own_name(method):
    return method.args.args[0].arg if method.args.args else None


def assigned(method):
    """The attributes of the object itself that a method assigns."""
    own = own_name(method)
    return {
        node.attr
        for node in ast.walk(method)
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)
        if isinstance(node.value, ast.Name) and node.value.id == own
    }


def fields(kind):
    """The fields of a dataclass: its constructor is made of them."""
    if not any("dataclass" in ast.unparse(decorator) for decorator in kind.decorator_list):
        return set()
    return {node.target.id for node in kind.body if isinstance(node, ast.AnnAssign)}


def born_late(name, tree):
    """Class -> the attributes that another method than the constructor makes."""
    found = {}
    for kind in classes(tree):
        made = methods(kind)
        first = assigned(made["__init__"]) if "__init__" in made else set()
        of_the_base = OF_LIBRARIES.get(f"{name}:{kind.name}", set())
        late = set().union(*(assigned(method) for method in made.values())) - first - fields(kind) - of_the_base
        if late:
            found[kind.name] = late
    return found


def parameters(method):
    arguments = method.args
    return [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]


def taken_callbacks(method):
    """The parameters of a method that are functions and become attributes."""
    functions = {one.arg for one in parameters(method) if one.annotation and "Callable" in ast.unparse(one.annotation)}
    found = set()
    for node in ast.walk(method):
        if isinstance(node, ast.Assign):
            for target, value in pairs(node):
                if isinstance(target, ast.Attribute) and isinstance(value, ast.Name) and value.id in functions:
                    found.add(value.id)
    return found


def pairs(assignment):
    """Each target of an assignment with its value, also where several stand in one."""
    for target in assignment.targets:
        if isinstance(target, ast.Tuple) and isinstance(assignment.value, ast.Tuple):
            yield from zip(target.elts, assignment.value.elts)
        else:
            yield target, assignment.value


def second_constructors(tree):
    """Methods that take over several functions."""
    return {
        f"{kind.name}.{name}"
        for kind in classes(tree)
        for name, method in methods(kind).items()
        if name != "__init__" and len(taken_callbacks(method)) > 1
    }


def wired(tree):
    """Functions of an object that become attributes of one of its parts."""
    found = set()
    for kind in classes(tree):
        for method in methods(kind).values():
            for node in ast.walk(method):
                for target, value in pairs(node) if isinstance(node, ast.Assign) else ():
                    bound = isinstance(value, ast.Attribute) and value.attr in methods(kind)
                    part = isinstance(target, ast.Attribute) and isinstance(target.value, ast.Attribute)
                    if part and (bound or isinstance(value, ast.Lambda)):
                        found.add(ast.unparse(target))
    return found


def in_the_nodes(path):
    return path.relative_to(NODES).as_posix()


def read(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", FILES, ids=in_the_nodes)
def test_no_attribute_is_born_outside_the_constructor(path):
    assert born_late(in_the_nodes(path), read(path)) == {}


@pytest.mark.parametrize("path", FILES, ids=in_the_nodes)
def test_no_constructor_has_too_many_parameters(path):
    made = {kind.name: methods(kind).get("__init__") for kind in classes(read(path))}
    counts = {name: len(parameters(method)) - 1 for name, method in made.items() if method is not None}
    assert all(count <= MOST_PARAMETERS for count in counts.values()), counts


@pytest.mark.parametrize("path", FILES, ids=in_the_nodes)
def test_nothing_is_wired_after_it_was_made(path):
    assert second_constructors(read(path)) == set()
    assert wired(read(path)) == set()


def test_each_rule_sees_what_it_is_for():
    tree = ast.parse(
        """
class Part:
    def __init__(self, a, b, c, d, e, f, g, h, i, j):
        self.known = a

    def connect(self, told: Callable[[], None], over: Callable[[], None]):
        self.told, self.over = told, over

class Whole:
    def __init__(self):
        self.part = Part(*"abcdefghij")
        self.part.told = self._told
        self.part.over = lambda: None

    def _told(self):
        self.known, self.late = 1, 2
"""
    )
    assert born_late("x.py", tree) == {"Part": {"told", "over"}, "Whole": {"known", "late"}}
    assert second_constructors(tree) == {"Part.connect"}
    assert wired(tree) == {"self.part.told", "self.part.over"}
    assert len(parameters(methods(classes(tree)[0])["__init__"])) - 1 == 10 > MOST_PARAMETERS


def test_the_table_of_libraries_names_no_more_than_there_is():
    found = {}
    for path in FILES:
        for kind in classes(read(path)):
            found[f"{in_the_nodes(path)}:{kind.name}"] = set().union(*map(assigned, methods(kind).values()))
    assert all(names <= found.get(name, set()) for name, names in OF_LIBRARIES.items())
