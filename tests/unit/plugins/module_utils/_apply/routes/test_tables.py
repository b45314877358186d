# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The names of routing tables."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.tables import read_tables


def put(root, path, text):
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_text(text)


def test_no_files_are_the_tables_of_the_kernel(tmp_path):
    assert read_tables(str(tmp_path)) == {"default": 253, "main": 254, "local": 255}


def test_a_name_of_the_administrator_counts_and_no_other_line(tmp_path):
    put(tmp_path, "usr/share/iproute2/rt_tables", "255\tlocal\n7 site\n\n#\n# 1 inr.ruhep\nx y\n9\n")
    put(tmp_path, "usr/share/iproute2/rt_tables.d/a.conf", "0x10 hex # sixteen\n")
    put(tmp_path, "etc/iproute2/rt_tables", "8 site\n")
    put(tmp_path, "etc/iproute2/rt_tables.d/readme", "11 nobody\n")
    assert read_tables(str(tmp_path)) == {"default": 253, "main": 254, "local": 255, "site": 8, "hex": 16}
