"""Several people at one session: one drives, what others ask for changes nothing."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from ispom_app.session import commands as do
from ispom_app.session.people import People, Person

from tests.app.page.served import COOKIE, Served, serving

ANN, BEN, CEC, EVE = Person("ann"), Person("ben"), Person("cec"), Person("eve", may_drive=False)


@pytest.fixture
def people() -> People:
    return People(lambda: None)


def drivers(people: People, *those: Person) -> list[bool]:
    return [bool(people.seen_by(person)["driving"]) for person in those]


def test_the_first_one_drives_and_may_hand_over(people: People) -> None:
    for person in (EVE, ANN, BEN):
        people.join(person)
    assert drivers(people, EVE, ANN, BEN) == [False, True, False]
    assert people.drives(ANN) and not people.drives(BEN)
    people.hand_over(BEN, people.seen_by(BEN)["you"])  # not theirs to hand over
    assert people.drives(ANN)
    people.hand_over(ANN, people.seen_by(EVE)["you"])  # an onlooker
    assert people.drives(ANN)
    people.hand_over(ANN, people.seen_by(BEN)["you"])
    assert drivers(people, EVE, ANN, BEN) == [False, False, True]
    people.take_over(ANN)
    assert drivers(people, EVE, ANN, BEN) == [False, True, False]
    people.take_over(EVE)
    assert people.drives(ANN) and not people.drives(EVE)


def test_a_reload_keeps_the_wheel_and_an_empty_seat_is_taken_by_the_next_command(people: People) -> None:
    people.join(ANN)
    people.join(BEN)
    people.leave(ANN)
    people.join(ANN)
    assert people.drives(ANN) and not people.drives(BEN)
    people.leave(ANN)
    assert people.drives(BEN) and not people.drives(EVE)
    people.join(ANN)
    assert not people.drives(ANN)


def test_the_last_one_who_is_left_and_may_drives(people: People) -> None:
    """Nobody drove, and the page said so, until a command came."""
    for person in (ANN, BEN, CEC, EVE):
        people.join(person)
    people.leave(ANN)
    assert drivers(people, BEN, CEC, EVE) == [False, False, False]  # either may take over
    people.leave(CEC)
    assert drivers(people, BEN, EVE) == [True, False] and people.seen_by(EVE)["driver"] == people.seen_by(BEN)["you"]
    people.join(ANN)  # only a reload
    assert drivers(people, ANN, BEN) == [True, False]
    people.leave(ANN)
    people.leave(BEN)
    assert drivers(people, EVE) == [False]


def test_two_pages_of_one_browser_are_one_person(people: People) -> None:
    people.join(ANN)
    people.join(ANN)
    assert people.seen_by(ANN)["others"] == []
    people.leave(ANN)
    people.join(BEN)
    assert people.drives(ANN) and not people.drives(BEN)


def test_of_those_who_do_not_drive_viser_hears_only_where_they_look_from(people: People) -> None:
    people.join(ANN)
    people.join(BEN)
    camera, control, broken = (
        msgspec.msgpack.encode(m) for m in ({"type": "ViewerCameraMessage"}, {"type": "GuiUpdateMessage"}, [1])
    )
    assert [people.passes(BEN, m) for m in (camera, control)] == [True, False]
    assert not people.passes(BEN, broken) and not people.passes(BEN, b"\xc1")
    assert not people.passes(BEN, msgspec.msgpack.encode({"type": []}))
    assert people.passes(ANN, control)


def test_commands_of_a_page_that_does_not_drive_are_not_obeyed(tmp_path: Path) -> None:
    async def check(at: Served) -> None:
        def page(name: str):
            return at.client.ws_connect(
                f"{at.url}ws", headers={"Cookie": f"{COOKIE}={at.access.token}; {COOKIE}-person={name}"}
            )

        async with page("ann") as ann, page("ben") as ben:
            assert (await ann.receive_json())["people"]["driving"]
            assert not (await ben.receive_json())["people"]["driving"]
            await ben.send_str('{"do": "seek", "index": 3}')
            await ben.send_str('{"do": "take_control"}')
            while not (await ben.receive_json())["people"]["driving"]:
                pass
            await ben.send_str('{"do": "seek", "index": 4}')
            await ben.send_str('{"do": "take_control", "to": 1}')
            while not (await ann.receive_json())["people"]["driving"]:
                pass
        assert at.session.commands == [do.Seek(4)]

    serving(tmp_path, check)


def test_onlookers_see_all_and_change_nothing(tmp_path: Path) -> None:
    async def check(at: Served) -> None:
        assert at.access.onlookers is not None
        async with at.client.get(at.url, params={"token": at.access.onlookers}, headers={"Cookie": ""}) as found:
            kept = [c.partition(";")[0] for c in found.headers.getall("Set-Cookie")]
            assert f"{COOKIE}={at.access.onlookers}" in kept and at.access.token not in str(found.headers)
        async with at.client.ws_connect(f"{at.url}ws", headers={"Cookie": "; ".join(kept)}) as eve:
            seen = (await eve.receive_json())["people"]
            assert not seen["may_drive"] and not seen["driving"] and seen["driver"] is None
            await eve.send_str('{"do": "take_control"}')
            await eve.send_str('{"do": "seek", "index": 3}')
            async with at.client.ws_connect(f"{at.url}ws") as ann:
                assert (await ann.receive_json())["people"]["driving"]
                await ann.send_str('{"do": "seek", "index": 5}')
                while (await eve.receive_json())["people"]["driver"] is None:
                    pass
        assert at.session.commands == [do.Seek(5)]

    serving(tmp_path, check, onlookers="look" * 8)
