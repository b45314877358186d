# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A file for other programs is there as a whole, or as it was."""

import os

import pytest
from rosfleet_multimaster.edge.process import textfile


@pytest.mark.parametrize("moment", ["fchmod", "rename"])
@pytest.mark.parametrize("end", [SystemExit, KeyboardInterrupt, OSError])
def test_a_write_that_is_broken_off_leaves_no_draft(tmp_path, monkeypatch, moment, end):
    """SIGTERM may end the program at any moment, by SystemExit."""

    def break_off(*_arguments):
        assert len(list(tmp_path.iterdir())) == 2, "the draft is there"
        raise end

    path = tmp_path / "a.prom"
    path.write_text("before\n")
    monkeypatch.setattr(os, moment, break_off)
    with pytest.raises(end):
        textfile.write(str(path), "after\n")
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == [path] and path.read_text() == "before\n"


def test_a_draft_of_a_killed_writer_goes_with_the_file(tmp_path):
    (tmp_path / "a.prom.new").write_text("half")
    textfile.remove(str(tmp_path / "a.prom"))
    assert list(tmp_path.iterdir()) == []
