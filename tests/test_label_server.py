"""The server of the page: who may come in, frames, edits, two pages at once, exports, saving."""

import io
import json
import os
import time
import zipfile
from typing import Any

import cv2
import numpy as np
import pytest
from ffmpeg import write_plain
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from dcs_jax import formats
from dcs_jax.annotate import load
from dcs_jax.label.app import make_app
from dcs_jax.label.opening import open_project
from dcs_jax.synthetic import render

TOKEN = "a-token-of-the-test"
PORT = 8765
SITE = f"http://127.0.0.1:{PORT}"
EVENTS = f"ws://127.0.0.1:{PORT}/events"
ORIGIN = {"origin": SITE}
SMALL = "canvas=20,parts=5,selectors=6,pool_size=12"
LENGTH = 24


@pytest.fixture(scope="module")
def truth():
    return render(LENGTH, (96, 128), (40, 32), seed=2, occlusion=0)


@pytest.fixture
def clip(truth, tmp_path):
    return write_plain(tmp_path / "clip.mp4", truth.frames)


@pytest.fixture
def client(clip):
    """A browser that has opened the address with the token."""
    with TestClient(_app(clip), base_url=SITE) as client:
        client.get("/", params={"token": TOKEN})
        yield client


def _app(clip, **options):
    return make_app(open_project(clip, changes=SMALL, **options), TOKEN, "127.0.0.1", PORT)


EDITS = ("add", "set", "remove", "rename", "delete", "undo", "redo")


class Page:
    """What a page does with its web socket."""

    def __init__(self, socket):
        self.socket = socket
        self.objects: dict[int, dict[str, Any]] = {}
        self.boxes: dict[int, np.ndarray] = {}
        self.last: dict[str, dict[str, Any]] = {}
        self.unanswered = False  # whether an edit was asked for that the server has not told of

    def ask(self, type, **given):
        self.unanswered = type in EDITS
        self.socket.send_text(json.dumps({"type": type, **given}))

    def until(self, *types, where=lambda message: True):
        """The next message of these types for which the condition holds."""
        while True:
            message = self._receive()
            if message["type"] in types and where(message):
                return message

    def until_tracked(self):
        """What was asked for is tracked; before the answer the server may be idle, too."""
        self._until_it_is("status", lambda told: told["state"] == "idle" and not told["waiting"])

    def until_saved(self):
        self._until_it_is("saved", lambda told: told["what"] == "all")

    def _until_it_is(self, type, holds):
        while self.unanswered or type not in self.last or not holds(self.last[type]):
            self._receive()

    def _receive(self):
        message = self.socket.receive_json()
        if message["type"] == "objects":
            self.objects = {one["id"]: one for one in message["objects"]}
            self.last.pop("status", None)  # that of before the edit
        if message["type"] in ("objects", "error"):
            self.unanswered = False
        if message["type"] == "rows":
            boxes = self.boxes.setdefault(message["id"], np.full((LENGTH, 4), np.nan))
            boxes[message["start"] : message["end"]] = _numbers(message["boxes"]).reshape(-1, 4)
        self.last[message["type"]] = message
        return message


def _numbers(text):
    import base64

    return np.frombuffer(base64.b64decode(text), "<f4")


@pytest.fixture
def page(client):
    with client.websocket_connect(EVENTS, headers=ORIGIN) as socket:
        page = Page(socket)
        page.until("status")
        yield page


# Who may come in.


@pytest.mark.parametrize("path", ["/", "/page/main.js", "/frame/0", "/export/csv", "/formats"])
def test_nothing_without_the_token(clip, path):
    with TestClient(_app(clip), base_url=SITE) as client:
        for wrong in ({}, {"token": ""}, {"token": TOKEN[:-1]}):
            response = client.get(path, params=wrong)
            assert response.status_code == 403
            assert "open the address" in response.text


def test_the_token_becomes_a_cookie_that_no_script_and_no_other_site_has(clip):
    with TestClient(_app(clip), base_url=SITE) as client:
        response = client.get("/", params={"token": TOKEN}, follow_redirects=False)
        assert response.status_code == 303
        assert response.headers["location"] == "/"
        cookie = response.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        assert client.get("/").status_code == 200


