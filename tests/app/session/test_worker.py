"""The thread behind the page: commands in their order, and it outlives whatever its job raises."""

from __future__ import annotations

import logging

import pytest
from ispom_app.features.layers.commands import Hide
from ispom_app.session import commands as do
from ispom_app.session.worker import Worker, newest


class Job:
    """Does what it is told, and notes it; Hide is what it cannot do."""

    def __init__(self) -> None:
        self.done = list[object]()

    def begin(self) -> None:
        self.done.append("begin")
        raise OSError("not yours")

    def obey(self, command: do.Command) -> None:
        if isinstance(command, Hide):
            raise ZeroDivisionError("division by zero")
        self.done.append(command)

    def turn(self) -> None: ...

    def patience_s(self) -> float:
        return 20.0

    def failed(self, fault: Exception) -> None:
        self.done.append(str(fault))

    def end(self) -> None:
        self.done.append("end")


class Mute(Job):
    """Cannot even report."""

    def failed(self, fault: Exception) -> None:
        raise RuntimeError("nobody listens")


def run(job: Job, *commands: do.Command) -> list[object]:
    worker = Worker(job)
    for command in commands:
        worker.post(command)
    worker.start()
    assert worker.close(20.0)
    return job.done


def test_what_fails_is_reported_and_all_else_is_done() -> None:
    done = run(Job(), do.StepBy(1), Hide(frozenset()), do.StepBy(2))
    assert done == ["begin", "not yours", do.StepBy(1), "division by zero", do.StepBy(2), "end"]


def test_a_report_that_fails_is_logged_and_the_worker_lives_on(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.ERROR):
        done = run(Mute(), Hide(frozenset()), do.StepBy(2))
    assert done == ["begin", do.StepBy(2), "end"]
    assert "ZeroDivisionError" in caplog.text and "nobody listens" in caplog.text


def test_of_several_seeks_the_newest_counts_and_all_else_stays() -> None:
    commands = [do.Seek(3), do.StepBy(1), do.Seek(5), do.Play(True)]
    assert newest(commands) == [do.StepBy(1), do.Seek(5), do.Play(True)]
    assert newest([do.Play()]) == [do.Play()]
