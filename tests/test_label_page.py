"""The page in a real browser: draw, watch, correct, undo, export, reload, two tabs, SIGKILL."""

import re
import signal
import sys
import time
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import sequences
from chromium import EXECUTABLE as CHROMIUM
from chromium import FLAGS
from ffmpeg import write_plain

from dcs_jax import formats
from dcs_jax.annotate import load
from dcs_jax.synthetic import render

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
expect = playwright.expect

SMALL = "canvas=20,parts=5,selectors=6,pool_size=12"
COMMAND = [sys.executable, "-c", "from dcs_jax.cli import app; app()"]
WIDTH, HEIGHT, LENGTH = 320, 240, 60
MARGIN = 16  # pixels around the frame when it is fitted
PATIENT = 120_000  # ms: it may have to compile


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    # Five seconds, the default, passed once while other tests compiled: what the page does within
    # 0.1 s beside three busy processes is asked here, not how long it takes.
    expect.set_options(timeout=PATIENT)
    with playwright.sync_playwright() as engines:
        opened = engines.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def rendered():
    return render(LENGTH, (HEIGHT, WIDTH), (64, 48), seed=3, occlusion=0)


@pytest.fixture
def truth(request, rendered):
    """What is in the clip: `frames` and `boxes`; a rendered one unless a test asks for a real one.

    The real one has the same size and length.
    """
    if getattr(request, "param", "rendered") == "rendered":
        return rendered
    real = sequences.load("faceocc2", LENGTH)
    return SimpleNamespace(frames=real.frames, boxes=real.truth)


@pytest.fixture
def clip(truth, tmp_path):
    return write_plain(tmp_path / "clip.mp4", truth.frames)


@pytest.fixture
def label(start, clip):
    """Start the server on the clip: its process and its address."""

    def label(*options):
        process = start([*COMMAND, "label", clip, "--no-browser", "--set", SMALL, *options])
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address, process.communicate()
        return process, address.group()

    return label


class Tab:
    """One tab of the browser, and what a person does in it."""

    def __init__(self, page):
        self.page = page
        self.errors: list[str] = []
        page.on("console", lambda message: self.errors.append(message.text))
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    def at(self, x, y):
        """Where a point of the frame is on the page, as the frame is fitted."""
        left, top, width, height = self.page.locator("#view").bounding_box().values()
        scale = min((width - 2 * MARGIN) / WIDTH, (height - 2 * MARGIN) / HEIGHT)
        x0, y0 = left + (width - scale * WIDTH) / 2, top + (height - scale * HEIGHT) / 2
        return x0 + scale * x, y0 + scale * y

    def drag(self, start, end):
        self.page.mouse.move(*self.at(*start))
        self.page.mouse.down()
        self.page.mouse.move(*self.at(*end), steps=4)
        self.page.mouse.up()

    def draw(self, box):
        x, y, w, h = map(float, box)
        self.drag((x, y), (x + w, y + h))

    def go(self, frame):
        field = self.page.locator("#frame")
        field.fill(str(frame))
        field.press("Enter")
        self.is_at(frame)

    def is_at(self, frame):
        expect(self.page.locator("#frame")).to_have_value(str(frame))
        expect(self.page.locator("#view")).to_have_attribute("data-frame", str(frame))

    def press(self, key):
        self.page.keyboard.press(key)

    def tracked(self):
        status = self.page.locator("#status-text")
        expect(status).to_have_text("all tracked")
        self.saved()

    def saved(self):
        expect(self.page.locator("#saved")).to_have_attribute("data-state", "all")

    def state(self, text, row=0):
        expect(self.page.locator("#objects .state").nth(row)).to_have_text(text)

    def says(self, text):
        expect(self.page.locator("#message")).to_contain_text(text)


@pytest.fixture
def tab(browser):
    """Open a tab; no console message by the end of the test."""
    contexts, tabs = [], []

    def tab(address, context=None, **options):
        if context is None:
            size = {"width": 1280, "height": 720}
            context = browser.new_context(viewport=size, accept_downloads=True, **options)
            contexts.append(context)
        tabs.append(Tab(context.new_page()))
        tabs[-1].page.goto(address)
        expect(tabs[-1].page.locator("#clip-name")).to_have_text("clip.mp4")
        tabs[-1].is_at(0)
        return tabs[-1]

    yield tab
    for context in contexts:
        context.close()
    for one in tabs:
        assert one.errors == []


def _kept(clip, condition, seconds=60):
    """Wait until the keyframes of the first object are kept like that: the page shows it before."""
    deadline = time.monotonic() + seconds
    while not condition(_stored(clip).objects[0].keyframes):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _stored(clip):
    return load(clip.with_name("clip.mp4.dcs.json"), clip)


