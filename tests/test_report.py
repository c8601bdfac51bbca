"""The page, as a browser shows it: no errors, every picture, tables that sort, light and dark."""

import re
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from chromium import EXECUTABLE as CHROMIUM
from chromium import FLAGS
from data_sets import write_otb

from dcs_jax import Config
from dcs_jax.evaluation import evaluate
from dcs_jax.evaluation.report import write_report
from dcs_jax.evaluation.report.plots import colours
from dcs_jax.evaluation.report.strips import COUNT, film_strip
from dcs_jax.evaluation.statistics import FEWEST_SEEDS
from dcs_jax.synthetic import render

SMALL: dict[str, Any] = {"canvas": 20, "selectors": 6, "pool_size": 12}


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    """Two settings with names that need escaping, OpenCV's MIL, published runs, two sequences."""
    folder = tmp_path_factory.mktemp("report")
    write_otb(folder / "root", "Deer", render(41, (120, 160), (36, 30)))
    write_otb(folder / "root", "Toy", render(30, (120, 160), (30, 36)))
    (folder / "published").mkdir()
    (folder / "published" / "authors.csv").write_text(
        "sequence,tracker,centre_error_px_mean,centre_error_px_sd,success_rate,runs\n"
        "animal,dcs_with_l1,47.1,67.1,0.67,30\n"
    )
    return evaluate(
        folder / "root",
        folder / "out",
        settings={"paper": Config(parts=5, **SMALL), "<b>&one": Config(parts=1, **SMALL)},
        seeds=FEWEST_SEEDS,
        baselines=["MIL"],
        published=folder / "published",
    )


@pytest.fixture(scope="module")
def page(evaluation):
    return write_report(evaluation.summary, evaluation.out / "index.html")


class Outline(HTMLParser):
    """Ids, what is referred to, and the tags of a page."""

    def __init__(self):
        super().__init__()
        self.ids, self.references, self.tags = [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            elif name in ("src", "href", "xlink:href"):
                self.references.append(value)
            self.references += re.findall(r"url\((#[^)]*)\)", value or "")


def test_the_page_needs_nothing_from_outside(page):
    outline = Outline()
    text = page.read_text(encoding="utf-8")
    outline.feed(text)
    assert all(reference.startswith(("#", "data:")) for reference in outline.references)
    inner = {reference[1:] for reference in outline.references if reference.startswith("#")}
    assert inner <= set(outline.ids)
    assert len(outline.ids) == len(set(outline.ids))
    assert "@import" not in text
    assert outline.tags.count("svg") == 2 + 2 * 4
    assert "<b>&one" not in text
    assert "&lt;b&gt;&amp;one" in text


def test_the_numbers_on_the_page_are_those_of_the_summary(evaluation, page):
    text = page.read_text(encoding="utf-8")
    for setting in evaluation.summary.settings:
        numbers = evaluation.summary.overall[setting]
        for metric, digits in (("centre_error", 1), ("success_rate", 3), ("auc", 3)):
            assert f"<span>{numbers[metric].mean:.{digits}f}</span>" in text
    assert "47.1" in text
    (agreement,) = evaluation.summary.agreement
    assert f"{agreement.test.t:+.1f}" in text
    assert "too few seeds" not in text


def test_few_seeds_have_no_verdict_on_the_page(evaluation, tmp_path):
    (agreement,) = evaluation.summary.agreement
    few = evaluation.summary._replace(agreement=[agreement._replace(test=None)])
    text = write_report(few, tmp_path / "index.html").read_text(encoding="utf-8")
    assert text.count("too few seeds") == 1
    assert f"Fewer than {FEWEST_SEEDS} seeds give no verdict" in text
    for verdict in (f"{agreement.test.t:+.1f}<", "agrees<", "ours is better<", "ours is worse<"):
        assert verdict not in text


def test_film_strips_show_where_the_boxes_lie_apart(evaluation):
    summary = evaluation.summary
    strip = film_strip(summary, "Deer", colours(summary.settings))
    frames = [picture.frame for picture in strip]
    assert len(frames) == COUNT
    assert frames == sorted(frames)
    assert min(np.diff(frames)) >= 41 / 12
    boxes = np.array(
        [
            *(
                summary.records["Deer", setting, "ope"].boxes[
                    np.argsort(
                        [
                            row.scores.centre_error
                            for row in summary.rows
                            if (row.sequence, row.setting) == ("Deer", setting)
                        ]
                    )[len(summary.records["Deer", setting, "ope"].boxes) // 2]
                ]
                for setting in summary.settings
            ),
            summary.labels["Deer"].truth,
        ]
    )
    centres = boxes[..., :2] + boxes[..., 2:] / 2
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1).max(axis=(0, 1))
    assert apart.argmax() in frames


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as engines:
        opened = engines.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def shown(browser, page):
    """Open the page without a network at a size and scheme; no errors by the end of the test."""
    contexts, errors = [], []

    def show(width=1280, scheme="light"):
        context = browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme, offline=True
        )
        contexts.append(context)
        tab = context.new_page()
        tab.on("console", lambda message: errors.append(message.text))
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("requestfailed", lambda request: errors.append(request.url))
        tab.goto(page.as_uri())
        return tab

    yield show
    for context in contexts:
        context.close()
    assert errors == []


