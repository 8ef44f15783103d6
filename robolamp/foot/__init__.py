"""The foot sensor: its serial protocol (hardware/firmware/README.md) and its reader."""
