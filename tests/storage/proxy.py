"""A small HTTP proxy before the object store, which counts, and fails on request."""

import contextlib
import http.client
import socket
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

_PIECE = 64 * 1024


@dataclass
class Request:
    """A request as the rules of a proxy see it."""

    method: str
    path: str
    size: int
    headers: dict[str, str] = field(default_factory=dict)


@dataclass
class Action:
    """What a proxy does instead of passing on a request: an error status, or a reset after some bytes of the answer."""

    status: int | None = None
    reset_after: int | None = None


class Proxy:
    """Proxy on a free port of the loopback interface; ``rule`` decides what happens to each request."""

    def __init__(self, upstream: int) -> None:
        self.requests: list[Request] = []
        self.sent = 0
        self.rule: Callable[[Request], Action | None] = lambda _: None
        outer = self

        class Handler(_Handler):
            proxy, port = outer, upstream

        self._server = _Server(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()

    def fail(self, times: int, action: Action, matches: Callable[[Request], bool] = lambda _: True) -> None:
        """Let the next requests that match fail, a number of times."""
        left = [times]

        def rule(request: Request) -> Action | None:
            if left[0] and matches(request):
                left[0] -= 1
                return action
            return None

        self.rule = rule

    def reset(self) -> None:
        """Forget what was counted, and pass everything on."""
        self.requests, self.sent, self.rule = [], 0, lambda _: None

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 100  # a connection that does not fit stalls for half a minute


class _Handler(BaseHTTPRequestHandler):
    proxy: Proxy
    port: int
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True  # or the content would wait 40 ms for the head to be acknowledged

    def _handle(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        request = Request(self.command, self.path, len(body), dict(self.headers.items()))
        self.proxy.requests.append(request)
        action = self.proxy.rule(request) or Action()
        if action.status:
            self.send_response(action.status)
            self.send_header("Content-Length", "0")
            self.end_headers()
        elif action.reset_after == 0:
            self._reset()
        else:
            self._pass_on(body, action.reset_after)

    do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = _handle  # noqa: N815 - names of the library

    def _pass_on(self, body: bytes, limit: int | None) -> None:
        upstream = http.client.HTTPConnection("127.0.0.1", self.port)
        upstream.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
        for name, value in self.headers.items():
            upstream.putheader(name, value)
        upstream.endheaders(body)
        answer = upstream.getresponse()
        self.send_response_only(answer.status)
        length = answer.headers.get("Content-Length")
        for name, value in answer.headers.items():
            if name.lower() not in ("transfer-encoding", "connection"):
                self.send_header(name, value)
        if length is None:
            self.close_connection = True
            self.send_header("Connection", "close")
        self.end_headers()
        done = 0
        while self.command != "HEAD" and (piece := answer.read(_PIECE if limit is None else min(_PIECE, limit - done))):
            try:
                self.wfile.write(piece)
            except OSError:  # the client has ended
                self.close_connection = True
                break
            done += len(piece)
            self.proxy.sent += len(piece)
            if limit is not None and done >= limit:
                self._reset()
                break
        upstream.close()

    def _reset(self) -> None:
        """End the connection with a reset, not in order."""
        self.wfile.flush()
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.connection.close()
        self.close_connection = True

    def finish(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            super().finish()

    def log_message(self, *_: object) -> None:
        pass
