"""The page a viewer shows: one self-contained HTML file, or served live on the loopback address.

meshcat's own server is not used: it listens on every network interface, talks on stdout
and cannot be closed. Its scene commands and its JavaScript are.
"""

from __future__ import annotations

import asyncio
import base64
import html
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tornado.websocket import WebSocketHandler

PLAYER = Path(__file__).parent / "data" / "viewer" / "player.js"
LOOPBACK = "127.0.0.1"
FIRST_PORT = 7000  # meshcat's
PORTS_TRIED = 20  # one for each fit that somebody may watch at a time; then any that is free
START_TIMEOUT_S = 10.0  # a busy machine starts a thread within it; what takes longer does not come

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,"><title>{title}</title>
<style>
body {{ margin: 0; }}
#meshcat-pane {{ width: 100vw; height: 100vh; overflow: hidden; }}
/* meshcat's own panel, for those who write scenes. */
.dg.main {{ display: none; }}
#legend {{ position: absolute; left: 12px; top: 12px; max-width: min(420px, calc(100vw - 24px)); box-sizing: border-box;
  padding: 8px 12px; border-radius: 6px; pointer-events: none;
  background: rgba(20, 24, 30, 0.72); color: #eee; font: 13px/1.5 system-ui, sans-serif; }}
#legend summary {{ cursor: pointer; pointer-events: auto; }}
#caption {{ white-space: pre-line; max-height: 60vh; overflow-y: auto; }}
#legend[open] #caption {{ pointer-events: auto; }}
#player {{ position: absolute; left: 12px; right: 12px; bottom: 12px; display: flex; gap: 12px; align-items: center;
  padding: 8px 12px; border-radius: 6px; background: rgba(20, 24, 30, 0.72); color: #eee;
  font: 13px/1.5 system-ui, sans-serif; }}
