# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Prints figures of the code, for the checkout or for a revision: rooms and imports, long functions, string keys.

    python tools/house.py [--rev REV]... [--names]

The figures, and how they are counted:

rooms        A tree's folders; the files next to them are one room. In a tree without folders each file is a room. A file of an
             optional feature is of the room that the page of the tree says.
arrows       Pairs of rooms of a tree of which one imports the other.
floors       The number of rooms on the longest way along the arrows; a circle of imports is an error.
functions    Functions and methods, also nested ones. Lines run from `def` to the last one. Complexity is McCabe's: 1, and 1
             more for each if, loop, else of a loop, except, assert, conditional expression, part of a comprehension,
             `and`, `or`. (ruff's C901 does not count the last three.)
string keys  Places that read `x["name"]` or `x.get("name")`, in plugin_utils and in the action, filter and lookup plugins;
             and those of them where `x` begins with a name that ends with plan, fleet or member: `case.plan["a"]["b"]`
             are two.
type comments    Comments that begin with `# type:`, but for `# type: ignore`.
docstrings   Docstrings that begin with the word What, Whether or Whose.
lines        Lines of code of the modules, module_utils, plugin_utils and the nodes: without docstrings, comments, empty
             lines and the documentation of the modules.

Functions, type comments and docstrings are counted in all of plugins/ and in the nodes. --names lists the functions that are
too long or too complex.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import io
import re
import subprocess
import tarfile
import tempfile
import tokenize
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PLUGINS = "plugins"
NODES = "roles/nodes/files/python/rosfleet_multimaster"
TREES = (f"{PLUGINS}/module_utils", f"{PLUGINS}/plugin_utils", NODES)
DOORS = ("plugin_utils", "action", "filter", "lookup")
COLLECTION = "ansible_collections.rosfleet.multimaster."
FEATURES = "_features"
LINES, COMPLEXITY = 50, 15
PLANS = ("plan", "fleet", "member")
QUESTIONS = ("What", "Whether", "Whose")
CODE = (f"{PLUGINS}/modules", *TREES)
MANUALS = {"DOCUMENTATION", "EXAMPLES", "RETURN"}
BLANK = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}

Function = ast.FunctionDef | ast.AsyncFunctionDef
Documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Picture(NamedTuple):
    """The rooms of a tree, and which imports which."""

    rooms: frozenset[str]
    arrows: frozenset[tuple[str, str]]

    @property
    def floors(self) -> int:
        """The number of rooms on the longest way along the arrows; raises ValueError if they run in a circle."""
        below: dict[str, set[str]] = {room: set() for room in self.rooms}
        for room, imported in self.arrows:
            below[room].add(imported)

        @cache
        def height(room: str, above: frozenset[str] = frozenset()) -> int:
            if room in above:
                raise ValueError(f"imports run in a circle through {room}")
            return 1 + max((height(other, above | {room}) for other in below[room]), default=0)

        return max(map(height, self.rooms), default=0)


def picture(root: Path, tree: str) -> Picture:
    """Read the imports of a tree."""
    folder = root / tree
    files = [path for path in sources(folder) if not (path.name == "__init__.py" and not _names(path))]
    of_features = _feature_files(folder / "README.md")
    flat = all(path.parent == folder for path in files)

    def room(parts: tuple[str, ...]) -> str | None:
        """The room of a module, by its name below the tree; None: there is no such module."""
        if not parts:
            return None
        if parts[0] == FEATURES:
            return next((of_features[part] for part in parts[1:] if part in of_features), None)
        if (folder / parts[0]).is_dir():
            return parts[0]
        if (folder / f"{parts[0]}.py").exists():
            return parts[0] if flat else "."
        return None

    arrows = set()
    for path in files:
        here = room(path.relative_to(folder).with_suffix("").parts)
        for name in _imports(path, root, tree):
            there = room(name)
            if here and there and here != there:
                arrows.add((here, there))
    rooms = {room(path.relative_to(folder).with_suffix("").parts) for path in files}
    return Picture(frozenset(name for name in rooms if name), frozenset(arrows))


