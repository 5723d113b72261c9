"""Effects: one file, one unmodelled effect.  With its switches at 0 it is the identity."""
