"""The native FMU: the flat text as C in a shell for FMI, compiled."""
