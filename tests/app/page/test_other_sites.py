"""A page of another site in the same browser, which has the cookie: nothing of the app reaches it."""

from __future__ import annotations

import http.server
import threading
from collections.abc import Iterator
from urllib.parse import urlsplit

import psutil
import pytest

from tests.app.page.test_browser import CHROMIUM, App, app, browser, start  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
TRIES = """async (base) => {
  const ends = (what, made) => new Promise((done) => {
    made((text) => done(`${what}: ${text}`));
    setTimeout(() => done(`${what}: silence`), 5000);
  });
  const socket = (path, protocol) => ends(path, (tell) => {
    const ws = new WebSocket(base.replace("http", "ws") + path, protocol);
    ws.onopen = ws.onmessage = () => tell("OPEN");
    ws.onerror = () => tell("refused");
  });
  const read = (path, options) => fetch(base + path, { credentials: "include", ...options }).then(
    (found) => `${path}: ${found.type === "opaque" ? "opaque" : "READ"}`, () => `${path}: refused`);
  const tag = (name, path, attribute) => ends(`<${name}> ${path}`, (tell) => {
    const element = document.createElement(name);
    element.onload = () => tell("LOADED");
    element.onerror = () => tell("refused");
    element[attribute] = base + path;
    document.body.append(element);
  });
  return Promise.all([
    socket("ws"), socket("live"), socket("viser", ["viser-v1.1.1"]),
    read(""), read("recordings/run.rrd"), read("ws", { mode: "no-cors" }),
    tag("script", "web/block_external_requests.js", "src"), tag("img", "web/icon.svg", "src"),
  ]);
}"""


@pytest.fixture
def elsewhere() -> Iterator[str]:
    """A site of its own on this machine: to a browser, another port of the same host is the same site."""

    class Empty(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><body>elsewhere</body>")

        def log_message(self, format: str, *_: object) -> None: ...

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Empty)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()


def test_another_sites_page_gets_nothing_with_the_cookie_in_its_browser(browser, app: App, elsewhere: str):  # noqa: F811
    context = browser.new_context()
    own = context.new_page()
    own.goto(app.url)
    base = own.url.partition("#")[0]
    assert "token" not in base  # it does not stay in the address, nor in the history
    own.reload()
    assert own.title() != "" and own.locator("#bar").count() == 1
    other = context.new_page()
    other.goto(elsewhere)
    answers = other.evaluate(TRIES, base)
    assert len(answers) == 8
    assert {answer.rsplit(" ", 1)[1] for answer in answers} <= {"refused", "opaque"}, answers
    context.close()


def test_a_browser_without_the_token_learns_where_to_find_it(browser, app: App):  # noqa: F811
    page = browser.new_page()
    page.goto(app.url.partition("?")[0])
    assert "ISPOM printed" in page.inner_text("body")
    page.close()


def test_the_app_listens_on_its_own_port_alone(app: App):  # noqa: F811
    process = psutil.Process(app.process.pid)
    everyone = [process, *process.children(recursive=True)]
    listening = {c.laddr for p in everyone for c in p.net_connections("inet") if c.status == psutil.CONN_LISTEN}
    assert {tuple(place) for place in listening} == {("127.0.0.1", urlsplit(app.url).port)}


def test_no_process_outlives_the_app(tmp_path):
    found = start(tmp_path)
    children = psutil.Process(found.process.pid).children(recursive=True)
    found.process.terminate()
    assert found.process.wait(10) == 0
    _, alive = psutil.wait_procs(children, 5)
    assert not alive
