"""Validation of the motor on a voltage: independent reference, cases."""
