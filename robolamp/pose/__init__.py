"""Poses in time: gestures and sequences. Kinematics alone: neither serial ports nor physics."""
