"""Any FMU: unpacked within limits, and run on FMPy in a process of its own."""
