"""Faults on an emulated bus: scripts, and what carries them out."""
