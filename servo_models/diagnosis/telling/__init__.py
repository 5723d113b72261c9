"""A diagnosis told: in words, as text, as JSON and as a parameter file."""
