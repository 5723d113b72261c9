"""The native FMU: a model as C, in a library that needs no Python."""
