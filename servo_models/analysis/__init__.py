"""Figures of a model: responses to steps and sines, linearisation, comparison, explanation."""
