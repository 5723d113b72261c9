"""The next experiment: commands, and the one that separates two fitted models best."""
