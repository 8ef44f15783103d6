"""Where clients meet the emulator: pseudo-terminals in real time, or lockstep in one process."""
