# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The file of a bundle: texts by name in a ZIP archive. Pure: bytes in or out, and no file on a disk.

A bundle may be hostile. Only members with known names are read, each up to a bound. So a path, a link or a bomb in the archive
has no effect.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterable, Mapping

LARGEST = 50_000_000  # bytes of an archive that is read
UNPACKED = 200_000_000  # bytes of its members together
MODE = 0o600 << 16
FOLDER = "rosfleet-bundle/"


class UnreadableBundle(ValueError):
    """An archive that is no bundle; one sentence without its name."""


def pack(texts: Mapping[str, str], time: tuple[int, int, int, int, int, int]) -> bytes:
    """Pack texts."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, text in texts.items():
            member = zipfile.ZipInfo(FOLDER + name, time)
            member.external_attr, member.compress_type = MODE, zipfile.ZIP_DEFLATED
            archive.writestr(member, text.encode("utf-8", "replace"))
    return stream.getvalue()


def unpack(data: bytes, names: Iterable[str]) -> dict[str, str]:
    """Return the texts of these names. Raises UnreadableBundle."""
    if len(data) > LARGEST:
        raise UnreadableBundle(f"has more than {LARGEST // 1_000_000} MB")
    left, texts = UNPACKED, {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for name in names:
                text = _member(archive, name, left)
                left -= len(text)
                texts[name] = text.decode("utf-8", "replace")
    except UnreadableBundle:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, OSError, RuntimeError, ValueError) as problem:
        raise UnreadableBundle(f"is no ZIP archive, or a damaged one ({problem})") from None
    return texts


def _member(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Read a member up to a bound; the size in its header may be false."""
    try:
        member = archive.getinfo(FOLDER + name)
    except KeyError:
        raise UnreadableBundle(f"has no {FOLDER + name}") from None
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise UnreadableBundle(f"has {FOLDER + name} in a packing that is not used for bundles")
    with archive.open(member) as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise UnreadableBundle(f"unpacks to more than {UNPACKED // 1_000_000} MB")
    return content
