"""The messages of a log, as data: ROS 2 message definitions, and the topics they are written to.

The definitions of the standard messages are those of ROS 2 (common_interfaces, sensor_msgs/msg/JointState.msg), so
that Rerun, PlotJuggler and Foxglove plot a log by joint name; the robolamp messages hold what JointState cannot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from robolamp.signals import Tick

JOINT_STATE = "sensor_msgs/msg/JointState"
TICK = "robolamp_msgs/msg/Tick"
EVENT = "robolamp_msgs/msg/Event"
TRUTH = "robolamp_msgs/msg/Truth"

_SEPARATOR = "=" * 80

DEFINITIONS: Mapping[str, str] = {
    JOINT_STATE: f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
""",
    TICK: """# One tick of the loop: everything that JointState cannot hold. Times [s] are on the backend's clock.
uint32 index
string phase
float64 scheduled
float64 began
float64 read_done
float64 write_done
float64 measured_at
# Age of each joint angle and of the foot force [s]; foot force [N].
float64[] angle_age
float64 foot_force
float64 foot_age
bool contact
uint32 hops
# The servos: supply [V], temperature [degC], duty (-1 to 1), torque enable and hardware error (-1: unknown), and the
# ERR byte of each answer (-1: none came; bit 7 is the hardware alert; empty where there are no servos).
float64[] voltage
float64[] temperature
float64[] pwm
int32[] torque
int32[] hardware_error
int32[] error_byte
# The controller's terminals (their names are in the metadata record "robolamp") and raw outputs [rad].
float64[] inputs
float64[] outputs
# Running totals of what the envelope changed.
uint32 not_finite
uint32 limited
uint32 slewed
string[] faults
""",
    EVENT: """# Something that happened between ticks. level: info, warning or error.
string level
string text
""",
    TRUTH: """# What only a simulation knows of the base: position of its centre [m], lean from upright [rad],
# height of the foot's lowest point above the floor [m], largest floor force on the foot since the message before [N].
float64 base_x
float64 base_z
float64 pitch
float64 clearance
float64 force
bool fallen
""",
}
"""Message definitions by message type, as they are stored in the log."""

TRUTH_JOINTS_TOPIC = "/truth/joints"
TRUTH_BASE_TOPIC = "/truth/base"

METADATA = "robolamp"
"""Name of the metadata record that holds the run's context."""

ANSWER_WIRE = "answer_wire_s"
"""Where the context keeps how long a reading's packets are on the line [s]; known once the lamp is open."""

DURATION = "duration_s"
"""Where the context keeps how long the controller was to drive [s]; logs of 0.1.0 do not say."""

LAMP_PREFIX = "/lamp"
TWIN_PREFIX = "/twin"


def joint_state(
    names: Sequence[str],
    position: Sequence[float],
    velocity: Sequence[float] = (),
    effort: Sequence[float] = (),
    log_time: int = 0,
) -> dict[str, Any]:
    """Return a JointState message; a value that is missing is NaN, a quantity that is not measured an empty list.

    Args:
        names: Joint names, n of them.
        position: Joint angles, n values [rad].
        velocity: Joint velocities, n values [rad/s], or none.
        effort: Motor currents [A] (measured) or torques [Nm] (truth), n values, or none.
        log_time: The header's stamp, nanoseconds since the epoch.
    """
    seconds, nanoseconds = divmod(log_time, 1_000_000_000)
    return {
        "header": {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": ""},
        "name": list(names),
        "position": [float(value) for value in position],
        "velocity": [float(value) for value in velocity],
        "effort": [float(value) for value in effort],
    }


def tick_message(tick: Tick) -> dict[str, Any]:
    """Return the Tick message of one tick of the loop: a copy, free of the tick's own arrays."""
    seen, changed = tick.observation, tick.interventions
    health = seen.health
    return {
        "index": tick.index,
        "phase": tick.phase,
        "scheduled": tick.scheduled,
        "began": tick.began,
        "read_done": tick.read_done,
        "write_done": tick.write_done,
        "measured_at": seen.time,
        "angle_age": seen.angle_age.tolist(),
        "foot_force": seen.foot_force,
        "foot_age": seen.foot_age,
        "contact": tick.contact,
        "hops": tick.hops,
        "voltage": health.voltage.tolist(),
        "temperature": health.temperature.tolist(),
        "pwm": health.pwm.tolist(),
        "torque": health.torque.tolist(),
        "hardware_error": health.hardware_error.tolist(),
        "error_byte": health.error.tolist(),
        "inputs": tick.inputs.tolist(),
        "outputs": tick.outputs.tolist(),
        "not_finite": changed.not_finite,
        "limited": changed.limited,
        "slewed": changed.slewed,
        "faults": list(seen.faults),
    }
