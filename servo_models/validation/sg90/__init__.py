"""Validation of the SG90: independent reference, cases, figures of its paper, pictures."""
