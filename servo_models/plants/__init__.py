"""Plants: one file, one physics."""
