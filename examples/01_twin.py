"""The twin in virtual time: stand, bend the knee, and read what the lamp's sensors would say."""

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.lamp import load_lamp
from robolamp.signals import Command
from robolamp.twin.lamp_model import build
from robolamp.twin.twin_lamp import TwinLamp


def main() -> None:
    assets = Assets()
    lamp = TwinLamp(build(load_lamp(assets), load_calibration(assets), assets))
    lamp.open()
    lamp.torque(True)
    lamp.command(Command(np.array([0.0, 0.4, 0.0])))  # rad: ankle, knee, neck
    for step in range(6):
        lamp.clock.sleep_until(step * 0.1)  # waiting is what makes simulated time pass
        seen = lamp.observe()
        angles = " ".join(f"{name} {angle:+.3f}" for name, angle in zip(lamp.joints, seen.angle, strict=True))
        print(f"{seen.time:.1f} s   {angles} rad   floor force {seen.foot_force:.2f} N")
    lamp.close()


if __name__ == "__main__":
    main()
