"""Validation of the motor in a speed loop: cases, pictures; the reference is that of the motor."""
