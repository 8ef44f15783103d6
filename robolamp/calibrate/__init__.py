"""Calibration: recordings of real servos, the parameters that explain them, and how well they do."""