@pytest.mark.parametrize("host", ["evil.example", f"evil.example:{PORT}", "127.0.0.1", "", "[::1"])
def test_another_host_is_refused(client, host):
    response = client.get("/", headers={"host": host})
    assert response.status_code == 403


@pytest.mark.parametrize("host", [f"localhost:{PORT}", f"[::1]:{PORT}"])
def test_other_names_of_this_machine_are_known(client, host):
    cookie = {"cookie": f"dcs_label_{PORT}={TOKEN}"}
    assert client.get("/", headers={"host": host, **cookie}).status_code == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", f"https://127.0.0.1:{PORT}"]
)
def test_another_origin_is_refused(client, origin):
    assert client.get("/frame/0", headers={"origin": origin}).status_code == 403


def test_what_another_site_embeds_is_refused(client):
    embedded = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors"}
    assert client.get("/frame/0", headers=embedded).status_code == 403


@pytest.mark.parametrize("headers", [{}, {"origin": "http://evil.example"}])
def test_a_web_socket_of_another_site_is_refused(client, headers):
    with pytest.raises(WebSocketDisconnect) as refused:
        client.websocket_connect(EVENTS, headers=headers).__enter__()
    assert refused.value.code == 4403


def test_a_web_socket_without_the_cookie_is_refused(client):
    client.cookies.clear()
    with pytest.raises(WebSocketDisconnect):
        client.websocket_connect(EVENTS, headers=ORIGIN).__enter__()


@pytest.mark.parametrize("path", ["/", "/page/main.js", "/frame/3", "/no/such/page"])
def test_the_page_may_load_nothing_from_elsewhere(client, path):
    headers = client.get(path).headers
    policy = dict(
        part.strip().split(" ", 1) for part in headers["content-security-policy"].split(";")
    )
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    "path",
    ["/page/../app.py", "/page/%2e%2e/app.py", "/page/..%2fapp.py", "/page/", "/frame/-1",
     "/frame/x", "/frame/1e3", f"/frame/{LENGTH}", "/frame/99999999999999999999", "/export/../csv"],
)  # fmt: skip
def test_no_path_leads_to_a_file(client, path):
    assert client.get(path).status_code == 404


# Frames and edits.


def test_frames_are_those_of_the_clip(client, truth):
    for index in (5, 0, LENGTH - 1):
        response = client.get(f"/frame/{index}")
        assert response.headers["content-type"] == "image/jpeg"
        shown = cv2.imdecode(np.frombuffer(response.content, np.uint8), cv2.IMREAD_COLOR_RGB)
        assert shown is not None
        assert np.abs(shown.astype(int) - truth.frames[index]).mean() < 6


def test_a_preview_is_there_or_not_yet(client):
    assert client.get("/preview/3").status_code in (200, 204)
    assert client.get(f"/preview/{LENGTH}").status_code == 204


def test_a_page_is_told_the_clip_and_the_project(client):
    with client.websocket_connect(EVENTS, headers=ORIGIN) as socket:
        told = [socket.receive_json() for _ in range(4)]
    assert [message["type"] for message in told] == ["clip", "objects", "saved", "status"]
    assert told[0] | {"type": "clip", "name": "clip.mp4", "width": 128, "height": 96} == told[0]
    assert told[0]["length"] == LENGTH


def test_a_box_is_tracked_both_ways_and_saved(page, truth, clip):
    page.ask("add", frame=10, box=truth.boxes[10].tolist())
    assert page.until("go")["id"] == 1
    page.until_tracked()
    page.until_saved()
    centres = page.boxes[1][:, :2] + page.boxes[1][:, 2:] / 2
    expected = truth.boxes[:, :2] + truth.boxes[:, 2:] / 2
    assert np.linalg.norm(centres - expected, axis=1).max() < 20
    np.testing.assert_allclose(page.boxes[1][10], truth.boxes[10])
    stored = load(clip.with_name("clip.mp4.dcs.json"), clip)
    np.testing.assert_allclose(stored.objects[0].boxes, page.boxes[1])