@pytest.mark.parametrize("truth", ["rendered", "real"], indirect=True)
def test_a_box_is_drawn_tracked_corrected_and_taken_along(label, tab, clip, truth, tmp_path):
    _, address = label()
    one = tab(address)
    expect(one.page.locator("#hint")).to_be_visible()
    expect(one.page.locator("#undo")).to_be_disabled()

    one.go(20)
    one.draw(truth.boxes[20])
    one.state("keyframe")
    expect(one.page.locator("#hint")).to_be_hidden()
    one.tracked()
    lane = _stored(clip).objects[0]
    np.testing.assert_allclose(lane.keyframes[20].box, truth.boxes[20], atol=1)
    assert not np.isnan(lane.boxes).any()

    one.go(50)  # corrected: moved by its middle
    x, y, w, h = lane.boxes[50].tolist()
    one.drag((x + w / 2, y + h / 2), (x + w / 2 + 10, y + h / 2 - 8))
    one.state("keyframe")
    one.tracked()
    corrected = _stored(clip).objects[0]
    np.testing.assert_allclose(corrected.boxes[50], [x + 10, y - 8, w, h], atol=1)
    np.testing.assert_array_equal(corrected.boxes[:20], lane.boxes[:20])

    x, y, w, h = corrected.boxes[50].tolist()  # resized by a corner
    one.drag((x + w, y + h), (x + w + 12, y + h + 6))
    _kept(clip, lambda keyframes: abs(keyframes[50].box[2] - (w + 12)) < 1)
    one.tracked()
    resized = _stored(clip).objects[0]
    np.testing.assert_allclose(resized.boxes[50], [x, y, w + 12, h + 6], atol=1)

    one.go(40)
    one.press("x")
    one.state("not here")
    _kept(clip, lambda keyframes: 40 in keyframes)
    one.tracked()
    absent = _stored(clip).objects[0]
    assert np.isnan(absent.boxes[40:50]).all()
    assert not np.isnan(absent.boxes[50:]).any()

    one.press("Control+z")
    _kept(clip, lambda keyframes: 40 not in keyframes)
    one.tracked()
    np.testing.assert_array_equal(_stored(clip).objects[0].boxes, resized.boxes)
    expect(one.page.locator("#redo")).to_be_enabled()
    one.page.locator("#redo").click()
    one.state("not here")
    expect(one.page.locator("#redo")).to_be_disabled()
    one.press("Control+z")
    one.press("Control+Shift+Z")
    one.state("not here")
    one.press("Control+z")
    _kept(clip, lambda keyframes: 40 not in keyframes)
    one.tracked()

    for name in formats.NAMES:
        one.press("e")
        with one.page.expect_download() as download:
            one.page.locator(f"[data-format={name}]").click()
        path = tmp_path / "out" / download.value.suggested_filename
        download.value.save_as(path)
        if path.suffix == ".zip":
            zipfile.ZipFile(path).extractall(path.parent)
            path = path.with_suffix("")
        read = formats.read(path, name)
        row = 50 - read.objects[0].start
        assert np.abs(read.objects[0].boxes[row] - resized.boxes[50]).max() < 1.5, name

    one.page.reload()
    one.is_at(0)
    one.go(50)
    one.state("keyframe")


def test_two_tabs_see_the_same(label, tab, truth):
    _, address = label()
    one = tab(address)
    other = tab(address.split("?")[0], context=one.page.context)
    one.draw(truth.boxes[0])
    other.state("keyframe")
    other.press("r")
    other.page.keyboard.type("card")
    other.press("Enter")
    expect(one.page.locator("#objects .name")).to_have_text("card")
    other.press("Delete")
    expect(one.page.locator("#objects li")).to_have_count(0)
    one.press("Control+z")
    expect(other.page.locator("#objects .name")).to_have_text("card")


def test_the_keys_do_everything(label, tab, clip):
    _, address = label()
    one = tab(address)
    for key, frame in [
        ("ArrowRight", 1), ("Shift+ArrowRight", 11), ("ArrowLeft", 10), ("Shift+ArrowLeft", 0),
        ("End", LENGTH - 1), ("Home", 0),
    ]:  # fmt: skip
        one.press(key)
        one.is_at(frame)
    one.press("n")
    one.press("Enter")
    one.state("keyframe")
    one.saved()
    before = _stored(clip).objects[0].keyframes[0].box
    one.press("Alt+ArrowRight")
    one.press("Alt+Shift+ArrowDown")
    one.press("Control+ArrowRight")
    one.page.wait_for_timeout(500)
    one.saved()
    x, y, w, h = before
    assert _stored(clip).objects[0].keyframes[0].box == (x + 1, y + 10, w + 1, h)
    one.press("n")
    one.press("Enter")
    expect(one.page.locator("#objects li")).to_have_count(2)
    expect(one.page.locator("#objects li").nth(1)).to_have_attribute("aria-selected", "true")
    one.press("1")
    expect(one.page.locator("#objects li").nth(0)).to_have_attribute("aria-selected", "true")
    one.press("?")
    expect(one.page.locator("#keys")).to_be_visible()
    one.press("Escape")
    expect(one.page.locator("#keys")).to_be_hidden()
    one.press(" ")
    expect(one.page.locator("#play")).to_have_attribute("aria-label", "Pause")
    expect(one.page.locator("#frame")).not_to_have_value("0")
    one.press(" ")
    expect(one.page.locator("#play")).to_have_attribute("aria-label", "Play")


