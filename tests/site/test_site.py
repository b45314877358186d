# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The site of the documentation, built and opened in a real Chromium: all is in it, on a phone too, and it is searched."""

import subprocess
import sys
import time
from pathlib import Path

import chromium
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import variables

from tools.docsite import build

ROOT = Path(__file__).resolve().parents[2]

WIDTHS = (390, 1300)  # a phone, a small laptop
PATIENCE = 60.0


@pytest.fixture(scope="module")
def site():
    """The folder of the site; what did not change is not built again."""
    done = subprocess.run(
        [sys.executable, ROOT / "tools/docsite/build.py"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return build.HTML


@pytest.fixture(scope="module")
def browser():
    with chromium.Chromium() as opened:
        yield opened


def test_everything_has_a_page(site):
    kinds = {"modules": "module", "filter": "filter", "lookup": "lookup"}
    wanted = [f"{path.stem}_{kind}" for folder, kind in kinds.items() for path in ROOT.glob(f"plugins/{folder}/*.py")]
    wanted += [f"{path.name}_role" for path in (ROOT / "roles").iterdir()]
    assert len(wanted) > 40
    assert not [name for name in wanted if not (site / f"reference/{name}.html").is_file()]


def test_each_variable_is_on_the_page_of_variables(site):
    page = (site / "docs" / "operate" / "variables.html").read_text(encoding="utf-8")
    names = [variable.name for variable in variables.VARIABLES]
    assert len(names) > 20 and not [name for name in names if name not in page]


@pytest.mark.parametrize("width", WIDTHS)
def test_each_page_fits_and_asks_for_nothing_elsewhere(site, browser, width):
    wrong = []
    for path in sorted(site.rglob("*.html")):
        browser.open(path, width=width)
        wide = browser.js("document.documentElement.scrollWidth")
        asked = [url for url in browser.requests if not url.startswith(("file:", "data:"))]
        told = "ERROR:" in browser.js("document.body.innerText")
        if wide > width or asked or told or browser.complaints:
            wrong.append((path.name, wide, asked, told, browser.complaints))
    assert not wrong


@pytest.mark.parametrize("width", WIDTHS)
def test_pictures_are_seen(site, browser, width):
    browser.open(site / "docs" / "operate" / "verification.html", width=width)
    seen = "[...document.querySelectorAll('article img')].map(img => img.naturalWidth > 0 && img.clientWidth > 0)"
    assert len(browser.js(seen)) >= 2 and all(browser.js(seen))


def test_a_word_is_found(site, browser):
    browser.open(site / "search.html", width=390, query="?q=multimaster_exports")
    found = "[...document.querySelectorAll('#search-results li a')].map(link => link.getAttribute('href'))"
    ends = time.monotonic() + PATIENCE
    while not any("data_flow" in link for link in browser.js(found) or []):
        assert time.monotonic() < ends, browser.js(found)
        time.sleep(0.2)