def test_two_pages_see_the_same(client, page, truth):
    page.ask("add", frame=0, box=truth.boxes[0].tolist())
    page.until_tracked()
    with client.websocket_connect(EVENTS, headers=ORIGIN) as socket:
        other = Page(socket)
        other.until("status")
        np.testing.assert_array_equal(other.boxes[1], page.boxes[1])
        other.ask("set", id=1, frame=20, box=truth.boxes[20].tolist())
        other.ask("rename", id=1, name="card")
        for one in (page, other):
            one.until("objects", where=lambda message: message["objects"][0]["name"] == "card")
            one.until_tracked()
            assert set(one.objects[1]["keyframes"]) == {"0", "20"}
        np.testing.assert_array_equal(other.boxes[1], page.boxes[1])


def test_not_here_undo_and_redo(page, truth):
    page.ask("add", frame=0, box=truth.boxes[0].tolist())
    page.until_tracked()
    tracked = page.boxes[1].copy()
    page.ask("set", id=1, frame=12, box=None)
    page.until_tracked()
    assert np.isnan(page.boxes[1][12:]).all()
    page.ask("undo")
    page.until("rows")
    np.testing.assert_array_equal(page.boxes[1], tracked)
    page.ask("redo")
    page.until("rows")
    page.until_tracked()
    assert np.isnan(page.boxes[1][12:]).all()
    page.ask("redo")
    assert page.until("error")["text"] == "there is nothing to redo"


