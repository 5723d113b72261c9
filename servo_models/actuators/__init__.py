"""Actuators: one folder, one identified product with its values, uncertainty and provenance."""
