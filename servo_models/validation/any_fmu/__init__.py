"""Validation of any FMU: against a reference of anybody's, or by its files alone."""
