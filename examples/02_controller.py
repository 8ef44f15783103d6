"""A controller as an S-expression: scored on the twin and on ten lamps drawn from the spread, all at once."""

import numpy as np

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.controller.expression import parse_list
from robolamp.controller.program import compile_program
from robolamp.controller.terminals import on_board_terminals
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import build
from robolamp.twin.lanes.fleet import Fleet, Job
from robolamp.twin.variation.random_lamps import LampLaw

# Crouch, push and tuck, in a cycle that the foot's contact restarts; one expression a joint, from the foot up.
TEXT = """
(list (ifltz (- contact 0.5) -0.2 (ifltz (- ground_time 0.06) 0.0 (ifltz (- ground_time 0.2) 0.13 -0.2)))
      (ifltz (- contact 0.5) 0.77 (ifltz (- ground_time 0.06) 0.6 (ifltz (- ground_time 0.2) -0.92 0.77)))
      (ifltz (- contact 0.5) 0.31 (ifltz (- ground_time 0.06) 0.24 (ifltz (- ground_time 0.2) -0.99 0.31))))
"""


def main() -> None:
    assets = Assets()
    lamp, calibration = load_lamp(assets), load_calibration(assets)
    rng, law = np.random.default_rng(1), LampLaw(lamp, calibration, assets)
    drawn = [law.calibrated, *(law.draw(rng) for _ in range(10))]
    lamps = [build(lamp, numbers, assets, bend) for numbers, bend in drawn]

    terminals = on_board_terminals(len(lamp.joints))
    program = compile_program(parse_list(TEXT, terminals), terminals)
    outcome = Fleet(lamps, period=0.02).run([program], [Job(0, index, goal=1.0) for index in range(11)], duration=3.0)
    for x, hops, share, fell in zip(outcome.x, outcome.hops, outcome.flight_share, outcome.fallen, strict=True):
        print(f"{x * 100:5.1f} cm in 3 s, {hops:.0f} hops, {share:.0%} of the way in the air{', fell' if fell else ''}")


if __name__ == "__main__":
    main()
