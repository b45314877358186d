# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The entries of a module's `diff`."""

import typing

Content = typing.Union[None, bytes, str]  # of a file; None stands for no file, and half of a character for a byte


def difference(path: str, before: Content, after: Content) -> typing.Dict[str, str]:
    """One entry of a module's `diff`: the text of a file before and after."""

    def text(content: Content) -> str:
        data = content.encode("utf-8", "surrogateescape") if isinstance(content, str) else content or b""
        return data.decode("utf-8", "replace")

    return {
        "before_header": path if before is not None else f"{path} (absent)",
        "after_header": path if after is not None else f"{path} (absent)",
        "before": text(before),
        "after": text(after),
    }


def mode_difference(path: str, before: int, after: int) -> typing.Dict[str, str]:
    """The entry for a file whose permissions alone change."""
    return difference(path, f"mode {before:04o}\n", f"mode {after:04o}\n")
