"""Validation of the smart servos: independent reference, cases, figures of its paper, pictures."""
