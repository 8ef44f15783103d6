"""One servo that turns a pendulum, as a MuJoCo model: what a servo is identified on, and what an emulated one turns."""

from __future__ import annotations

import mujoco

POINT = 1e-9
"""Moment of inertia of the weight itself [kg m^2]: its mass counts as a point."""

FIRM = 0.999
"""MuJoCo's d of the friction constraint: with its 0.9 an arm that friction holds creeps by degrees in seconds."""

QUICK = 0.004
"""Time constant of the friction constraint [s]: four steps."""


def pendulum_model(timestep: float) -> mujoco.MjModel:
    """Compile a pendulum of 1 kg at 0.1 m on a servo of made-up constants: whoever steps it writes its own into it.

    The one joint is at 0 where the pendulum hangs straight down; the one actuator is a dcmotor that goes by position.

    Args:
        timestep: Physics step [s].
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    body = spec.worldbody.add_body(name="pendulum")
    body.add_joint(
        name="shaft", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0],
        frictionloss=1e-6, solref_friction=[QUICK, 1.0], solimp_friction=[FIRM, FIRM, 0.001, 0.5, 2.0],
    )  # fmt: skip
    body.explicitinertial, body.mass, body.ipos, body.inertia = True, 1.0, [0.0, 0.0, -0.1], [POINT] * 3
    actuator = spec.add_actuator(name="servo", target="shaft", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_dcmotor(
        motorconst=[1.0, 1.0],
        resistance=1.0,
        controller=[1.0, 0.0, 1.0, 0.0, 0.0, 1.0],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS),
    )
    return spec.compile()
