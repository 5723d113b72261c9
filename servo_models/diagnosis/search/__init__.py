"""The search for causes: which effects are screened, fitted and taken."""
