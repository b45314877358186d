# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sentences on errors of files: each says what to do, to the user who can do it."""

import errno
import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import (
    Problem,
    explain_unreadable,
    remedy,
    sentence,
    unreadable,
)
from mentioned import mentions


@pytest.mark.parametrize(
    ("number", "user", "words"),
    [
        (errno.EACCES, 1000, "run as root (become: true)"),
        (errno.EPERM, 0, "chattr -i"),
        (errno.EACCES, 0, "reason that forbids it to root"),
        (errno.EROFS, 0, "mount its file system writable"),
        (errno.ENOSPC, 0, "make room"),
        (errno.EIO, 0, "look at the file, its file system and its disk"),
    ],
)
def test_the_remedy_fits_the_error_and_the_user(monkeypatch, number, user, words):
    monkeypatch.setattr(os, "geteuid", lambda: user)
    found = remedy(OSError(number, os.strerror(number), "/f"))
    assert words in found
    assert ("become" in found) == (user != 0)


def test_no_sentence_has_the_number_of_an_error():
    problem = OSError(errno.ENOSPC, "No space left on device", "/f")
    end = "(No space left on device); expected a"
    assert mentions(unreadable(problem), "/f", end)
    assert mentions(sentence(problem), "/f", end)
    assert sentence(Problem("As it is.")) == "As it is."


@pytest.mark.parametrize(
    ("ends", "words"), [((), " Nothing was changed."), (("So it stays.",), " So it stays."), (("",), "")]
)
def test_a_file_that_cannot_be_read_is_a_sentence(ends, words):
    problem = OSError(errno.ENOSPC, "No space left on device", "/f")
    with pytest.raises(Problem) as found, explain_unreadable(*ends):
        raise problem
    assert str(found.value) == unreadable(problem) + words
