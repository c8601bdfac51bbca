"""README and pages: what they show runs, what they link to is there, their figures agree."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dcs_jax

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "benchmarks" / "README.md"])
README = (ROOT / "README.md").read_text()


def test_the_readme_is_short():
    assert len(README.splitlines()) <= 120


def test_continuous_integration_runs_the_test_line_of_the_readme():
    (line,) = re.findall(r"<!-- test line -->\n```sh\n(.+)\n```", README)
    assert line in (ROOT / ".ci" / "run").read_text().splitlines()


def test_the_first_lines_of_python_run_as_they_stand(capsys):
    first, *_ = re.findall(r"```python\n(.+?)```", README, re.DOTALL)
    known: dict[str, Any] = {}
    exec(first, known)
    # Frames called lost: a few, all of them while something passes in front.
    assert int(capsys.readouterr().out.splitlines()[-1]) <= 5
    assert (known["clip"].occluded[np.asarray(known["track"].lost)] > 0).all()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_links_to_is_there(page):
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_every_page_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text()
    for page in ROOT.glob("docs/**/*.md"):
        assert re.search(rf"- (\w+: )?{page.relative_to(ROOT / 'docs')}\n", navigation), page


def test_the_code_of_a_cue_is_the_code_of_the_package():
    """Each piece is from a file that was named before it on the page, at any indentation."""

    def lines(text: str) -> str:
        return "\n".join(["", *filter(None, map(str.strip, text.splitlines())), ""])

    page = (ROOT / "docs" / "adding-a-cue.md").read_text()
    pieces = list(re.finditer(r"```python\n(.+?)\n```", page, re.DOTALL))
    assert len(pieces) > 8
    for piece in pieces:
        named = re.findall(r"`((?:dcs_jax|tests)/[\w/]+\.py)`", page[: piece.start()])
        assert lines(piece.group(1)) in lines((ROOT / named[-1]).read_text()), piece.group(1)


# One place makes each figure: the table of benchmarks/README.md that the command wrote.
FIGURES = {
    "boxes an annotator draws": r"1\.1 boxes per 100 frames, 10\.2|10\.2 / 15\.1 .*\*\*1\.1 / 3\.6",
    "the default's accuracy": r"\*\*6\.6(?: / |\*\* ± 0\.2 \| \*\*)0\.974",
    "the paper's accuracy": r"13\.1(?: / | ± 1\.1 \| )0\.877",
    "speed at 320x240, 80 px": r"320x240, 80 px \| \*\*433\*\* \| 315 \| 148 \| 55 \| 40",
    "speed at 1920x1080, 80 px": r"1920x1080, 80 px \| \*\*320\*\* \| 311 \| 141 \| 39 \| 35",
    "speed at 1920x1080, 300 px": r"1920x1080, 300 px \| \*\*294\*\* \| 254 \| 43 \| 26 \| 32",
}
ABOUT = {
    "boxes an annotator draws": r"boxes per 100 frames, 10\.2",
    "the default's accuracy": r"^\| `Config\(output_size=\"initial\"\)` \| 30",
    "the paper's accuracy": r"^\| `Config\.paper\(\)` \| 30",
    "speed at 320x240, 80 px": r"^\| 320x240, 80 px",
    "speed at 1920x1080, 80 px": r"^\| 1920x1080, 80 px",
    "speed at 1920x1080, 300 px": r"^\| 1920x1080, 300 px",
}


@pytest.mark.parametrize("name", FIGURES)
def test_figures_agree_with_the_measured_ones(name):
    measured = (ROOT / "benchmarks" / "README.md").read_text()
    assert re.search(FIGURES[name], measured), "measured anew: change FIGURES and every page"
    rows = [
        line
        for page in PAGES
        for line in page.read_text().splitlines()
        if re.search(ABOUT[name], line)
    ]
    assert len(rows) >= 2
    for row in rows:
        assert re.search(FIGURES[name], row), row


def test_the_version_is_the_same_everywhere():
    newest = re.search(
        r"^## \[(\d\S*)\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE
    )
    assert newest
    citation = (ROOT / "CITATION.cff").read_text()
    assert newest.group(1) == dcs_jax.__version__
    assert f"version: {newest.group(1)}\n" in citation
    assert f'date-released: "{newest.group(2)}"\n' in citation
