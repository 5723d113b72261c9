"""Estimate parameters of an actuator from logs, by simulation error in the loop that made them."""
