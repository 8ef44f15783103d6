"""Realities: how an emulated lamp differs from its twin."""
