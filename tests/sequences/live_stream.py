"""A camera on the network, on this machine: JPEG images one after the other over HTTP, as such cameras send them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2

from ispom.types import Image


class Stream:
    """What it sends: these images, and then nothing until it may end."""

    def __init__(self, images: list[Image], holds: bool) -> None:
        self.url = ""
        self.images = images
        self.may_end = threading.Event()
        if not holds:
            self.may_end.set()


@contextmanager
def streaming(images: list[Image], holds: bool = False) -> Iterator[Stream]:
    """A server with one stream at `url`; where it `holds`, the stream stays open after the last image."""
    stream = Stream(images, holds)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path != "/stream.mjpg":
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=image")
            self.end_headers()
            for image in stream.images:
                jpeg = cv2.imencode(".jpg", image)[1].tobytes()
                head = f"--image\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                self.wfile.write(head.encode() + jpeg + b"\r\n")
            stream.may_end.wait(60)

        def log_message(self, *_: object) -> None:
            """Says nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
    stream.url = f"http://127.0.0.1:{server.server_port}/stream.mjpg"
    try:
        yield stream
    finally:
        stream.may_end.set()
        server.shutdown()
        server.server_close()
