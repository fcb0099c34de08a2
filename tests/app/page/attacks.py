"""What others try on the page's server: addresses that should lead out of its folders, and names for its host."""

from __future__ import annotations

from itertools import product

CLIMBS = ("..", "%2e%2e", "%2E%2E", ".%2e", "%252e%252e", "..;", "....", "%c0%ae%c0%ae", "..%00", "\\..", "%5c..")
SLASHES = ("/", "//", "%2f", "%5c", "\\", "%252f", "/./")
FOLDERS = ("recordings", "web", "rerun", "pictures")
PATHS = [
    f"/{folder}/{climb}{slash}{target}"
    for folder, climb, slash in product(FOLDERS[:2], CLIMBS, SLASHES[:6])
    for target in ("secret",)
]
PATHS += [f"/{folder}/{'../' * 8}etc/passwd" for folder in FOLDERS]
PATHS += [f"/{folder}/%2fetc%2fpasswd" for folder in FOLDERS]
PATHS += [f"/{folder}//etc/passwd" for folder in FOLDERS]
PATHS += [f"/{folder}/link.rrd" for folder in FOLDERS]
PATHS += [f"/{folder}/%00" for folder in FOLDERS]
PATHS += [f"/{folder}/run.rrd%00.txt" for folder in FOLDERS]
PATHS += [f"/{folder}/{'a' * 5000}" for folder in FOLDERS]
PATHS += ["/recordings/", "/recordings", "/recordings/run.txt", "/recordings/.part-run.rrd", "/recordings/rig.yaml"]
PATHS += [
    "/web/",
    "/web",
    "/rerun/",
    "/rerun",
    "/rerun.sdk_comms.v1alpha1.MessageProxyService/WriteMessages",
    "/..secret",
]

SELF = "127.0.0.1:{port}"
ALLOWED = [
    (SELF, None),
    (SELF, "http://" + SELF),
    ("localhost:{port}", "http://localhost:{port}"),
    ("LOCALHOST:{port}", "http://localhost:{port}"),
    ("[::1]:{port}", "http://[::1]:{port}"),
    ("192.168.7.7:{port}", None),
    ("proxy.example", "https://proxy.example"),
    ("Proxy.Example:443", "https://proxy.example"),
    (SELF, "https://proxy.example"),
]
REFUSED = [
    ("evil.example", None),
    ("evil.example:{port}", "http://evil.example:{port}"),
    ("localhost.evil.example:{port}", None),
    ("127.0.0.1.evil.example", None),
    ("localhost.", None),
    ("evil.example@127.0.0.1:{port}", None),
    ("127.0.0.1:{port}@evil.example", None),
    ("127.0.0.1:{port}#.evil.example", None),
    ("", None),
    ("[", None),
    ("[::1", None),
    ("127.0.0.1:99999", None),
    ("127.0.0.1:x", None),
    (SELF, "null"),
    (SELF, ""),
    (SELF, "http://evil.example"),
    (SELF, "http://127.0.0.1:1"),
    (SELF, "http://localhost:{port}"),
    (SELF, "http://proxy.example.evil.example"),
    (SELF, "file://"),
    (SELF, "chrome-extension://" + SELF),
    (SELF, "http://["),
    (SELF, "http://" + SELF + "/"),
]
