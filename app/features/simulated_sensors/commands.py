"""Running a simulation again with other sensors, as a branch."""

from __future__ import annotations

from ispom.errors import InputError
from ispom.sensors.simulated import SimulatedSensor
from ispom.settings import check
from ispom.simulation.scenario.scenario import scenario_of_words, with_sensors

from ...session.branches.branches import differences
from ...session.branches.service import BranchService
from ...session.commands import Command
from ...session.controller import Controller

SIMULATION = "sim:"


class RunWithSensors(Command, frozen=True):
    """Run from the first frame on, as a branch, with these sensors instead of those in the simulation's address."""

    sensors: tuple[SimulatedSensor, ...]

    def execute(self, session: Controller) -> None:
        run, before = session.run, simulated_sensors(session.state.source)
        if run is None or not before:
            raise InputError("the source simulates no sensor besides cameras: open such as sim:city?sensor=gnss")
        for sensor in self.sensors:
            check(sensor, f"{sensor.name}.")
        changed = [
            text for old, new in zip(before, self.sensors, strict=True) for text in differences(new.name, old, new)
        ]
        if not changed:
            raise InputError("all sensors are as they were: change a setting first")
        run.require_source()
        words, hash_mark, seed = session.state.source.removeprefix(SIMULATION).partition("#")
        address = f"{SIMULATION}{with_sensors(words, self.sensors)}{hash_mark}{seed}"
        shown = run.playback
        again = session.screen.computed_run(address, session.state.source_options, shown.methods, shown.config)
        session.service(BranchService).add(again, ", ".join(changed), 0, tuple(changed))
        session.store.set(playing=True)


def simulated_sensors(source: str) -> tuple[SimulatedSensor, ...]:
    """Those in the address of a simulation; of any other source none."""
    if not source.startswith(SIMULATION):
        return ()
    try:
        return scenario_of_words(source.removeprefix(SIMULATION).partition("#")[0]).sensors
    except InputError:
        return ()
