"""Diagnoses and parameter sets side by side, on the same logs."""
