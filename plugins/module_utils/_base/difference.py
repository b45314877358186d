# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The entries of a module's `diff`."""

import typing

Content = typing.Union[None, bytes, str]  # of a file; None means no file, and half of a character means a byte


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


def difference_of_lines(
    header: str, before: typing.Iterable[str], after: typing.Iterable[str]
) -> typing.List[typing.Dict[str, str]]:
    """The entry for something that is read as lines, in a list; an empty list if they stay the same."""
    texts = ["".join(f"{line}\n" for line in lines) for lines in (before, after)]
    return [difference(header, *texts)] if texts[0] != texts[1] else []


def mode_difference(path: str, before: int, after: int) -> typing.Dict[str, str]:
    """The entry for a file of which only the permissions change."""
    return difference(path, f"mode {before:04o}\n", f"mode {after:04o}\n")
