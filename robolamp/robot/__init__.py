"""The lamp on its serial ports, physical or emulated, as one backend."""
