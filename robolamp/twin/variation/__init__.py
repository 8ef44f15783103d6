"""How lamps of one design differ, and lamps drawn by it."""
