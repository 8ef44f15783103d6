"""The twin: the lamp in MuJoCo, with its servos, on one lane or on many."""
