"""The line that emulated servos share: whose turn it is, what collides, what passes."""