def _feature_files(page: Path) -> dict[str, str]:
    """Read the table of the files of optional features in the page of a tree: file -> the room that it belongs to."""
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    lines = text.partition("| file of a feature |")[2].partition("\n\n")[0].splitlines()[2:]
    rows = [line.strip("|").split("|") for line in lines]
    return {file: room.strip(" `") for files, room, _content in rows for file in re.findall(r"`(\w+)`", files)}


def _names(path: Path) -> bool:
    """True if a file has more than a docstring."""
    return any(not isinstance(node, ast.Expr) for node in _tree(path).body)


def _imports(path: Path, root: Path, tree: str) -> Iterator[tuple[str, ...]]:
    """The modules of the same tree that a file imports, by their names below it."""
    package = ("rosfleet_multimaster",) if tree == NODES else (*COLLECTION.split(".")[:-1], *tree.split("/"))
    own = (*package, *path.parent.relative_to(root / tree).parts)
    for node in ast.walk(_tree(path)):
        found: list[tuple[str, ...]] = []
        if isinstance(node, ast.Import):
            found = [tuple(alias.name.split(".")) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = tuple(node.module.split(".")) if node.module else ()
            if node.level:
                base = (*own[: len(own) + 1 - node.level], *base)
            found = [(*base, alias.name) for alias in node.names]
        for name in found:
            if name[: len(package)] == package:
                yield name[len(package) :]


class Counts(NamedTuple):
    """The figures that are counted file by file."""

    functions: int = 0
    long: int = 0
    complex: int = 0
    type_comments: int = 0
    questions: int = 0
    string_keys: int = 0
    plan_keys: int = 0


def counts(root: Path) -> Counts:
    """Count in all of plugins/ and in the nodes."""
    total = Counts()
    for path in product(root):
        tree = _tree(path)
        functions = [node for node in ast.walk(tree) if isinstance(node, Function)]
        door = path.relative_to(root).parts[:2] in {(PLUGINS, folder) for folder in DOORS}
        keys = list(string_keys(tree)) if door else []
        one = Counts(
            len(functions),
            sum(length(function) > LINES for function in functions),
            sum(complexity(function) > COMPLEXITY for function in functions),
            type_comments(path.read_text(encoding="utf-8")),
            sum(_is_question(node) for node in ast.walk(tree)),
            len(keys),
            sum(name.endswith(PLANS) for name in keys),
        )
        total = Counts(*map(sum, zip(total, one, strict=True)))
    return total


def product(root: Path) -> list[Path]:
    """The files in which functions are counted."""
    return [*sources(root / PLUGINS), *sources(root / NODES)]


def offenders(root: Path) -> Iterator[tuple[str, str, int, int]]:
    """The functions that are too long or too complex: file, name, lines, complexity."""
    for path in product(root):
        for node in ast.walk(_tree(path)):
            if isinstance(node, Function) and (length(node) > LINES or complexity(node) > COMPLEXITY):
                yield str(path.relative_to(root)), node.name, length(node), complexity(node)


def length(function: Function) -> int:
    """The lines from `def` to the last one."""
    return (function.end_lineno or function.lineno) - function.lineno + 1


def complexity(function: Function) -> int:
    """McCabe's number of ways through a function, those inside expressions too."""
    return 1 + sum(map(_branches, ast.walk(function)))


def _branches(node: ast.AST) -> int:
    if isinstance(node, ast.For | ast.AsyncFor | ast.While):
        return 1 + bool(node.orelse)
    if isinstance(node, ast.BoolOp):
        return len(node.values) - 1
    if isinstance(node, ast.comprehension):
        return 1 + len(node.ifs)
    return int(isinstance(node, ast.If | ast.IfExp | ast.ExceptHandler | ast.Assert | ast.match_case))


def type_comments(text: str) -> int:
    """The comments that begin with `# type:`, but for those that ask a checker to ignore a line."""
    comments = (
        token.string for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type == tokenize.COMMENT
    )
    return sum(comment.startswith("# type:") and not comment.startswith("# type: ignore") for comment in comments)


def _is_question(node: ast.AST) -> bool:
    return isinstance(node, Documented) and (ast.get_docstring(node) or "").split(" ")[0] in QUESTIONS


def string_keys(tree: ast.AST) -> Iterator[str]:
    """The places that read `x["name"]` or `x.get("name")`: the name at which `x` begins."""
    for node in ast.walk(tree):
        owner = _owner(node)
        if owner:
            while inner := _owner(owner):
                owner = inner
            yield ast.unparse(owner)


def _owner(node: ast.AST) -> ast.expr | None:
    """The `x` of `x["name"]` and of `x.get("name")`."""
    if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load) and _is_text(node.slice):
        return node.value
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "get":
        return node.func.value if node.args and _is_text(node.args[0]) else None
    return None


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def lines(text: str) -> int:
    """The lines of code of a file: without docstrings, comments, empty lines and the documentation of a module."""
    words = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr | ast.Assign) and _is_documentation(node)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    code = {line for token in tokens if token.type not in BLANK for line in range(token.start[0], token.end[0] + 1)}
    return len(code - words)


