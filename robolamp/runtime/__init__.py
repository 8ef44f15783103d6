"""The loop that runs a controller on a lamp: clock, schedule, guards, stop requests."""
