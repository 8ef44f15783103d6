"""What was recorded, simulated again: by its goals, or by its controller."""