def test_a_box_that_is_too_small_is_refused_where_it_is_drawn(label, tab):
    _, address = label()
    one = tab(address)
    one.draw((100, 100, 40, 2))
    one.says("at least 4 pixels")
    expect(one.page.locator("#objects li")).to_have_count(0)
    x, y = one.at(0, 0)
    one.page.mouse.move(x - 14, y + 30)
    one.page.mouse.down()
    one.page.mouse.move(x - 2, y + 90, steps=3)
    one.page.mouse.up()
    one.says("in the frame")
    expect(one.page.locator("#objects li")).to_have_count(0)


def test_an_object_that_is_not_here_is_drawn_where_it_comes_back(label, tab, clip, truth):
    _, address = label()
    one = tab(address)
    one.draw(truth.boxes[0])
    one.state("keyframe")
    one.go(20)
    one.press("x")
    one.state("not here")
    one.go(30)
    one.draw(truth.boxes[30])
    one.state("keyframe")
    one.press("b")  # once more, inside of its own box
    x, y, w, h = map(float, truth.boxes[30])
    one.draw((x + 5, y + 5, w - 10, h - 10))
    one.tracked()
    (lane,) = _stored(clip).objects
    assert sorted(lane.keyframes) == [0, 20, 30]
    np.testing.assert_allclose(lane.boxes[30], (x + 5, y + 5, w - 10, h - 10), atol=1)
    assert np.isnan(lane.boxes[20:30]).all()
    one.press("n")
    one.draw((x + 5, y + 5, w - 10, h - 10))
    expect(one.page.locator("#objects li")).to_have_count(2)


def test_next_doubtful_goes_where_boxes_are_in_doubt(label, tab, clip, truth):
    _, address = label()
    one = tab(address)
    one.press("d")
    one.draw(truth.boxes[0])
    one.tracked()
    from dcs_jax.annotate import Editor

    found = Editor(_stored(clip)).next_doubtful(0)
    one.press("d")
    if found is None:
        one.says("no box is in doubt")
    else:
        one.is_at(found[0])


@pytest.mark.parametrize("kind", ["dark", "touch"])
def test_dark_and_small_and_touch(label, tab, truth, kind):
    _, address = label()
    options = {"color_scheme": "dark"} if kind == "dark" else {"has_touch": True}
    one = tab(address, **options)
    width = one.page.evaluate("document.documentElement.scrollWidth")
    assert width <= 1280
    if kind == "dark":
        colour = one.page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert max(map(int, re.findall(r"\d+", colour)[:3])) < 60
        return
    client = one.page.context.new_cdp_session(one.page)
    x, y, w, h = map(float, truth.boxes[0])
    for type, points in [
        ("touchStart", [one.at(x, y)]), ("touchMove", [one.at(x + w / 2, y + h / 2)]),
        ("touchMove", [one.at(x + w, y + h)]), ("touchEnd", []),
    ]:  # fmt: skip
        client.send(
            "Input.dispatchTouchEvent",
            {"type": type, "touchPoints": [{"x": px, "y": py} for px, py in points]},
        )
    one.state("keyframe")


def test_what_was_shown_as_saved_survives_sigkill(label, tab, clip, truth):
    process, address = label()
    one = tab(address)
    one.draw(truth.boxes[0])
    one.state("keyframe")
    expect(one.page.locator("#saved")).to_have_attribute("data-state", re.compile("all|edits"))
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert one.errors == []
    expect(one.page.locator("#status-text")).to_have_text("the server has ended")
    one.press("x")
    one.says("start dcs-jax label again")
    one.page.close()
    one.errors.clear()  # the browser has complained that nobody answers
    assert not list(Path(clip.parent).glob("*.json.*.json"))

    _, address = label()
    again = tab(address)
    again.state("keyframe")
    again.tracked()
    np.testing.assert_allclose(_stored(clip).objects[0].boxes[0], truth.boxes[0], atol=1)


@pytest.mark.skipif(sys.platform != "linux", reason="another process is limited on Linux only")
def test_a_disk_that_is_full_is_said_and_what_was_saved_is_still_there(label, tab, clip, truth):
    import resource

    process, address = label()
    one = tab(address)
    one.draw(truth.boxes[0])
    one.tracked()
    before = _stored(clip)
    hard = resource.RLIM_INFINITY
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (1000, hard))
    one.go(50)
    one.press("x")
    one.state("not here")
    expect(one.page.locator("#saved")).to_have_attribute("data-state", "problem")
    expect(one.page.locator("#saved")).to_have_text("not saved")
    one.says("clip.mp4.dcs.json cannot be written")
    one.says("what was saved before is still there")
    assert _stored(clip).objects[0].keyframes == before.objects[0].keyframes
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (hard, hard))
    one.saved()
    assert sorted(_stored(clip).objects[0].keyframes) == [0, 50]
