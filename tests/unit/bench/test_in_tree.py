# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The figures in the tree: small, and read as they were written."""

import json

import in_tree


def test_a_report_has_three_digits_and_a_line_for_each_list(tmp_path):
    report = {"text": "[1, 2]", "new": [0.011550285, 1e-7, 3], "rows": [{"masters": 10, "there": 1.5123}], "none": []}
    in_tree.write(report, tmp_path / "report.json")
    written = (tmp_path / "report.json").read_text()
    assert ' "new": [0.0116, 1e-07, 3],' in written.splitlines()
    assert json.loads(written) == {**report, "new": [0.0116, 1e-7, 3], "rows": [{"masters": 10, "there": 1.51}]}


def test_the_figures_of_the_tree_are_few_lines():
    """The samples themselves stay below .work; the pictures and tables are drawn from this."""
    lines = {path.name: len(path.read_text().splitlines()) for path in in_tree.FOLDER.glob("*.json")}
    assert set(lines) == {"growth.json", "network.json"} and sum(lines.values()) < 250
