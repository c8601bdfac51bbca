"""The server of the page: what is at which address."""

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Callable
from importlib import resources
from urllib.parse import quote

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from dcs_jax import formats
from dcs_jax.label.exports import export
from dcs_jax.label.guard import Guard
from dcs_jax.label.messages import Message
from dcs_jax.label.opening import Opened
from dcs_jax.label.session import Session

_MEDIA = {
    "html": "text/html",
    "css": "text/css",
    "js": "text/javascript",
    "svg": "image/svg+xml",
}
_LONGEST_REQUEST = 2**16  # bytes
_MOST_WAITING = 4096  # messages to a page that does not take them, which is then left


def make_app(opened: Opened, token: str, host: str, port: int) -> Starlette:
    """The page and what it asks for. token: without it nothing is served."""
    pages = _pages()
    sessions: list[Session] = []

    @contextlib.asynccontextmanager
    async def running(app: Starlette) -> AsyncIterator[None]:
        session = Session(*opened)
        sessions.append(session)
        await session.start()
        try:
            yield
        finally:
            await session.stop()

    async def page(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in pages:
            return PlainTextResponse("there is no such page\n", 404)
        media_type, content = pages[name]
        return Response(content, media_type=media_type)

    async def frame(request: Request) -> Response:
        try:
            content = await run_in_threadpool(opened.clip.jpeg, request.path_params["index"])
        except ValueError as error:
            return PlainTextResponse(str(error), 404)
        return Response(content, media_type="image/jpeg")

    async def preview(request: Request) -> Response:
        content = opened.clip.preview(request.path_params["index"])
        return Response(content, 200 if content else 204, media_type="image/jpeg")

    async def exported(request: Request) -> Response:
        project = sessions[0].editor.project
        try:
            file = await run_in_threadpool(export, project, request.path_params["format"])
        except (ValueError, OSError) as error:
            return PlainTextResponse(str(error), 400)
        return Response(file.content, media_type=file.media_type, headers=_attached(file.name))

    async def known_formats(request: Request) -> Response:
        return Response(json.dumps(formats.NAMES), media_type="application/json")

    async def events(socket: WebSocket) -> None:
        await socket.accept()
        await _converse(socket, sessions[0])

    routes = [
        Route("/", page),
        Route("/page/{name}", page),
        Route("/frame/{index:int}", frame),
        Route("/preview/{index:int}", preview),
        Route("/formats", known_formats),
        Route("/export/{format}", exported),
        WebSocketRoute("/events", events),
    ]
    guard = Middleware(Guard, token=token, host=host, port=port)
    return Starlette(routes=routes, middleware=[guard], lifespan=running)


async def _converse(socket: WebSocket, session: Session) -> None:
    """Send a watcher what it is told, and take what it asks for, until it leaves."""
    waiting: asyncio.Queue[Message | None] = asyncio.Queue()

    def send(message: Message) -> None:
        waiting.put_nowait(message if waiting.qsize() < _MOST_WAITING else None)

    async def sending() -> None:
        while (message := await waiting.get()) is not None:
            await socket.send_text(json.dumps(message))
        await socket.close()

    session.join(send)
    task = asyncio.create_task(sending())
    try:
        while True:
            session.receive(await socket.receive_text(), send)
    except (WebSocketDisconnect, RuntimeError, KeyError):  # it has left, or sends no text
        pass
    finally:
        session.leave(send)
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await task


def _pages() -> dict[str, tuple[str, bytes]]:
    """All files of the page by their names: no request reaches the file system."""
    folder = resources.files("dcs_jax.label") / "page"
    return {
        file.name: (_MEDIA[file.name.rpartition(".")[2]], file.read_bytes())
        for file in folder.iterdir()
        if file.name.rpartition(".")[2] in _MEDIA
    }


def _attached(name: str) -> dict[str, str]:
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}"}


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens; ValueError where the port is taken or the host is none of ours."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=128)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ValueError(
            f"{host}:{port} cannot be listened on ({reason}): name another --port, "
            "or none for one that is free"
        ) from None


def serve(app: Starlette, listening: socket.socket, started: Callable[[], None]) -> None:
    """Serve until Ctrl-C. started: called when the first request can be answered."""

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            await asyncio.to_thread(started)

    config = uvicorn.Config(
        app,
        log_level="critical",
        access_log=False,
        ws_max_size=_LONGEST_REQUEST,
        ws="websockets-sansio",
        timeout_graceful_shutdown=2,
        server_header=False,
        lifespan="on",
    )
    Server(config).run([listening])
