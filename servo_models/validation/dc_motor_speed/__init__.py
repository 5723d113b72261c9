"""Validation of the motor in a speed loop: cases; the reference is that of the motor."""
