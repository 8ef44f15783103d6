"""One servo that turns a pendulum, as a MuJoCo model: what a servo is identified on, and what an emulated one turns."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from robolamp.twin.actuators.encoders import Encoders
from robolamp.twin.actuators.gears import Gears
from robolamp.twin.actuators.servo import ServoParameters, hold, set_motor

POINT = 1e-9
"""Moment of inertia of the weight itself [kg m^2]: its mass counts as a point."""


@dataclass(frozen=True)
class Load:
    """What a pendulum is: a weight, a point at the end of an even, thin rod from the shaft to it.

    Attributes:
        mass: Of the weight [kg].
        length: From the shaft to it [m].
        arm_mass: Of the rod [kg].
    """

    mass: float
    length: float
    arm_mass: float = 0.0

    @property
    def moment(self) -> float:
        """Mass times lever, by which gravity turns it: of the rod half, as if at its end [kg m]."""
        return (self.mass + self.arm_mass / 2) * self.length

    @property
    def inertia(self) -> float:
        """Moment of inertia about the shaft: of the rod a third, as if at its end [kg m^2]."""
        return (self.mass + self.arm_mass / 3) * self.length**2

    @property
    def body(self) -> tuple[float, float, float]:
        """The same as one body: its mass [kg], its centre's way from the shaft [m], its own inertia there [kg m^2]."""
        whole = self.mass + self.arm_mass
        centre = self.moment / whole
        return whole, centre, max(self.inertia - whole * centre**2, 0.0) + POINT


@dataclass(frozen=True)
class PendulumTwin:
    """A compiled pendulum, of one joint that is at 0 where it hangs straight down; a `Driven` of motors.py.

    Attributes:
        model: The MuJoCo model.
        servos: The one servo.
    """

    model: mujoco.MjModel
    servos: ServoParameters

    # Whoever steps it says what supply and register it has.
    voltage, supply_resistance, p_gain = 1.0, 0.0, np.ones(1)
    qpos = dof = actuator = np.zeros(1, np.int64)
    gears, encoders = Gears.rigid(len(dof)), Encoders.exact(len(dof))

    @property
    def timestep(self) -> float:
        """Physics step [s]."""
        return float(self.model.opt.timestep)


def build_pendulum(servos: ServoParameters, load: Load, timestep: float) -> PendulumTwin:
    """Compile a pendulum on a servo, its winding open.

    Args:
        servos: The one servo.
        load: The pendulum.
        timestep: Physics step [s].
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    body = spec.worldbody.add_body(name="pendulum")
    hold(body.add_joint(name="shaft", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0], frictionloss=1e-6))
    mass, centre, inertia = load.body
    body.explicitinertial, body.mass, body.ipos, body.inertia = True, mass, [0.0, 0.0, -centre], [inertia] * 3
    actuator = spec.add_actuator(name="servo", target="shaft", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    set_motor(actuator, servos.table[0], PendulumTwin.p_gain[0], PendulumTwin.voltage, torque=False)
    return PendulumTwin(spec.compile(), servos)
