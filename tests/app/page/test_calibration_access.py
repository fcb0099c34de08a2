"""Addresses of the calibration page that lead to nothing."""

from __future__ import annotations

from pathlib import Path

from tests.app.page.served import Served, serving


def test_an_image_that_is_not_there_is_not_found(tmp_path: Path) -> None:
    async def check(at: Served) -> None:
        for query, status in (("camera=left&view=0", 404), ("camera=left&view=x", 400), ("", 400)):
            assert await at.status(f"{at.access.base}calibration/image?{query}") == status
            assert await at.status(f"{at.access.base}calibration/seen?{query}") == status

    serving(tmp_path, check)
