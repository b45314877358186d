# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The page of the report in a real Chromium: nothing is asked for, nothing is complained of, and the keyboard is enough.

The pictures in docs/images are written anew by UPDATE_IMAGES=1 pytest tests/browser/test_page.py
"""

import json
import os
import pathlib
import time

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import list_advices, write_advices
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from chromium import Chromium
from reports import make_report

ROOT = pathlib.Path(__file__).resolve().parents[2]

IMAGES = ROOT / "docs/images"
# The finding of a run of the demonstration: ip_default_ttl was 1 on tibi-nav. docs/understand/diagnosis.md has the text of the same run.
FOLLOWED = json.loads(pathlib.Path(__file__).with_name("followed.json").read_text(encoding="utf-8"))
RESULT = "FAILED: 59 of 1870 checks failed; the list has 2 findings, 1 warning."
SINCE = {"since": "2026-11-21 14:02:00", "differences": ["tibi-nav is new", "topics of dabo: /scan is gone"]}


def wall(seen):
    fleets.wall(seen)
    fleets.second_default_route(seen)


STATES = {
    "well": lambda: make_report(fleets.fig12()),
    "wrong": lambda: make_report(fleets.fig12(), wall, **SINCE),
    "followed": lambda: make_report(fleets.fig12(), verdict="failed", result=RESULT, findings=[FOLLOWED]),
    "large": lambda: make_report(
        fleets.plan(60, 2), lambda seen: fleets.silent(seen, list(seen), ["kobuki7computer"]), pairs="auto"
    ),
}


WINDOWS = {"followed": (720, 650, "#finding-1")}  # width, height and place of a picture that is not the usual one


@pytest.fixture(scope="module")
def browser():
    with Chromium() as found:
        yield found


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    for name, made in STATES.items():
        (folder / f"{name}.html").write_text(made().html, encoding="utf-8")
    return folder


def focused(browser):
    """Return the element that has the focus: its tag, where it leads, and its name."""
    return browser.js(
        "(e => [e.tagName.toLowerCase(), e.getAttribute('href') || '', e.getAttribute('aria-label') || e.textContent.trim()])"
        "(document.activeElement)"
    )


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("state", STATES)
def test_nothing_is_asked_for_and_nothing_is_complained_of(browser, pages, state, scheme):
    browser.open(pages / f"{state}.html", prefers_color_scheme=scheme)
    assert [url for url in browser.requests if not url.startswith("data:")] == [(pages / f"{state}.html").as_uri()]
    assert browser.complaints == []
    assert (
        browser.js("getComputedStyle(document.body).backgroundColor")
        == {
            "light": "rgb(255, 255, 255)",
            "dark": "rgb(13, 17, 23)",
        }[scheme]
    )


def test_a_script_that_came_in_would_not_run(browser, pages, tmp_path):
    """The test can fail: the policy of the page stops what its template would let through."""
    page = tmp_path / "evil.html"
    text = (pages / "well.html").read_text(encoding="utf-8")
    page.write_text(
        text.replace("<main>", "<script>document.title = 'evil'</script><img src=http://192.0.2.1/x><main>")
    )
    browser.open(page)
    assert browser.js("document.title").startswith("All is well") and len(browser.complaints) >= 2


@pytest.mark.parametrize("width", [1280, 390])
def test_failures_come_first_and_the_page_fits_the_window(browser, pages, width):
    browser.open(pages / "wrong.html", width=width)
    box = browser.js(
        "(r => [r.top, r.bottom, r.left, r.right])(document.querySelector('#finding-1').getBoundingClientRect())"
    )
    assert 0 <= box[0] < 700 and box[2] >= 0 and box[3] <= width
    assert browser.js("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize(("width", "height"), [(1300, 800), (390, 844)])
@pytest.mark.parametrize("state", ["wrong", "followed", "large"])
def test_the_first_screen_tells_what_to_do(browser, pages, state, width, height):
    """The verdict, the robots, and the first finding with its first action, without scrolling."""
    browser.open(pages / f"{state}.html", width=width, height=height)
    bottoms = browser.js(
        "['.result', '.robots', '#finding-1 h3', '#finding-1 strong + p, #finding-1 p:has(strong) + *']"
        ".map(name => document.querySelector(name).getBoundingClientRect().bottom)"
    )
    assert bottoms == sorted(bottoms) and 0 < bottoms[0] and bottoms[-1] <= height
    first = browser.js("document.querySelector('.robots .failed a').getAttribute('href')")
    assert browser.js(f"document.querySelector('{first}') !== null")


CROSSED = """(svg => {
    const box = e => e.getBoundingClientRect(), texts = [...svg.querySelectorAll('text')].filter(e => !e.closest('g'));
    const over = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    const wires = [...svg.querySelectorAll('.wire')].map(box);
    return [texts.length, texts.filter(e => wires.some(wire => over(wire, box(e)))).map(e => e.textContent)];
})(document.querySelector('svg[role=group]'))"""


@pytest.mark.parametrize("width", [1300, 390])
@pytest.mark.parametrize("state", ["wrong", "large"])
def test_no_wire_of_the_picture_crosses_a_text(browser, pages, state, width):
    browser.open(pages / f"{state}.html", width=width)
    number, crossed = browser.js(CROSSED)
    assert number > 5 and crossed == []


@pytest.mark.parametrize("width", [1300, 390])
def test_the_way_of_packets_can_be_read(browser, pages, width):
    browser.open(pages / "followed.html", width=width)
    assert browser.js("document.documentElement.scrollWidth") <= width
    sizes = browser.js(
        "(svg => [...svg.querySelectorAll('text, .cross')].map(e => [e.getBoundingClientRect(), svg.getBoundingClientRect()])"
        ".map(([e, all]) => [e.left - all.left, all.right - e.right, all.bottom - e.bottom, e.height]))"
        "(document.querySelector('.way svg'))"
    )
    assert len(sizes) > 10 and all(
        left >= 0 and right >= 0 and below >= 0 and high > 9 for left, right, below, high in sizes
    )
    red, ink = (
        browser.js(f"getComputedStyle(document.querySelector('.way {name}')).{key}")
        for name, key in ((".cross", "stroke"), (".who", "fill"))
    )
    assert red == "rgb(180, 35, 24)" and red != ink


def test_the_picture_and_the_text_are_of_one_run():
    text = " ".join((ROOT / "docs/understand/diagnosis.md").read_text(encoding="utf-8").split())
    (way,) = FOLLOWED["ways"]
    assert FOLLOWED["followed"] == [way["words"]]
    assert f"followed: {way['words']}" in text and FOLLOWED["sentence"] in text
    fault = Component("setting", "tibi-nav", "ttl")
    assert (FOLLOWED["do"], FOLLOWED["look"]) == (list_advices(fault.do()), list_advices(fault.look()))
    assert FOLLOWED["remedy"] == write_advices(fault.do()) and FOLLOWED["remedy"] in text


def test_the_keyboard_leads_from_the_picture_to_the_evidence(browser, pages):
    browser.open(pages / "wrong.html")
    for _key in range(60):
        browser.press("Tab", 9)
        _tag, href, name = focused(browser)
        if href.startswith("#finding-") and "finding" in name:
            break
    else:
        pytest.fail("no mark of the picture has got the focus")
    browser.press("Enter", 13)
    assert browser.js("location.hash") == href
    top = browser.js(f"document.querySelector('{href}').getBoundingClientRect().top")
    assert 0 <= top < 900
    browser.press("Tab", 9)
    assert focused(browser)[1] == browser.js(f"document.querySelector('{href} a').href")  # the page of its id
    browser.press("Tab", 9)
    assert focused(browser)[0] == "summary"
    browser.press("Enter", 13)
    assert browser.js(f"document.querySelector('{href} details').open")


def test_on_paper_everything_is_unfolded(browser, pages):
    browser.open(pages / "wrong.html")
    hidden = "document.querySelector('#finding-1 details table').checkVisibility({contentVisibilityAuto: true})"
    assert browser.js(hidden) is False
    browser.ask("Emulation.setEmulatedMedia", media="print")
    ends = time.monotonic() + 20  # what is folded is shown with the next frame
    while browser.js(hidden) is False and time.monotonic() < ends:
        time.sleep(0.1)
    assert browser.js(hidden) is True
    browser.ask("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("state", STATES)
def test_pictures_for_the_documentation(browser, pages, state, tmp_path):
    folder = IMAGES if os.environ.get("UPDATE_IMAGES") else tmp_path
    folder.mkdir(exist_ok=True)
    width, height, place = WINDOWS.get(state, (1100, 1400, "h1"))
    browser.open(pages / f"{state}.html", width, height)
    browser.js(f"document.querySelector('{place}').scrollIntoView({{block: 'nearest'}})")
    browser.screenshot(folder / f"report-{state}.png")
    assert (folder / f"report-{state}.png").stat().st_size > 20_000 and (IMAGES / f"report-{state}.png").exists()
