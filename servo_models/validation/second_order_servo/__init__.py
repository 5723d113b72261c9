"""Validation of the general servo: independent reference, cases, pictures."""
