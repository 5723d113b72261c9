"""Validation of the torque motor: independent reference, cases, figures of its paper, pictures."""