#player[hidden] {{ display: none; }}
#player input {{ flex: 1; min-width: 60px; }}
#player button {{ font: inherit; width: 62px; }}
#player output {{ min-width: 22em; }}
#player input[type="checkbox"] {{ flex: none; min-width: 0; vertical-align: -2px; }}
@media (max-width: 600px) {{ #player {{ flex-wrap: wrap; }} #player output {{ min-width: 100%; }} }}
#caption i {{ display: inline-block; width: 10px; height: 10px; border-radius: 5px; margin-right: 7px; }}
/* As viewer_pairs draws them. */
#player i {{ display: inline-block; width: 16px; height: 3px; margin: 0 6px; background: #c026d3; vertical-align: 4px }}
#caption i[style*="gradient"] {{ width: 36px; }}
</style></head>
<body><div id="meshcat-pane"></div>
<details id="legend" open><summary>Legend</summary><div id="caption">{caption}</div></details>
<div id="player" hidden><button type="button">Play</button>
<input type="range" min="0" max="0" step="1" aria-label="iteration"><output></output>
<label hidden><input type="checkbox"> <i></i>pairs</label></div>
<script>{javascript}</script>
<script>
var viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
{player}
{body}
</script></body></html>
"""


class Scene:
    """Commands that make up a scene; what meshcat's Visualizer takes as its window.

    Attributes:
        title: of the page.
        captions: lines of the legend: (colour in CSS or None, text).
        wanted: what a browser that joins asks to see until it says otherwise, such as pairs.
    """

    def __init__(self, title: str = "linear_ik") -> None:
        """Start empty."""
        self.title = title
        self.captions: list[tuple[str | None, str]] = []
        self.wanted: frozenset[str] = frozenset()
        self._commands: dict[tuple[str, str, str], bytes] = {}
        self._lock = threading.Lock()
        self._server: _Server | None = None

    def send(self, command: Any) -> None:
        """Take one of meshcat's commands; the newest of its kind and path replaces the older."""
        from meshcat.visualizer import umsgpack

        lowered = command.lower()
        path, kind = str(lowered["path"]), str(lowered["type"])
        data: bytes = umsgpack.packb(lowered)
        with self._lock:
            if kind == "delete":
                inside = path.rstrip("/") + "/"
                gone = [key for key in self._commands if (key[0] + "/").startswith(inside)]
                for key in gone:
                    del self._commands[key]
            else:
                self._commands[path, kind, str(lowered.get("property", ""))] = data
        if self._server is not None:
            self._server.broadcast(data)

    def tell(self, kind: str, **content: Any) -> None:
        """Send a command of the page's own (see player.js); the newest of its kind replaces the older."""
        from meshcat.visualizer import umsgpack

        data: bytes = umsgpack.packb({"type": kind, "path": "", **content})
        with self._lock:
            # Last, since it speaks of what the others show.
            self._commands.pop(("", kind, ""), None)
            self._commands["", kind, ""] = data
        if self._server is not None:
            self._server.broadcast(data)

    def commands(self) -> list[bytes]:
        """Return what a browser that joins now has to be told, in order."""
        with self._lock:
            return list(self._commands.values())

    def static_html(self) -> str:
        """Return the scene as one HTML page that needs neither server nor network."""
        # Decoded in place: meshcat's own page fetches each command and so may apply them out of order.
        calls = [
            f'viewer.handle_command_bytearray(Uint8Array.from(atob("{base64.b64encode(data).decode()}"), '
            "c => c.charCodeAt(0)));"
            for data in self.commands()
        ]
        return self._page("\n".join(calls))

    def live_html(self) -> str:
        """Return the page that follows the scene over a web socket."""
        return self._page('viewer.connect("ws://" + location.host + "/scene");')

    def serve(self, port: int | None = None) -> str:
        """Serve the scene on the loopback address and return the page's URL.

        Args:
            port: the port, or None for the first free one from 7000 on.

        Raises:
            OSError: the port is taken.
        """
        if self._server is None:
            self._server = _Server(self, port)
        return self._server.url

    def watchers(self) -> int:
        """Return the number of browsers that follow the scene."""
        return 0 if self._server is None else len(self._server.sockets)

    def is_seen(self) -> bool:
        """Say whether anybody may see the scene: it is not served, so it is for a file, or somebody follows it."""
        return self._server is None or self.watchers() > 0

    def asked_for(self, what: str) -> bool:
        """Say whether somebody who follows the scene asks to see something (see player.js); unserved, as `wanted`."""
        if self._server is None:
            return what in self.wanted
        return any(what in wishes for wishes in list(self._server.wanted.values()))

    def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _page(self, body: str) -> str:
        from meshcat.servers.zmqserver import VIEWER_ROOT

        javascript = (Path(VIEWER_ROOT) / "main.min.js").read_text(encoding="utf-8")
        caption = "\n".join(
            (f'<i style="background: {colour}"></i>' if colour else "") + html.escape(text)
            for colour, text in self.captions
        )
        return _PAGE.format(
            title=html.escape(self.title),
            caption=caption,
            javascript=javascript,
            player=PLAYER.read_text(encoding="utf-8"),
            body=body,
        )


class _Server:
    """Serves one scene from a thread of its own."""

    def __init__(self, scene: Scene, port: int | None) -> None:
        self.sockets: set[WebSocketHandler] = set()
        self.wanted: dict[WebSocketHandler, frozenset[str]] = {}
        self.url = ""
        self._scene = scene
        self._port = port
        self._ready = threading.Event()
        self._error: OSError | None = None
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), name="linear_ik viewer", daemon=True)
        self._thread.start()
        self._ready.wait(START_TIMEOUT_S)
        if not self.url:
            raise self._error or OSError("the viewer's server did not start")

    def broadcast(self, data: bytes) -> None:
        """Send a command to every browser; any thread may call."""
        self._loop.call_soon_threadsafe(lambda: [s.write_message(data, binary=True) for s in list(self.sockets)])

    def stop(self) -> None:
        """Close every connection and end the thread."""
        self._loop.call_soon_threadsafe(self._stopped.set)
        self._thread.join(START_TIMEOUT_S)

    async def _run(self) -> None:
        import tornado.httpserver
        import tornado.netutil
        import tornado.web
        import tornado.websocket

        server = self
        self._loop, self._stopped = asyncio.get_running_loop(), asyncio.Event()

        class Page(tornado.web.RequestHandler):
            def get(self) -> None:
                self.set_header("Cache-Control", "no-store")
                self.finish(server._scene.live_html())

        class Follow(tornado.websocket.WebSocketHandler):
            def open(self, *args: str, **kwargs: str) -> None:
                # Joined first, told after: a command between the two arrives twice instead of never.
                server.wanted[self] = server._scene.wanted
                server.sockets.add(self)
                for data in server._scene.commands():
                    self.write_message(data, binary=True)

            def on_message(self, message: str | bytes) -> None:
                # All that a page may say.
                if message == "pairs":
                    server.wanted[self] = frozenset({"pairs"})
                elif message == "no pairs":
                    server.wanted[self] = frozenset()

            def on_close(self) -> None:
                server.sockets.discard(self)
                server.wanted.pop(self, None)

        app = tornado.web.Application()
        # Other host names are somebody else's page resolved to this address (DNS rebinding).
        app.add_handlers(r"(127\.0\.0\.1|localhost)", [(r"/", Page), (r"/scene", Follow)])
        ports = [*range(FIRST_PORT, FIRST_PORT + PORTS_TRIED), 0] if self._port is None else [self._port]
        for port in ports:
            try:
                listening = tornado.netutil.bind_sockets(port, LOOPBACK)
                break
            except OSError as error:
                self._error = error
        else:
            self._ready.set()
            return
        http = tornado.httpserver.HTTPServer(app)
        http.add_sockets(listening)
        self.url = f"http://{LOOPBACK}:{listening[0].getsockname()[1]}/"
        self._ready.set()
        await self._stopped.wait()
        http.stop()
        for socket in list(self.sockets):
            socket.close()
        await http.close_all_connections()
