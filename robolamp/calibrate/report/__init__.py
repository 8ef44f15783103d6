"""The page that a calibration is judged by."""
