"""One emulated servo: registers, operating modes, what it protects itself from."""