@pytest.mark.parametrize(
    ("request_", "says"),
    [
        ({"type": "add", "frame": 0, "box": [1, 1, 2, 2]}, "at least 4 pixels"),
        ({"type": "add", "frame": 0, "box": [500, 1, 20, 20]}, "wholly outside"),
        ({"type": "add", "frame": LENGTH, "box": [1, 1, 20, 20]}, f"at most {LENGTH - 1}"),
        ({"type": "add", "frame": -1, "box": [1, 1, 20, 20]}, "frame must be"),
        ({"type": "add", "frame": True, "box": [1, 1, 20, 20]}, "frame must be"),
        ({"type": "add", "frame": 0, "box": [1, 1, 20]}, "box must be four numbers"),
        ({"type": "add", "frame": 0, "box": [1, 1, 20, float("nan")]}, "finite"),
        ({"type": "add", "frame": 0, "box": "1,1,20,20"}, "box must be four numbers"),
        ({"type": "add", "frame": 0}, "box must be four numbers"),
        ({"type": "set", "id": 7, "frame": 0, "box": [1, 1, 20, 20]}, "there is no object 7"),
        ({"type": "rename", "id": 7, "name": "x" * 300}, "name must be text"),
        ({"type": "delete", "id": "1"}, "id must be"),
        ({"type": "undo"}, "there is nothing to undo"),
        ({"type": "doubtful", "frame": 0}, "no box is in doubt"),
        ({"type": "open", "path": "/etc/passwd"}, "a request must be one of"),
        (["add"], "a request must be one of"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_answered_in_a_sentence(page, request_, says):
    page.socket.send_text(json.dumps(request_))
    assert says in page.until("error")["text"]


def test_what_is_no_json_is_refused(page):
    page.socket.send_text("{")
    assert "must be JSON" in page.until("error")["text"]
    page.socket.send_text("[" * 20000)
    assert "must be JSON" in page.until("error")["text"]


def test_tracking_can_be_stopped_and_goes_on(page, truth):
    page.ask("pause")
    page.ask("add", frame=0, box=truth.boxes[0].tolist())
    page.until(
        "status", where=lambda m: m["waiting"] == 1 and m["state"] in ("stopped", "compiling")
    )
    assert np.isnan(page.boxes[1][1:]).all()
    page.ask("resume")
    page.until_tracked()
    assert not np.isnan(page.boxes[1]).any()


@pytest.mark.parametrize("format", formats.NAMES)
def test_an_export_is_read_back(client, page, truth, tmp_path, format):
    page.ask("add", frame=4, box=truth.boxes[4].tolist())
    page.until_tracked()
    response = client.get(f"/export/{format}")
    assert response.status_code == 200
    name = response.headers["content-disposition"].split("''")[1]
    path = tmp_path / "exported" / name
    path.parent.mkdir()
    path.write_bytes(response.content)
    if path.suffix == ".zip":
        zipfile.ZipFile(io.BytesIO(response.content)).extractall(path.parent)
        path = path.with_suffix("")
    read = formats.read(path, format)
    assert len(read.objects) == 1
    visible = read.objects[0].boxes[read.objects[0].visible]
    assert len(visible) >= LENGTH // 2
    np.testing.assert_allclose(visible[0], page.boxes[1][read.objects[0].start], atol=1)


def test_there_is_nothing_to_export_without_objects(client):
    response = client.get("/export/csv")
    assert response.status_code == 400
    assert "draw a box first" in response.text
    assert "format must be one of" in client.get("/export/docx").text


# The project file.


def test_it_is_as_it_was_when_it_is_opened_again(clip, truth):
    boxes: list[np.ndarray] = []
    for _ in range(2):
        with TestClient(_app(clip), base_url=SITE) as client:
            client.get("/", params={"token": TOKEN})
            with client.websocket_connect(EVENTS, headers=ORIGIN) as socket:
                page = Page(socket)
                page.until("status")
                if not boxes:
                    page.ask("add", frame=0, box=truth.boxes[0].tolist())
                page.until_tracked()
                boxes.append(page.boxes[1])
    np.testing.assert_array_equal(*boxes)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_said(client, page, truth, clip):
    clip.parent.chmod(0o500)
    try:
        page.ask("add", frame=0, box=truth.boxes[0].tolist())
        problem = page.until("saved", where=lambda message: message["problem"])["problem"]
    finally:
        clip.parent.chmod(0o700)
    assert "cannot be written" in problem


def test_a_project_whose_place_is_gone_is_said_and_tried_again(truth, clip, tmp_path):
    folder = tmp_path / "kept"
    folder.mkdir()
    with TestClient(_app(clip, path=folder / "p.dcs.json"), base_url=SITE) as client:
        client.get("/", params={"token": TOKEN})
        with client.websocket_connect(EVENTS, headers=ORIGIN) as socket:
            page = Page(socket)
            page.until("status")
            folder.rmdir()
            folder.write_text("a file is in its place")
            page.ask("add", frame=0, box=truth.boxes[0].tolist())
            problem = page.until("saved", where=lambda message: message["problem"])["problem"]
            assert "p.dcs.json cannot be written" in problem
            folder.unlink()
            page.until_saved()
    assert len(load(folder / "p.dcs.json").objects) == 1


def test_going_on_from_tracks_of_another_tool(clip, truth, tmp_path):
    track = formats.ObjectTrack(
        "card", 0, truth.boxes, np.ones(LENGTH, np.float32), np.zeros(LENGTH, bool)
    )
    formats.write(tmp_path / "card.csv", formats.Tracks((track,)), "csv")
    opened = open_project(clip, boxes=tmp_path / "card.csv")
    opened.clip.close()
    np.testing.assert_allclose(opened.project.objects[0].boxes, truth.boxes, rtol=1e-5)


def test_bad_projects_are_named_and_left_as_they_are(clip, truth, tmp_path):
    path = clip.with_name("clip.mp4.dcs.json")
    with TestClient(_app(clip), base_url=SITE) as client:
        client.get("/", params={"token": TOKEN})
        with client.websocket_connect(EVENTS, headers=ORIGIN) as socket:
            page = Page(socket)
            page.until("status")
            page.ask("add", frame=0, box=truth.boxes[0].tolist())
            page.until_saved()
    good = path.read_bytes()
    newer = good.replace(b'"version":1', b'"version":99')
    for content, says in [(good[:-40], "cut short"), (newer, "newer"), (b"", "cut short")]:
        path.write_bytes(content)
        with pytest.raises(ValueError, match=says):
            open_project(clip)
        assert path.read_bytes() == content
    path.write_bytes(good)
    with pytest.raises(ValueError, match="cannot be changed"):
        open_project(clip, seed=5)
    write_plain(clip, truth.frames[::-1])
    with pytest.raises(ValueError, match="its content has changed"):
        open_project(clip)
    clip.unlink()
    with pytest.raises(ValueError, match="does not exist"):
        open_project(clip)


def test_a_page_is_not_kept_waiting_by_tracking(client, page, truth):
    """Frames come while it tracks."""
    page.ask("add", frame=0, box=truth.boxes[0].tolist())
    start = time.monotonic()
    for index in range(0, LENGTH, 6):
        assert client.get(f"/frame/{index}").status_code == 200
    assert time.monotonic() - start < 5
