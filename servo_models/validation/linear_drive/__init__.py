"""Validation of the linear drive: independent reference, cases, figures of its paper, pictures."""