def _is_documentation(node: ast.Expr | ast.Assign) -> bool:
    if isinstance(node, ast.Expr):
        return _is_text(node.value)
    return any(isinstance(target, ast.Name) and target.id in MANUALS for target in node.targets)


def sources(folder: Path) -> list[Path]:
    """The Python files below a folder."""
    return sorted(folder.rglob("*.py"))


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def figures(root: Path) -> dict[str, int]:
    """All figures of a checkout."""
    found = {}
    for tree in TREES:
        drawn = picture(root, tree)
        name = tree.rpartition("/")[2]
        found[f"{name}: rooms"] = len(drawn.rooms)
        found[f"{name}: arrows"] = len(drawn.arrows)
        found[f"{name}: floors"] = drawn.floors
    counted = counts(root)
    found["functions"] = counted.functions
    found[f"functions of more than {LINES} lines"] = counted.long
    found[f"functions above complexity {COMPLEXITY}"] = counted.complex
    found["string keys in the controller's part"] = counted.string_keys
    found["string keys of plans"] = counted.plan_keys
    found["type comments"] = counted.type_comments
    found["docstrings that begin with What, Whether, Whose"] = counted.questions
    for tree in CODE:
        found[f"lines: {tree.rpartition('/')[2]}"] = sum(
            lines(path.read_text(encoding="utf-8")) for path in sources(root / tree)
        )
    found["lines of product code"] = sum(number for name, number in found.items() if name.startswith("lines: "))
    return found


def table(columns: Mapping[str, Mapping[str, int]]) -> str:
    """One line for each figure, one column for each checkout."""
    names: Iterable[str] = next(iter(columns.values()))
    lines = [f"{'':50}" + "".join(f"{column:>12}" for column in columns)]
    lines += [f"{name:50}" + "".join(f"{found[name]:12}" for found in columns.values()) for name in names]
    return "\n".join(lines)


@contextlib.contextmanager
def revision(name: str) -> Iterator[Path]:
    """The files of a revision, in a folder for the time of the block."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["git", "archive", name, PLUGINS, NODES]
        archive = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout
        tarfile.open(fileobj=io.BytesIO(archive)).extractall(folder, filter="tar")
        yield Path(folder)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Prints figures of the code.")
    parser.add_argument(
        "--rev", action="append", default=[], help="a revision of git instead of the checkout; may be repeated"
    )
    parser.add_argument("--names", action="store_true", help="also name the functions that are too long or too complex")
    options = parser.parse_args()
    columns, names = {}, {}
    for name in options.rev or ["checkout"]:
        with revision(name) if options.rev else contextlib.nullcontext(ROOT) as root:
            columns[name], names[name] = figures(root), list(offenders(root))
    print(table(columns))
    for name, found in names.items() if options.names else ():
        print(f"\n{name}: lines, complexity")
        for path, function, lines, branches in found:
            print(f"  {lines:4} {branches:4}  {path}: {function}")


if __name__ == "__main__":
    main()
