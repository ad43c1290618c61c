"""A server on the loopback address whose connections break when a test wants them to."""

from __future__ import annotations

import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Server:
    """Serves `files`; `cut` bytes at most a connection (None = all), ranges only where `ranges`.

    `chunked`: the length is not told, and the body ends in the middle of a chunk.
    """

    def __init__(self):
        self.files, self.cut, self.ranges, self.asked = {}, None, True, []
        self.chunked = False
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                server.asked.append((self.path, self.headers.get("Range")))
                body = server.files.get(self.path)
                if body is None:
                    self.send_error(404)
                    return
                if server.chunked:
                    self.wfile.write(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nffff\r\n" + body[:100])
                    self.close_connection = True
                    return
                wanted = re.findall(r"\d+", self.headers.get("Range") or "") if server.ranges else []
                start = int(wanted[0]) if wanted else 0
                self.send_response(206 if start else 200)
                if start:
                    self.send_header("Content-Range", f"bytes {start}-{len(body) - 1}/{len(body)}")
                self.send_header("Content-Length", str(len(body) - start))
                self.end_headers()
                self.wfile.write(body[start:][: server.cut])

            def log_message(self, *_):
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.http.server_port}/"
        threading.Thread(target=self.http.serve_forever, args=(0.01,), daemon=True).start()
