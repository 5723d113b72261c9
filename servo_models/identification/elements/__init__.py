"""A servo identified element by element, and the synthesis of its loop (SG90 paper)."""
