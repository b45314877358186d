# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Links of the site that was built."""

from tools.docsite import links


def test_links_that_lead_nowhere_are_told(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.html").write_text(
        '<h1 id="top">A</h1><img src="no.png"><a href="sub/b.html#there"></a><a href="sub/b.html#gone"></a>'
        '<a href="#top"></a><a href="https://elsewhere/"></a><a href="gone.html"></a><meta name="gone" content="x">'
    )
    (tmp_path / "sub" / "b.html").write_text('<a id="there" href="../a.html?x=1#top"></a><a href="#nowhere"></a>')
    assert list(links.find_lost_links(tmp_path)) == [
        "a.html: gone.html leads to a file that is not there",
        "a.html: no.png leads to a file that is not there",
        "a.html: sub/b.html#gone leads to a place that the page does not have",
        "sub/b.html: #nowhere leads to a place that the page does not have",
    ]
    assert links.count_pages(tmp_path) == 2
