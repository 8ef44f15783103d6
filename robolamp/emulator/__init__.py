"""An emulated lamp: servos at byte level and a foot sensor on pseudo-terminals, with the MuJoCo twin behind both."""
