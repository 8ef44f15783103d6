"""Which servos answer on the line: whether each joint's servo does, alone with its id and of the right model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from robolamp.dynamixel.bus import Bus, Identity
from robolamp.dynamixel.registers import BAUD_CODES, MODELS, Model, Name, model_by_number
from robolamp.errors import BusError, SafetyError
from robolamp.lamp import Joint, Lamp

PATIENCE = 0.3
"""How long an answer may be late before the start [s]: a busy computer must not look like a broken cable.
Chosen; inside a tick there is no time for that."""

RATES = (1_000_000, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000, 9600)
"""Baud rates at which servos are looked for, in this order [1/s]: the lamp's, then the factory's."""

NOBODY = 253
"""An id that no servo can have: what comes after a question to it was not asked for."""

BABBLE = "bytes come without a question: is this the servos' port?"
"""What is said where that is so."""

_NEW = 1  # id of a new servo
_TRIES = 2  # pings of an id at a rate
_HINT_PATIENCE = 0.1  # s: for each of them, and there are dozens; chosen: a busy computer is seldom late twice


@dataclass(frozen=True)
class Roll:
    """Who answered.

    Attributes:
        present: Of each joint whose servo is there, alone and of the right model, by index: what it answered.
        missing: What is wrong with servos that do not answer, one text each.
        wrong: What is wrong with those who do.
        doubled: Whether several servos answer to one id: nothing must be written.
    """

    present: Mapping[int, Identity]
    missing: Sequence[str]
    wrong: Sequence[str]
    doubled: bool


def call_roll(lamp: Lamp, bus: Bus) -> Roll:
    """Ping every servo of the lamp; writes nothing.

    Args:
        lamp: Its description.
        bus: The open bus.

    Raises:
        BusError: The port is gone, or a servo refuses a ping.
    """
    present: dict[int, Identity] = {}
    silent: list[int] = []
    doubled: list[int] = []
    wrong: list[str] = []
    with bus.patient(PATIENCE):
        for index, joint in enumerate(lamp.joints):
            identity = bus.ping(joint.id)
            if identity is None:
                silent.append(index)
            elif bus.doubled(joint.id):
                doubled.append(index)
            elif identity.model_number != MODELS[joint.servo].number:
                said = f"is {_model(identity)}; {lamp.path.name} says {joint.servo}"
                wrong.append(f"{bus.label(joint.id)} {said}")
            else:
                present[index] = identity
    stirring = [index for index in silent if bus.stirs(lamp.joints[index].id)]
    babble = bool(stirring) and bus.doubled(NOBODY)
    if not babble:
        doubled += [index for index in stirring if bus.doubled(lamp.joints[index].id)]
    silent = [index for index in silent if index not in doubled]
    wrong = [said_of_doubles(bus.label(lamp.joints[index].id)) for index in sorted(doubled)] + wrong
    hints = _hints(lamp, bus, silent, babble) if silent else {}
    missing = [
        f"{bus.label(lamp.joints[index].id)} does not answer to a ping at {lamp.bus_baud} baud; {hints[index]}"
        for index in silent
    ]
    return Roll(present, missing, wrong, bool(doubled))


def check_servos(lamp: Lamp, bus: Bus) -> tuple[list[Model], list[Identity]]:
    """Call the roll, and raise an error if anything is wrong.

    Returns:
        Models and what they answered, in the order of the joints.

    Raises:
        BusError: A servo does not answer; the message names everything that is wrong.
        SafetyError: Several have one id, or one is another model than the lamp's description says.
    """
    roll = call_roll(lamp, bus)
    said = "; ".join([*roll.missing, *roll.wrong])
    if said:
        raise (BusError if roll.missing else SafetyError)(said, bus.name)
    return [MODELS[joint.servo] for joint in lamp.joints], [roll.present[index] for index in range(len(lamp.joints))]


def check_alone(bus: Bus, servo: int, model: Model) -> None:
    """Refuse a hidden second servo with the same id, which is set to answer no reads (Status Return Level 0).

    It sets both to answer everything, as the first does already: a servo that is alone does not change.

    Args:
        bus: The open bus.
        servo: The id, of a servo that answers everything.
        model: Its model.

    Raises:
        SafetyError: There is one.
        BusError: The servo does not answer, or the port is gone.
    """
    level = model[Name.STATUS_RETURN_LEVEL]
    with bus.patient(PATIENCE):
        bus.write(servo, level, level.initial or 0)
        if bus.doubled(servo):
            raise SafetyError(said_of_doubles(bus.label(servo)), bus.name)


def said_of_doubles(label: str) -> str:
    """Return the message for several servos with one id."""
    return (
        f"{label}: several servos answer to this id, and garble or double each other's answers; unplug all of them "
        "but one, and give it its own by `robolamp setup assign`"
    )


def _model(identity: Identity) -> str:
    model = model_by_number(identity.model_number)
    return model.name if model else f"model number {identity.model_number}"


def _hints(lamp: Lamp, bus: Bus, silent: Sequence[int], babble: bool) -> dict[int, str]:
    """Return where servos that do not answer may be, by index: at another rate, or with another id."""
    joints = {index: lamp.joints[index] for index in silent}
    if babble:
        return dict.fromkeys(joints, BABBLE)
    strangers = sorted(set(bus.present()) - {joint.id for joint in lamp.joints})
    rates: dict[int, int] = {}  # of the ids found at another rate
    for rate in RATES:
        if rate == lamp.bus_baud:
            continue
        with bus.at_rate(rate) as has, bus.hasty(_HINT_PATIENCE):
            for id in {_NEW, *(joint.id for joint in joints.values())} if has else ():
                if bus.ping(id, attempts=_TRIES) is not None:
                    rates.setdefault(id, rate)
    return {index: _hint(lamp, joint, rates, strangers) for index, joint in joints.items()}


def _hint(lamp: Lamp, joint: Joint, rates: Mapping[int, int], strangers: Sequence[int]) -> str:
    assign = f"`robolamp setup assign --joint {joint.name}`"
    if joint.id in rates:
        rate = rates[joint.id]
        codes = f"Baud Rate(8) is {BAUD_CODES[rate]}, not {BAUD_CODES.get(lamp.bus_baud, '?')}"
        return f"it answers at {rate} baud, {lamp.path.name} says {lamp.bus_baud}: {codes}; {assign}"
    if strangers:
        ids = " and ".join(map(str, strangers))
        return f"id {ids} answers, which is no joint's: ID(7) is {ids}, not {joint.id}? {assign}"
    if _NEW in rates:
        return f"a servo answers as id {_NEW} at {rates[_NEW]} baud, as new ones do; {assign}"
    return (
        f"no servo answers at another rate either; check its supply, its cable and its id (as in {lamp.path.name}), "
        "and that its Protocol Type(13) is 2 (DYNAMIXEL Wizard 2.0 writes it)"
    )
