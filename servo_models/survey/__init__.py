"""Many diagnoses at once: joints, episodes and units, as one table."""
