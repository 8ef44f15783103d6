"""Dynamixel X-series servos: their control tables as data, and the bus that reads and writes them."""
