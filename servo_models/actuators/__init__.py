"""Actuators: one file, one identified product with its values, uncertainty and provenance."""
