"""The player: a run as one self-contained page, the lamp in 3D with its traces beside it."""
