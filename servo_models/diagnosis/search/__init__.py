"""The search for causes: which effects are looked at, fitted and taken."""
