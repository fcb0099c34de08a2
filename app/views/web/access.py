"""Who may speak to the page's server: whoever has the token, under a name of this host, from a page of its own."""

from __future__ import annotations

import hmac
import re
import secrets
from dataclasses import dataclass, field
from ipaddress import ip_address
from urllib.parse import urlsplit

from aiohttp import web

from ispom.errors import InputError

LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
Place = tuple[str, int | None]
_PORTS = {"http": 80, "https": 443}
_BASE = re.compile(r"/([A-Za-z0-9._~-]+/)*")
_NO_TOKEN = (
    "This page needs its token. Open the address that ISPOM printed in its terminal; it ends with ?token=...\n"
    "A browser that has opened it once needs no token until ISPOM is started again.\n"
)


class Ticket:
    """Lets one browser in, once: what a browser is started with stands in the list of processes, for every user of the
    machine to read."""

    def __init__(self) -> None:
        self.text = secrets.token_urlsafe(24)

    def take(self, token: str) -> bool:
        """Whether it is the ticket; it is used up then."""
        if not self.text or not _same_text(token, self.text):
            return False
        self.text = ""
        return True


@dataclass(frozen=True)
class Access:
    """A new one at each start."""

    hosts: frozenset[str]
    """Names of this host, in lower case, in addition to those of the loopback and numeric addresses."""
    trusted: frozenset[str] = frozenset()
    """Names under which a proxy in front of the app is reached (a part of `hosts`)."""
    base: str = "/"
    """Path that all addresses begin with, as a proxy in front asks for; ends with a slash."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)
    ticket: Ticket = field(default_factory=Ticket, repr=False)
    onlookers: str | None = field(default=None, repr=False)
    """The token of people who may look and nothing else; None where there are none."""

    def check(self, request: web.Request, cookie: str) -> None:
        """An HTTPException for whom there is nothing here."""
        if request.can_read_body:
            raise web.HTTPRequestEntityTooLarge(0, 0, headers={"Connection": "close"})
        host = _place(request.headers.get("Host", ""))
        if host is None:
            raise web.HTTPBadRequest(text="Host malformed.")
        if not self._own(host[0]) or not self._same(host, request.headers.get("Origin")) or _from_elsewhere(request):
            allowed = ", ".join(sorted(LOOPBACK | self.hosts))
            raise web.HTTPForbidden(text=f"Host or origin not allowed; allowed: {allowed}")
        token = request.query.get("token", "")
        if not (
            self.knows(request.cookies.get(cookie, ""))
            or self.knows(token)
            or (request.path == self.base and self.ticket.take(token))
        ):
            raise web.HTTPUnauthorized(text=_NO_TOKEN, headers={"Cache-Control": "no-store"})

    def knows(self, token: str) -> bool:
        """Whether it is a token; takes as long for any wrong one."""
        return self.may_drive(token) | (self.onlookers is not None and _same_text(token, self.onlookers))

    def may_drive(self, token: str) -> bool:
        """Whether who has it may give commands."""
        return _same_text(token, self.token)

    def stored_token(self, token: str) -> str:
        """What the browser that was let in with this token (or with the ticket) keeps."""
        return self.onlookers if self.onlookers is not None and _same_text(token, self.onlookers) else self.token

    def _own(self, name: str) -> bool:
        """Nobody can make a numeric address point elsewhere, but a name (DNS rebinding)."""
        return name in LOOPBACK | self.hosts or _is_address(name)

    def _same(self, host: Place, origin: str | None) -> bool:
        """Whether the page that asks is our own; no origin is none of a page."""
        if origin is None:
            return True
        scheme, _, rest = origin.partition("://")
        place, port = _place(rest), _PORTS.get(scheme)
        if place is None or port is None:
            return False
        same = place[0] == host[0] and (place[1] or port) == (host[1] or port)
        return same or place[0] in self.trusted


def checked_base(base: str) -> str:
    """The base path with its slashes; InputError where it is none."""
    base = "/" + base.strip("/") + "/" if base.strip("/") else "/"
    if not _BASE.fullmatch(base) or "/../" in base or "/./" in base:
        raise InputError(f"--base {base} is not a path: use letters, digits and - . _ ~ between slashes, as /ispom/")
    return base


def checked_host(name: str) -> str:
    """A host's name in lower case; InputError where it is none."""
    if not re.fullmatch(r"[A-Za-z0-9._-]{1,253}", name):
        raise InputError(f"--allow-host {name} is not a host name: give it without scheme, port and path")
    return name.lower()


def _same_text(a: str, b: str) -> bool:
    return hmac.compare_digest(a.encode(errors="replace"), b.encode())


def _place(netloc: str) -> Place | None:
    """Name in lower case, and port if there is one; None for what is no host."""
    try:
        parts = urlsplit(f"//{netloc}")
        name, port = parts.hostname, parts.port
    except ValueError:
        return None
    return (name, port) if name and not set(netloc) & set("/?#@\\ ") else None


def _from_elsewhere(request: web.Request) -> bool:
    """Whether the browser says that another site's page asks, other than by a link."""
    headers = request.headers
    site, mode = headers.get("Sec-Fetch-Site", "same-origin"), headers.get("Sec-Fetch-Mode")
    return site not in ("same-origin", "none") and not (
        mode == "navigate" and headers.get("Sec-Fetch-Dest") == "document"
    )


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
