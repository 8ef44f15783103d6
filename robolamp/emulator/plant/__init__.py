"""What emulated servos turn: the lamp or a pendulum, in MuJoCo."""
