"""The parts of a validation: its rows, the cases, and what each claim is measured by."""
