"""Calibrating a whole lamp."""
