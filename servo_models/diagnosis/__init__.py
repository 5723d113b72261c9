"""Diagnose a gap between a model and logs: where it lies, what causes it, how far it closes."""
