"""Addresses of the calibration page that lead to nothing, and who may start a calibration."""

from __future__ import annotations

from pathlib import Path

from ispom_app.session.state import State
from ispom_app.views.web.messages import message_of

from ispom.types import Guess
from tests.app.page.served import COOKIE, Served, serving


def test_an_image_that_is_not_there_is_not_found(tmp_path: Path) -> None:
    async def check(at: Served) -> None:
        for query, status in (("camera=left&view=0", 404), ("camera=left&view=x", 400), ("", 400)):
            assert await at.status(f"{at.access.base}calibration/image?{query}") == status
            assert await at.status(f"{at.access.base}calibration/seen?{query}") == status

        for name in ("x/rig.yaml", "../recordings.rrd", "%2e%2e/viewer"):
            assert await at.status(f"{at.access.base}calibration/kept/{name}") == 404

    serving(tmp_path, check)


def test_onlookers_start_no_calibration(tmp_path: Path) -> None:
    async def check(at: Served) -> None:
        assert at.access.onlookers is not None
        look = {"Cookie": f"{COOKIE}={at.access.onlookers}"}
        fields = {"what": "video", "images": "/nowhere", "target": "chessboard:7x5:0.03"}
        async with at.client.post(f"{at.url}calibration/start", params=fields, headers=look) as answer:
            assert answer.status == 403
        async with at.client.get(f"{at.url}calibration/state", headers=look) as answer:
            assert (await answer.json())["number"] == 0
        async with at.client.post(f"{at.url}calibration/start", params=fields) as answer:
            assert (answer.status, (await answer.json())["number"]) == (200, 1)

    serving(tmp_path, check, onlookers="look" * 8)


def test_how_sure_a_camera_without_a_calibration_is_stands_in_the_message() -> None:
    assert message_of(State("film.mp4"))["guess"] is None
    assert message_of(State("film.mp4", guess=Guess(420.0, 0.0184, "from the motion")))["guess"] == 1.8
