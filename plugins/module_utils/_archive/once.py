# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Each source of a module's archive is compiled once on a computer; a module imports this before its others.

Ansible sends a module and all that it imports as sources in a ZIP. Python compiles each of them to tell the name of its
file, throws that away, and compiles it again to run it, and all that in each run. Here the name is told without, and what
was compiled is kept until the next boot: in root's folder below /run, on a computer that the collection has set up.
"""

import _imp
import atexit
import hashlib
import importlib.util
import marshal
import os
import stat
import sys
import types
import typing
import zipimport

FOLDER = "/run/rosfleet-multimaster"
RECORDS = "/var/lib/rosfleet-multimaster"  # there on a computer that is set up
_OF_PYTHON: typing.Any = _imp
_MOST = 4 << 20  # bytes that are kept, and more for one run; all modules together have a third of it


def tell_names(archive):
    """Tell the names of files in this archive without compiling them."""
    compiling = zipimport.zipimporter.get_filename

    def get_filename(self, fullname):
        if self.archive != archive:
            return compiling(self, fullname)
        return os.path.join(self.archive, _inside(self, fullname))

    zipimport.zipimporter.get_filename = get_filename  # type: ignore[method-assign]


def _inside(importer, fullname):
    """Return the path of a source within its archive."""
    end = "/__init__.py" if importer.is_package(fullname) else ".py"
    return importer.prefix + fullname.rpartition(".")[2] + end


class Compiled:
    """The code that was compiled on this computer, by a digest of name and source."""

    def __init__(self, folder: str) -> None:
        """Read what is kept in the folder."""
        self._folder = folder
        self.path = os.path.join(folder, f"compiled-{importlib.util.MAGIC_NUMBER.hex()}-{sys.flags.optimize}")
        self._fresh: typing.Dict[bytes, bytes] = {}
        self._kept: typing.Dict[bytes, bytes] = {}
        if _is_own(self._folder, 0o022) and _is_own(self.path, 0o077):
            try:
                with open(self.path, "rb") as file:
                    self._kept = dict(marshal.load(file))
            except (OSError, EOFError, ValueError, TypeError):
                pass  # the sources are here

    def code(self, name: str, source: bytes, place: str) -> types.CodeType:
        """Return the code of a source that stands at a place, compiled now if it was not before. Raises SyntaxError."""
        key = hashlib.sha256(name.encode() + b"\0" + source).digest()
        try:
            code = marshal.loads(self._kept[key])
            _OF_PYTHON._fix_co_filename(code, place)  # as importlib does: whose lines a traceback shows
        except (KeyError, EOFError, ValueError, TypeError):
            code = compile(source, place, "exec", dont_inherit=True)
            self._fresh[key] = marshal.dumps(code)
        return code

    def save(self) -> None:
        """Keep what was compiled now beside the rest. Where that cannot be, the next run compiles it."""
        if not self._fresh or not _is_own(self._folder, 0o022) or not os.path.isdir(RECORDS):
            return
        together = dict(self._kept) if sum(map(len, self._kept.values())) < _MOST else {}
        together.update(self._fresh)
        aside = f"{self.path}.{os.getpid()}"
        try:
            with open(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                marshal.dump(together, file)
            os.rename(aside, self.path)
        except OSError:
            try:
                os.unlink(aside)
            except OSError:
                pass  # it was not made


def _is_own(path: str, closed: int) -> bool:
    """Return True for a file or folder of this user's that gives nobody else these rights."""
    try:
        status = os.lstat(path)
    except OSError:
        return False
    return status.st_uid == os.geteuid() and not status.st_mode & closed and not stat.S_ISLNK(status.st_mode)


def keep_code(archive: str, compiled: Compiled) -> None:
    """Take the code of this archive out of what is kept, and keep what is compiled for it (Python 3.10 and newer)."""
    compiling = zipimport.zipimporter.get_code

    def get_code(self, fullname):
        if self.archive != archive:
            return compiling(self, fullname)
        inside = _inside(self, fullname)
        return compiled.code(inside, self.get_data(inside), os.path.join(self.archive, inside))

    zipimport.zipimporter.get_code = get_code  # type: ignore[method-assign]
    atexit.register(compiled.save)


_LOADER: typing.Any = __spec__.loader if __spec__ else None
if isinstance(_LOADER, zipimport.zipimporter):
    try:
        tell_names(_LOADER.archive)
        if hasattr(zipimport.zipimporter, "exec_module"):
            keep_code(_LOADER.archive, Compiled(FOLDER))
    except TypeError:  # before Python 3.8 it is no class of Python
        pass