def test_every_picture_loads(shown):
    tab = shown()
    sizes = tab.evaluate("[...document.images].map(i => [i.complete, i.naturalWidth])")
    assert len(sizes) == 2 * COUNT
    assert all(complete and width == 160 for complete, width in sizes)
    drawn = tab.evaluate(
        "[...document.querySelectorAll('svg')].map(s => s.getBoundingClientRect().height)"
    )
    assert min(drawn) > 100


@pytest.mark.parametrize("table", [0, 1, 2, 3, 4])
def test_every_table_sorts_by_every_column(shown, table):
    tab = shown()
    sortable = tab.locator("table.sortable").nth(table)
    buttons = sortable.locator("thead button")
    for column in range(buttons.count()):
        for order in ("ascending", "descending"):
            buttons.nth(column).click()
            assert sortable.locator("thead th").nth(column).get_attribute("aria-sort") == order
            cells = sortable.locator(f"tbody tr > :nth-child({column + 1})")
            values = cells.evaluate_all("cells => cells.map(cell => cell.dataset.value)")
            assert len(values) >= 1
            try:
                values = [float(value.replace("Infinity", "inf")) for value in values]
            except ValueError:
                values = [value.lower() for value in values]
            known = [v for v in values if v == v]
            assert known == sorted(known, reverse=order == "descending"), column


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_wider_than_the_window(shown, width):
    tab = shown(width)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    texts = tab.evaluate(
        """[...document.querySelectorAll('svg text')].map(t => {
             const box = t.getBoundingClientRect(), svg = t.closest('svg').getBoundingClientRect();
             return [box.left - svg.left, svg.right - box.right, box.height];
           })"""
    )
    for left, right, height in texts:
        assert min(left, right) > -2
        assert height >= 8  # readable on a phone, too


def test_dark_and_light_have_ink_that_stands_out(shown):
    """The page's ground and the ink of its text and of its plots, by luminance."""
    for scheme in ("light", "dark"):
        tab = shown(scheme=scheme)
        ground, text, axis = tab.evaluate(
            """[getComputedStyle(document.body).backgroundColor,
                getComputedStyle(document.body).color,
                getComputedStyle(document.querySelector('svg text')).fill]"""
        )
        luminance = [
            np.mean(list(map(int, re.findall(r"\d+", c)[:3]))) for c in (ground, text, axis)
        ]
        assert (luminance[0] < 60) == (scheme == "dark")
        assert abs(luminance[0] - luminance[1]) > 150
        assert abs(luminance[0] - luminance[2]) > 150


def test_it_prints(shown):
    tab = shown()
    pdf = tab.pdf(format="A4")
    assert pdf.startswith(b"%PDF")
    tab.emulate_media(media="print", color_scheme="dark")
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert tab.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"
