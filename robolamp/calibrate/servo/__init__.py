"""Calibrating one servo on a pendulum bench."""
