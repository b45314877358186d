# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The entries of a module's `diff`."""

import typing


def difference(path: str, before: typing.Optional[bytes], after: typing.Optional[bytes]) -> typing.Dict[str, str]:
    """One entry of a module's `diff`: the text of a file before and after; None stands for no file."""

    def text(content: typing.Optional[bytes]) -> str:
        return "" if content is None else content.decode("utf-8", "replace")

    return {
        "before_header": path if before is not None else f"{path} (absent)",
        "after_header": path if after is not None else f"{path} (absent)",
        "before": text(before),
        "after": text(after),
    }


def mode_difference(path: str, before: int, after: int) -> typing.Dict[str, str]:
    """The entry for a file whose permissions alone change."""
    return difference(path, f"mode {before:04o}\n".encode("ascii"), f"mode {after:04o}\n".encode("ascii"))
