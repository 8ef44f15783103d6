"""Controllers: expressions over the lamp's signals, compiled once, evaluated every tick, kept inside an envelope."""
