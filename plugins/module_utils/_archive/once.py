# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Each source of a module's archive is compiled once; a module imports this before its others.

Ansible sends a module and all that it imports as sources in a ZIP. Python compiles each of them to tell the name of its
file, throws that away, and compiles it again to run it. Here the name is told without.
"""

import typing
import zipimport


def tell_names(archive):
    """Tell the names of files in this archive without compiling them."""
    compiling = zipimport.zipimporter.get_filename

    def get_filename(self, fullname):
        if self.archive != archive:
            return compiling(self, fullname)
        end = "/__init__.py" if self.is_package(fullname) else ".py"
        return self.archive + "/" + self.prefix + fullname.rpartition(".")[2] + end

    try:
        zipimport.zipimporter.get_filename = get_filename  # type: ignore[method-assign]
    except TypeError:  # before Python 3.8 it is no class of Python
        pass


_LOADER: typing.Any = __spec__.loader if __spec__ else None
if isinstance(_LOADER, zipimport.zipimporter):
    tell_names(_LOADER.archive)
