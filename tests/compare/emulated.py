"""Logs of emulated lamps in lockstep, for the tests that need a controller, hops and a bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from robolamp.controller.controller_file import load_controller
from robolamp.controller.pilot import Pilot
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import Event, Faults
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import Reality
from robolamp.emulator.truth_log import TruthLog
from robolamp.log.run_context import run_context, settings_context
from robolamp.log.schemas import ANSWER_WIRE
from robolamp.log.writer import LogWriter
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.runtime.loop import TORQUE_ON, run

from .lamps import ASSETS, CALIBRATION, LAMP


def hop(
    path: Path,
    reality: Reality,
    *,
    goal: float = 0.30,
    name: str = "hop",
    day: int = 0,
    events: tuple[Event, ...] = (),
    on_event: Callable[[str, EmulatedLamp], None] | None = None,
    duration: float = 4.0,
) -> Path:
    """Write the log of a run of `hop-counting` on an emulated lamp, and truth.mcap beside it; returns the log.

    `events` go wrong on the bus, after which the run goes on as with --resume-after-replug; `on_event` hears of the
    loop's events, before the log does, which then holds how the servos were set.
    """
    controller = load_controller(
        ASSETS.named("hop-counting", "sim/lamp/controllers", "controller"), LAMP, on_board=True
    )
    world = EmulatedLamp(LAMP, CALIBRATION, ASSETS, reality, faults=Faults("script", 1, events=events))
    ports = Lockstep(world, LAMP.bus_baud)
    robot = RobotLamp(LAMP, ports.servo_port, ports.foot_port, ports.clock)
    pilot = Pilot(controller, LAMP, goal)
    context = run_context(
        backend="emulator",
        lamp=LAMP,
        calibration=CALIBRATION,
        controller=controller.source,
        controller_name=name,
        terminals=pilot.terminals,
        goal=goal,
        control_period=controller.control_period,
    )
    epoch = day * 86_400 * 10**9
    path.parent.mkdir(parents=True, exist_ok=True)
    truth = TruthLog(path.with_name("truth.mcap"), world, 0.0, {}, epoch=epoch)
    robot.open()
    context[ANSWER_WIRE] = repr(robot.answer_wire_time)
    with LogWriter(path, context=context, joints=LAMP.names, epoch=epoch, lossless=True) as log:

        def heard(level: str, text: str) -> None:
            log.event(level, text, ports.clock.now())
            if on_event:
                on_event(text, world)
                if text == TORQUE_ON:
                    log.context(settings_context(robot.settings()))

        run(
            robot, pilot, LAMP, period=controller.control_period, duration=duration, on_tick=log.tick, on_event=heard,
            reconnect=robot.reconnect,
        )  # fmt: skip
    robot.close()
    truth.close()
    return path
