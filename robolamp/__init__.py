"""robolamp: a desk lamp that hops, its controllers evolved on a calibrated MuJoCo twin."""

__version__ = "0.1.0"
