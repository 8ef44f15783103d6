"""Simulation against hardware: the twin replays a log, the two are aligned, and the difference is judged."""
