"""Descriptions of the joints of a robot, begun from its recording."""
