"""Validation of the motor on a current: cases; the reference is that of the motor."""
